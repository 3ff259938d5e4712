# SPDX-License-Identifier: Apache-2.0
"""console_device_page_test.py SOURCE PROGRAMS ASSET WORK: the choice and the test of a device in the console's page, in a headless Chromium
(console/drive_devices.mjs), with trocar-device-sim as the device."""
import json
import pathlib
import sys

from chromium_page import PAGE, drive, links_of, need_browser
from console_client import Console
from console_server_test import make_folder
from device_link_e2e_test import Simulator
from e2e import check, outcome

SOURCE, PROGRAMS, ASSET, WORK = (pathlib.Path(word).resolve() for word in sys.argv[1:5])
DEAD = "udp:127.0.0.1:9"  # nobody answers there


def make_scenes(folder):
    scene = json.loads((folder / "scenes/one_slice.json").read_text(encoding="utf-8"))
    scene |= {"name": "Outside", "duration_s": 60}
    scene["hand"]["trajectory"] = scene["hand"]["trajectory"][:2]  # the tool stays above the bone
    (folder / "scenes/outside.json").write_text(json.dumps(scene), encoding="utf-8")
    scene |= {"name": "By hand", "hand": {"live": True, "trajectory": scene["hand"]["trajectory"][:1]}}
    (folder / "scenes/live.json").write_text(json.dumps(scene), encoding="utf-8")


def main():
    need_browser()
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
        given = {**links_of(console),
                 "plain_link": f"http://{plain.host}/#{plain.token}", "device": device, "dead": DEAD, "secret": str(WORK), "out": str(WORK / "pictures")}
        drive("drive_devices.mjs", given)
        check(console.stop() == 0 and plain.stop() == 0, "a console did not end as it should")
    return outcome()


sys.exit(main())
