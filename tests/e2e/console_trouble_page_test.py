# SPDX-License-Identifier: Apache-2.0
"""console_trouble_page_test.py SOURCE PROGRAMS ASSET WORK: what the console's page shows of sessions in trouble, and that its keys do no harm,
in a headless Chromium (console/drive_trouble.mjs)."""
import json
import pathlib
import sys

from chromium_page import PAGE, drive, links_of, need_browser
from console_client import Console
from console_server_test import make_folder
from e2e import check, outcome

SOURCE, PROGRAMS, ASSET, WORK = (pathlib.Path(word).resolve() for word in sys.argv[1:5])


def main():
    need_browser()
    folder = make_folder(SOURCE, ASSET, WORK)
    lost = json.loads((folder / "scenes/one_slice.json").read_text(encoding="utf-8"))
    lost |= {"name": "Lost asset", "asset": "../no_such.glb"}
    (folder / "scenes/lost.json").write_text(json.dumps(lost), encoding="utf-8")
    (folder / "scenes/broken.json").write_text("{", encoding="utf-8")
    outside = json.loads((folder / "scenes/one_slice.json").read_text(encoding="utf-8"))
    outside |= {"name": "Outside", "duration_s": 600, "goals": {"target": {"at_m": [0, 0, 0.11], "radius_m": 0.003}}}
    outside["hand"]["trajectory"] = outside["hand"]["trajectory"][:2]  # the tool stays above the bone
    (folder / "scenes/outside.json").write_text(json.dumps(outside), encoding="utf-8")
    (WORK / "pictures").mkdir()
    with (WORK / "console.log").open("w") as log:
        console = Console(PROGRAMS / "trocar-console", folder, page=PAGE, stderr=log)
        drive("drive_trouble.mjs", {**links_of(console), "out": str(WORK / "pictures")})
        check(console.stop() == 0, "the console did not end as it should")
    return outcome()


sys.exit(main())
