# SPDX-License-Identifier: Apache-2.0
"""A full disk under the console's folder and log, and a console behind a tunnel. (Sessions that hang, stops while others begin or recover, failed
starts, large audiences: console/drive_trouble.mjs, drive_rescue.mjs, drive_outside.mjs.)"""
import json
import math
import os
import pathlib
import shutil
import socket
import subprocess
import time

import pytest

from chromium_page import PAGE
from console_client import Console, container
from console_server_test import CONSOLE, make_folder, start
from e2e import check
from exported import rows_of
from programs import PROGRAMS, WORK


@pytest.fixture(name="folder", scope="module")
def folder_of_scenes():
    yield make_folder()
    shutil.rmtree(WORK / "disk", ignore_errors=True)


def test_public_url(folder):
    """A browser behind a tunnel states another port as its host."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    console = Console(CONSOLE, folder, "--public-url", "http://localhost:8080", page=PAGE, port=port)
    check((console.host, console.port) == ("127.0.0.1:8080", 8080), f"the links have {console.host}")
    console.port = port  # where the tunnel ends
    check(console.get("/api/folder", headers={"Host": "localhost:8080", "Origin": "http://localhost:8080"})[0] == 200, "through the tunnel")
    check(console.get("/api/folder", headers={"Host": "localhost:8081"})[0] == 421, "another tunnel")
    console.stop()


def begin(console, scene="scenes/three_slices.json", **what):
    """The Live of a session that has begun."""
    live = console.live()
    start(console, live, scene=scene, **what)
    check(live.until(lambda l: l.values and l.state() == "running"), f"{scene} does not run: {live.states[-1:]}")
    return live


def console_on_small_disk(folder, size):
    """A console whose folder, with its log, is on a disk of this size, and that folder; None if this machine allows no file system of one's own."""
    disk = WORK / "disk"
    disk.mkdir(exist_ok=True)
    inside = ["unshare", "-rm", "sh", "-c", f'mount -t tmpfs -o size={size} tmpfs "{disk}" && exec "$@"', "sh"]
    if subprocess.run([*inside, "true"], capture_output=True, check=False).returncode != 0:
        print("a full disk was not tried: this machine allows no file system of one's own")
        return None
    wrapper = WORK / "console_on_disk"
    wrapper.write_text("#!/bin/sh\n" + f'cp -r "{folder}/scenes" "{folder}/sample.glb" "{disk}/"\n' +
                       f'exec "{CONSOLE}" "{disk}" "$@"\n')
    wrapper.chmod(0o755)
    start = WORK / "start_on_disk"
    start.write_text("#!/bin/sh\nexec " + " ".join(f"'{word}'" for word in inside) + f' "{wrapper}" "$@"\n')
    start.chmod(0o755)
    console = Console(start, page=PAGE, stderr=subprocess.DEVNULL)
    return console, pathlib.Path(f"/proc/{console.process.pid}/root{disk}")


def free_bytes(disk):
    status = os.statvfs(disk)
    return status.f_bavail * status.f_frsize


def fill(disk, leave):
    """Another process takes the space of the disk, except for the bytes to leave."""
    with open(disk / "other", "ab", buffering=0) as other:
        os.posix_fallocate(other.fileno(), 0, free_bytes(disk) - leave)


def check_forces_of(rows, device):
    """The forces fall by the ramp in the ticks that see that nothing can be recorded, and the rows go on to the end."""
    first = next(i for i, row in enumerate(rows) if row["outside_fault"] == "recording_failed")
    force = [math.hypot(*(float(row[f"f{axis}_delivered_N"]) for axis in "xyz")) for row in rows]
    before, after = force[first - 1], force[first:]
    steps = [a - b for a, b in zip(force[first - 1:], after)]
    check(before > 1 and after[-1] == 0 and len(after) <= 6 and max(steps) < 0.35 * before, f"forces at the end: {before}, then {after}")
    check({row["outside_fault"] for row in rows[first - 1:]} <= {"none", "recording_failed"}, "the device was lost at the end")
    if device == "inproc":  # the packets of a device process may be late for a tick
        check(all(row["device_read"] == row["device_write"] == "ok" for row in rows[first - 1:]), "the device did not answer at the end")


