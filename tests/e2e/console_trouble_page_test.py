# SPDX-License-Identifier: Apache-2.0
"""console_trouble_page_test.py SOURCE PROGRAMS ASSET WORK: what the console's page shows of sessions in trouble, and that its keys do no harm,
in a headless Chromium (console/drive_trouble.mjs); that the emergency stop and Restart do what they say (console/drive_rescue.mjs); and pages that the console cannot serve as usual (console/drive_outside.mjs)."""
import json
import pathlib
import shutil
import socket
import sys
import threading

from chromium_page import PAGE, drive, links_of, need_browser, page_of
from console_client import Closed, Console
from console_server_test import add_outside, make_folder
from console_trouble_test import console_on_small_disk
from e2e import check, outcome

SOURCE, PROGRAMS, ASSET, WORK = (pathlib.Path(word).resolve() for word in sys.argv[1:5])


def copy_bytes(source, target):
    try:
        while data := source.recv(65536):
            target.sendall(data)
    except OSError:
        pass
    for each in (source, target):
        each.close()


def tunnel_to(port):
    """A port whose connections are passed on to `port`."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve():
        while True:
            near = server.accept()[0]
            far = socket.create_connection(("127.0.0.1", port))
            for pair in ((near, far), (far, near)):
                threading.Thread(target=copy_bytes, args=pair, daemon=True).start()

    threading.Thread(target=serve, daemon=True).start()
    return server.getsockname()[1]


def watch(page):
    try:
        page.until(lambda live: False, 600)
    except (Closed, OSError):
        pass


def check_outside(folder):
    console = Console(PROGRAMS / "trocar-console", folder, page=PAGE)
    audience = [console.live(token=console.view) for _ in range(16)]
    check(all(page.next() == "hello" for page in audience), "sixteen pages watch")
    for page in audience:  # each answers the console's pings until the console ends
        threading.Thread(target=watch, args=(page,), daemon=True).start()
    made = console_on_small_disk(PROGRAMS, SOURCE, folder, WORK, "4m")
    small = made[0] if made else None
    links = links_of(console)
    drive("drive_outside.mjs", {"full_link": links["link"], "full_view_link": links["view_link"], "tunnel": f"http://localhost:{tunnel_to(console.port)}/",
                                "disk_link": links_of(small)["link"] if small else None, "out": str(WORK / "pictures")})
    for each in filter(None, (console, small)):
        check(each.stop() == 0, "a console did not end as it should")
    shutil.rmtree(WORK / "disk", ignore_errors=True)


def main():
    need_browser()
    folder = make_folder(SOURCE, ASSET, WORK)
    lost = json.loads((folder / "scenes/one_slice.json").read_text(encoding="utf-8"))
    lost |= {"name": "Lost asset", "asset": "../no_such.glb"}
    (folder / "scenes/lost.json").write_text(json.dumps(lost), encoding="utf-8")
    (folder / "scenes/broken.json").write_text("{", encoding="utf-8")
    add_outside(folder, duration_s=600, goals={"target": {"at_m": [0, 0, 0.11], "radius_m": 0.003}})
    with page_of(PROGRAMS, folder, WORK) as (console, given):
        drive("drive_trouble.mjs", given)
        drive("drive_rescue.mjs", {**given, "pid": console.process.pid})
    check_outside(folder)
    return outcome()


sys.exit(main())
