# SPDX-License-Identifier: Apache-2.0
"""console_device_page_test.py SOURCE PROGRAMS ASSET WORK: the choice and the test of a device in the console's page, in a headless Chromium
(console/drive_devices.mjs), with trocar-device-sim as the device."""
import json
import os
import pathlib
import shutil
import subprocess
import sys

from console_client import Console
from console_server_test import make_folder
from device_link_e2e_test import Simulator
from e2e import check, outcome

SOURCE, PROGRAMS, ASSET, WORK = (pathlib.Path(word).resolve() for word in sys.argv[1:5])
DRIVER = SOURCE / "tests" / "e2e" / "console"
PAGE = SOURCE / "runtime" / "console" / "page"
CHROMIUM = os.environ.get("TROCAR_CHROMIUM") or shutil.which("chromium")
DEAD = "udp:127.0.0.1:9"  # nobody answers there


def skip(why):
    print(why)
    sys.exit(1 if os.environ.get("TROCAR_REQUIRE_CONSOLE") else 77)


def make_scenes(folder):
    scene = json.loads((folder / "scenes/one_slice.json").read_text(encoding="utf-8"))
    scene |= {"name": "Outside", "duration_s": 60}
    scene["hand"]["trajectory"] = scene["hand"]["trajectory"][:2]  # the tool stays above the bone
    (folder / "scenes/outside.json").write_text(json.dumps(scene), encoding="utf-8")
    scene |= {"name": "By hand", "hand": {"live": True, "trajectory": scene["hand"]["trajectory"][:1]}}
    (folder / "scenes/live.json").write_text(json.dumps(scene), encoding="utf-8")


def main():
    if not CHROMIUM or not shutil.which("node") or not (DRIVER / "node_modules" / "playwright-core").is_dir():
        skip("skipped: no chromium, node or playwright-core (scripts/setup test, scripts/test)")
    if not (PAGE / "vendor").is_dir():
        skip("skipped: the page's libraries are missing (scripts/setup console)")
    folder = make_folder(SOURCE, ASSET, WORK)
    make_scenes(folder)
    for name in ("pictures", "keys"):
        (WORK / name).mkdir()
    with Simulator(PROGRAMS, WORK / "keys", folder / "scenes/outside.json", "--watchdog", "0.25") as simulator, (WORK / "console.log").open("w") as log:
        key = f"key-file={simulator.key_file}"
        device = f"udp:{simulator.address}"
        console = Console(PROGRAMS / "trocar-console", folder, "--device", "inproc", "--device", f"{device},{key},simulated", "--device", f"{DEAD},{key}",
                          page=PAGE, stderr=log)
        plain = Console(PROGRAMS / "trocar-console", folder, page=PAGE, stderr=log)
        given = {"link": f"http://{console.host}/#{console.token}", "view_link": f"http://{console.host}/#{console.view}", "chromium": CHROMIUM,
                 "plain_link": f"http://{plain.host}/#{plain.token}", "device": device, "dead": DEAD, "secret": str(WORK), "out": str(WORK / "pictures")}
        done = subprocess.run(["node", DRIVER / "drive_devices.mjs", json.dumps(given)], cwd=DRIVER, stdout=subprocess.PIPE, text=True, check=False)
        check(console.stop() == 0 and plain.stop() == 0, "a console did not end as it should")
    check(done.returncode == 0, f"the driver ended with {done.returncode}")
    for failure in json.loads(done.stdout.splitlines()[-1])["failures"] if done.stdout else ["the driver said nothing"]:
        check(False, failure)
    return outcome()


sys.exit(main())