@pytest.mark.parametrize("device, size", [("inproc", "4m"), ("sim", "8m"), ("sim", "64m")])
def test_full_disk(folder, device, size):
    """The log is on the full disk, too. The page warns, then has the reason within a second of the last free byte, and the recording is whole."""
    made = console_on_small_disk(folder, size)
    if made is None:
        return
    console, disk = made
    live = begin(console, "scenes/one_slice.json", duration_s=60, device=device)
    check(live.until(lambda l: math.isfinite(l.value("recording_left_s")), 5), "the space on the disk is not stated")
    left_s, fits_s = live.value("recording_left_s"), free_bytes(disk) / 1e6
    check(0.3 * fits_s < left_s < 3 * fits_s, f"{left_s} s of recording fit, and {fits_s} MB are free")
    check(live.until(lambda l: l.value("tip_N") > 5), "no contact")
    fill(disk, 300_000)  # a third of a second
    filled_t_s, filled_at = live.value("t_s"), time.monotonic()
    check(live.until(lambda l: l.state() == "ended", 60), f"a full disk ends nothing: {live.states[-1]}")
    took_s, ended = time.monotonic() - filled_at, live.events[-1]
    print(f"full disk, {device}: the page had the reason after {took_s:.2f} s: {live.states[-1]['message']}")
    check(took_s < 1.5 and ended["t_s"] - filled_t_s < 1, f"the session ended {took_s} s after the disk was nearly full, {ended}")
    check(live.states[-1].get("exit_code") == 4 and "No space left on device" in live.states[-1]["message"], f"a full disk: {live.states[-1]}")
    check((ended["kind"], ended["end"], ended["fault"]) == ("ended", "interrupted", "recording_failed"), f"a full disk: {ended}")
    check([event["fault"] for event in live.events if event["kind"] == "fault"] == ["recording_failed"], f"a full disk: {live.events}")
    name = live.states[-1].get("recording", "none")
    check(name.endswith("/session.csv") and live.states[-1].get("report", "").endswith("/session.html"), f"a full disk: {live.states[-1]}")
    rows = rows_of(disk / name)
    check(abs(float(rows[-1]["t_s"]) - ended["t_s"]) < 1e-9, f"the recording ends at {rows[-1]['t_s']} s, and the session at {ended['t_s']} s")
    check_forces_of(rows, device)
    head, _ = container(console.get(f"/api/recording?file={name}")[1])
    check(head["rows"] == len(rows) and head["is_cut"] is False, f"playback of {head['rows']} rows of {len(rows)}")
    check(json.loads((disk / name).with_suffix(".json").read_text())["end"] == "interrupted", "the report")
    replayed = subprocess.run([PROGRAMS / "trocar-run", "replay", folder / "scenes/one_slice.json", "--asset", folder / "sample.glb", disk / name], capture_output=True, text=True, check=False)
    check(replayed.returncode == 0 and "identical" in replayed.stdout, f"the replay: {replayed}")
    # Nothing fits any more, and the next session says so before it begins.
    fill(disk, 0)
    live.close()
    late = console.live()
    check(late.until(lambda l: l.states), "no state")
    status, answer = console.post("/api/start", {"scene": "scenes/one_slice.json", "device": device})
    said = answer.get("error", "") if status == 409 else late.until(lambda l: l.state() in ("ended", "idle") and len(l.states) > 1, 10) and late.states[-1]["message"]
    check(isinstance(said, str) and "No space left" in said, f"a start on a full disk: {status} {answer} {late.states[-1]}")
    late.close()
    console.stop()
