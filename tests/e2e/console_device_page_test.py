# SPDX-License-Identifier: Apache-2.0
"""console_device_page_test.py SOURCE PROGRAMS ASSET WORK: the choice and the test of a device in the console's page, in a headless Chromium
(console/drive_devices.mjs), with trocar-device-sim as the device."""
import pathlib
import sys

from chromium_page import drive, need_browser, page_of
from console_server_test import add_outside, make_folder
from device_link_e2e_test import Simulator
from e2e import outcome

SOURCE, PROGRAMS, ASSET, WORK = (pathlib.Path(word).resolve() for word in sys.argv[1:5])
DEAD = "udp:127.0.0.1:9"  # nobody answers there


def main():
    need_browser()
    folder = make_folder(SOURCE, ASSET, WORK)
    scene = add_outside(folder, duration_s=60)
    add_outside(folder, "live", duration_s=60, hand={"live": True, "trajectory": scene["hand"]["trajectory"][:1]})
    (WORK / "keys").mkdir()
    with Simulator(PROGRAMS, WORK / "keys", folder / "scenes/outside.json", "--watchdog", "0.25") as simulator:
        key, device = f"key-file={simulator.key_file}", f"udp:{simulator.address}"
        with page_of(PROGRAMS, folder, WORK) as (_, plain), page_of(PROGRAMS, folder, WORK, "--device", "inproc", "--device", f"{device},{key},simulated",
                                                                    "--device", f"{DEAD},{key}") as (_, given):
            drive("drive_devices.mjs", {**given, "plain_link": plain["link"], "device": device, "dead": DEAD, "secret": str(WORK)})
    return outcome()


sys.exit(main())
