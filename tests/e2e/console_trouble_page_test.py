# SPDX-License-Identifier: Apache-2.0
"""console_trouble_page_test.py SOURCE PROGRAMS ASSET WORK: what the console's page shows of sessions in trouble, and that its keys do no harm,
in a headless Chromium (console/drive_trouble.mjs)."""
import json
import os
import pathlib
import shutil
import subprocess
import sys

from console_client import Console
from console_server_test import make_folder
from e2e import check, outcome

SOURCE, PROGRAMS, ASSET, WORK = (pathlib.Path(word).resolve() for word in sys.argv[1:5])
DRIVER = SOURCE / "tests" / "e2e" / "console"
PAGE = SOURCE / "runtime" / "console" / "page"
CHROMIUM = os.environ.get("TROCAR_CHROMIUM") or shutil.which("chromium")


def skip(why):
    print(why)
    sys.exit(1 if os.environ.get("TROCAR_REQUIRE_CONSOLE") else 77)


def main():
    if not CHROMIUM or not shutil.which("node") or not (DRIVER / "node_modules" / "playwright-core").is_dir():
        skip("skipped: no chromium, node or playwright-core (scripts/setup test, scripts/test)")
    if not (PAGE / "vendor").is_dir():
        skip("skipped: the page's libraries are missing (scripts/setup console)")
    folder = make_folder(SOURCE, ASSET, WORK)
    lost = json.loads((folder / "scenes/one_slice.json").read_text(encoding="utf-8"))
    lost |= {"name": "Lost asset", "asset": "../no_such.glb"}
    (folder / "scenes/lost.json").write_text(json.dumps(lost), encoding="utf-8")
    (folder / "scenes/broken.json").write_text("{", encoding="utf-8")
    outside = json.loads((folder / "scenes/one_slice.json").read_text(encoding="utf-8"))
    outside |= {"name": "Outside", "duration_s": 600}
    outside["hand"]["trajectory"] = outside["hand"]["trajectory"][:2]  # the tool stays above the bone
    (folder / "scenes/outside.json").write_text(json.dumps(outside), encoding="utf-8")
    (WORK / "pictures").mkdir()
    with (WORK / "console.log").open("w") as log:
        console = Console(PROGRAMS / "trocar-console", folder, page=PAGE, stderr=log)
        given = {"link": f"http://{console.host}/#{console.token}", "view_link": f"http://{console.host}/#{console.view}", "chromium": CHROMIUM,
                 "out": str(WORK / "pictures")}
        done = subprocess.run(["node", DRIVER / "drive_trouble.mjs", json.dumps(given)], cwd=DRIVER, stdout=subprocess.PIPE, text=True, check=False)
        check(console.stop() == 0, "the console did not end as it should")
    check(done.returncode == 0, f"the driver ended with {done.returncode}")
    for failure in json.loads(done.stdout.splitlines()[-1])["failures"] if done.stdout else ["the driver said nothing"]:
        check(False, failure)
    return outcome()


sys.exit(main())
