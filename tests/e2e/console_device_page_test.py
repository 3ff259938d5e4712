# SPDX-License-Identifier: Apache-2.0
"""console_device_page_test.py SOURCE PROGRAMS ASSET WORK: the choice and the test of a device in the console's page, in a headless Chromium
(console/drive_devices.mjs), with trocar-device-sim as the device."""
import json
import pathlib
import sys

from chromium_page import drive, need_browser, page_of
from console_server_test import make_folder
from device_link_e2e_test import Simulator
from e2e import outcome

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
    (WORK / "keys").mkdir()
    with Simulator(PROGRAMS, WORK / "keys", folder / "scenes/outside.json", "--watchdog", "0.25") as simulator:
        key, device = f"key-file={simulator.key_file}", f"udp:{simulator.address}"
        with page_of(PROGRAMS, folder, WORK) as (_, plain), page_of(PROGRAMS, folder, WORK, "--device", "inproc", "--device", f"{device},{key},simulated",
                                                                    "--device", f"{DEAD},{key}") as (_, given):
            drive("drive_devices.mjs", {**given, "plain_link": plain["link"], "device": device, "dead": DEAD, "secret": str(WORK)})
    return outcome()


sys.exit(main())
