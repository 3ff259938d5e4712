# SPDX-License-Identifier: Apache-2.0
"""console_trouble_test.py SOURCE PROGRAMS ASSET WORK: what the console says of sessions in trouble. A session that hangs, an emergency stop
during a recovery, a full disk, a start that fails, a scene with broken JSON, and an audience that is large."""
import json
import math
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import time

from console_client import Closed, Console, container
from console_server_test import add_outside, make_folder, newest, start
from e2e import check, outcome
from exported import rows_of


def begin(console, scene="scenes/three_slices.json", **what):
    """The Live of a session that has begun."""
    live = console.live()
    start(console, live, scene=scene, **what)
    check(live.until(lambda l: l.values and l.state() == "running"), f"{scene} does not run: {live.states[-1:]}")
    return live


def end(console, live):
    console.post("/api/command", {"command": "stop"})
    check(live.until(lambda l: l.state() in ("ended", "lost")), f"no end: {live.states[-1]}")
    live.close()


def test_hung_session(console):
    live = begin(console, duration_s=60)
    pid = live.hello["pid"]
    os.kill(pid, signal.SIGSTOP)
    began = time.monotonic()
    check(live.until(lambda l: l.state() == "silent", 5), f"a stopped session is {live.state()}")
    took_s = time.monotonic() - began
    print(f"a stopped session is called silent after {1000 * took_s:.0f} ms")
    check("0.2 s" in live.states[-1]["message"], f"{live.states[-1]}")
    check(console.post("/api/start", {"scene": "scenes/one_slice.json"})[0] == 409, "a start beside a silent session")
    os.kill(pid, signal.SIGCONT)
    check(live.until(lambda l: l.state() == "running", 5), f"a session that goes on is {live.state()}")
    # A page that comes later gets what has been.
    check(live.until(lambda l: l.value("t_s") > 0.5, 5), "no half second")
    late = console.live()
    check(late.until(lambda l: l.history and l.values, 5), "a later page gets no history")
    times = [t_s for t_s, _, _ in late.history]
    check(times == sorted(times) and times[0] < 0.1 and times[-1] <= late.value("t_s"), f"times of the history: {times[:2]}..{times[-2:]}")
    check(len(times) > 10, f"{len(times)} points of the history")
    check(all(0 <= force_N < 200 and 0.05 < z_m < 0.25 for _, force_N, z_m in late.history),
          f"numbers of the history: {late.history[:2]}, {late.history[-2:]}, {max(force_N for _, force_N, _ in late.history)} N")
    late.close()
    # A pause is no silence.
    console.post("/api/command", {"command": "pause"})
    check(live.until(lambda l: l.state() == "paused", 5), f"{live.state()}")
    check(not live.until(lambda l: l.state() == "silent", 1), "a pause counts as silence")
    console.post("/api/command", {"command": "resume"})
    # The emergency stop ends a session that hangs.
    check(live.until(lambda l: l.state() == "running", 5), f"{live.state()}")
    os.kill(pid, signal.SIGSTOP)
    check(live.until(lambda l: l.state() == "silent", 5), f"{live.state()}")
    console.post("/api/emergency_stop")
    check(live.until(lambda l: l.state() == "lost", 5), f"after an emergency stop a hung session is {live.state()}")
    live.close()


def test_session_that_hangs_in_a_pause(console):
    """It is silent, too, and the emergency stop ends it."""
    live = begin(console, duration_s=60)
    console.post("/api/command", {"command": "pause"})
    check(live.until(lambda l: l.state() == "paused", 5), f"{live.state()}")
    os.kill(live.hello["pid"], signal.SIGSTOP)
    check(live.until(lambda l: l.state() == "silent", 5), f"a session that was stopped in a pause is {live.state()}")
    console.post("/api/emergency_stop")
    check(live.until(lambda l: l.state() == "lost", 5), f"after an emergency stop it is {live.state()}")
    live.close()


def test_stop_while_starting(console):
    """No session begins after a stop that came before it had begun; the state says how to start the same again."""
    for device in ("inproc", "sim"):
        live = console.live()
        check(live.until(lambda l: l.states), "no state")
        states = len(live.states)
        what = {"scene": "scenes/three_slices.json", "device": device, "duration_s": 60, "clock": "real"}
        check(console.post("/api/start", what)[0] == 200, "the start")
        status, answer = console.post("/api/command", {"command": "stop"})
        check(status == 200, f"a stop at once, device {device}: {status} {answer}")
        check(live.until(lambda l: l.state() in ("idle", "ended"), 10), f"{live.state()}")
        check(not live.until(lambda l: l.state() == "running", 2), "a session began after its stop")
        requests = [state.get("request") for state in live.states[states:] if state["state"] == "starting"]
        check(requests == [what], f"how to start the same again: {requests}")
        live.close()


def test_stop_in_recovery(console):
    """The emergency stop is latched during a recovery, too: it has an event, and recovery begins again only after its release."""
    live = begin(console, duration_s=60)
    safety = {name: number for number, name in enumerate(live.hello["safety_states"])}
    faults = live.hello["faults"]
    check(live.until(lambda l: l.value("tip_N") > 5), "no contact")
    console.post("/api/command", {"command": "pause"})
    check(live.until(lambda l: l.value("paused") == 1), "no pause")
    console.post("/api/command", {"command": "resume"})
    check(live.until(lambda l: l.value("safety") == safety["recovering"]), f"no recovery: {live.value('safety')}")
    console.post("/api/emergency_stop")
    check(live.until(lambda l: any(event.get("fault") == "emergency_stop" for event in l.events), 5), "no event of the emergency stop")
    check(live.until(lambda l: l.value("safety") == safety["fault"], 5), "the stop is not latched")
    check(faults[int(live.value("fault"))] == "emergency_stop", f"the fault is {faults[int(live.value('fault'))]}")
    time.sleep(0.5)
    check(live.until(lambda l: l.value("safety") == safety["fault"], 1), "the stop was released by nobody")
    console.post("/api/command", {"command": "recover"})
    check(live.until(lambda l: l.value("safety") != safety["fault"], 5), "the stop is not released")
    end(console, live)


def test_pause_is_no_fault(console, folder):
    add_outside(folder, duration_s=60)
    live = begin(console, "scenes/outside.json")
    running = live.hello["safety_states"].index("running")
    for take, give_back in (("pause", "resume"), ("zero", "recover")):
        check(live.until(lambda l: l.value("safety") == running), f"not running before {take}")
        console.post("/api/command", {"command": take})
        check(live.until(lambda l: l.value("safety") != running), f"{take} has no effect")
        console.post("/api/command", {"command": give_back})
    check(live.until(lambda l: l.value("safety") == running), "not running at the end")
    end(console, live)
    report = json.loads((newest(folder) / "session.json").read_text())
    check(report["faults_count"] == 0 and report["faults"] == [] and report["operator_stops_count"] == 2,
          f"the report has {report['faults_count']} faults and {report.get('operator_stops_count')} stops")


def test_failed_start(console, folder):
    """Nothing of the session before is left when a start fails."""
    live = begin(console, duration_s=1)
    check(live.until(lambda l: l.state() == "ended"), "no end")
    lost = json.loads((folder / "scenes/one_slice.json").read_text())
    lost["asset"] = "../no_such.glb"
    (folder / "scenes/lost.json").write_text(json.dumps(lost))
    check(console.post("/api/start", {"scene": "scenes/lost.json"})[0] == 200, "the start")
    check(live.until(lambda l: l.state() == "ended" and "exit code 3" in l.states[-1]["message"], 10), f"{live.states[-1]}")
    check(live.hello is None, "the session before is still shown")
    check("no_such.glb" in live.states[-1]["message"], f"{live.states[-1]}")
    check(str(folder) not in json.dumps(live.states), "an absolute path")
    status, answer = console.get("/api/bone?scene=scenes/lost.json")
    check(status == 422 and "no_such.glb" in answer["error"] and str(folder) not in answer["error"], f"the bone of a lost asset: {status} {answer}")
    live.close()

    def is_missing():
        scenes = {scene["file"]: scene for scene in console.get("/api/folder")[1]["scenes"]}
        return scenes["scenes/lost.json"].get("asset_missing", False)

    check(is_missing(), "a lost asset is not said to be missing")
    shutil.copy(folder / "scenes" / json.loads((folder / "scenes/one_slice.json").read_text())["asset"], folder / "no_such.glb")
    check(not is_missing(), "an asset that was put back is said to be missing")
    (folder / "no_such.glb").unlink()
    check(is_missing(), "an asset that was taken away is not said to be missing")
    late = console.live()
    check(late.until(lambda l: l.states) and late.hello is None, "a page that comes later sees the session before")
    late.close()


def test_broken_scene(console, folder):
    (folder / "scenes/broken.json").write_text("{")
    listed = {scene["file"]: scene for scene in console.get("/api/folder")[1]["scenes"]}
    check("error" in listed.get("scenes/broken.json", {}), f"a scene with broken JSON: {listed.get('scenes/broken.json')}")
    (folder / "scenes/broken.json").unlink()


def test_places(console):
    """Sixteen pages of an audience, and more that wait: an operator still has a place."""
    audience = [console.live(token=console.view) for _ in range(16)]
    for page in audience:
        check(page.next() == "hello", "sixteen pages watch")
    seventeenth = console.live(token=console.view)
    try:
        seventeenth.until(lambda l: False, 5)
        check(False, "a seventeenth audience has a place")
    except Closed as closed:
        check(closed.args[0] in (1013, "end of stream"), f"the seventeenth is closed by {closed}")
    operators = [console.live() for _ in range(8)]
    for page in operators:
        check(page.next() == "hello", "an operator has no place")
    audience.pop().close()
    check(any(console_has_place(console) for _ in range(20)), "a place that became free is not given")
    for page in audience + operators:
        page.close()


def console_has_place(console):
    page = console.live(token=console.view)
    try:
        return page.next(5) == "hello"
    except Closed:
        time.sleep(0.1)
        return False
    finally:
        page.close()


def test_tunnel(programs, source, folder):
    """A browser behind a tunnel states another port as its host."""
    def ask(console, path):
        return console.get(path, headers={"Host": "localhost:8080", "Origin": "http://localhost:8080"}, raw=True)

    console = Console(programs / "trocar-console", folder, page=source / "runtime/console/page", stderr=subprocess.DEVNULL)
    status, answer = ask(console, "/")
    check(status == 421 and b"--public-url" in answer and not answer.startswith(b"{"), f"through a tunnel: {status} {answer}")
    status, answer = ask(console, "/api/folder")
    check(status == 421 and json.loads(answer)["ok"] is False, f"through a tunnel, below /api/: {status} {answer}")
    console.stop()
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    console = Console(programs / "trocar-console", folder, "--public-url", "http://localhost:8080", page=source / "runtime/console/page", port=port)
    check((console.host, console.port) == ("127.0.0.1:8080", 8080), f"the links have {console.host}")
    console.port = port  # where the tunnel ends
    check(ask(console, "/")[0] == 200 and ask(console, "/api/folder")[0] == 200, "through a tunnel with --public-url")
    check(console.get("/api/folder", headers={"Host": "localhost:8081"})[0] == 421, "another tunnel")
    check(console.get("/api/folder", headers={"Host": f"127.0.0.1:{port}"})[0] == 200, "without the tunnel")
    console.stop()


def console_on_small_disk(programs, source, folder, work, size):
    """A console whose folder, with its log, is on a disk of this size, and that folder; None if this machine allows no file system of one's own."""
    disk = work / "disk"
    disk.mkdir(exist_ok=True)
    inside = ["unshare", "-rm", "sh", "-c", f'mount -t tmpfs -o size={size} tmpfs "{disk}" && exec "$@"', "sh"]
    if subprocess.run([*inside, "true"], capture_output=True, check=False).returncode != 0:
        print("a full disk was not tried: this machine allows no file system of one's own")
        return None
    wrapper = work / "console_on_disk"
    wrapper.write_text("#!/bin/sh\n" + f'cp -r "{folder}/scenes" "{folder}/sample.glb" "{disk}/"\n' +
                       f'exec "{programs / "trocar-console"}" "{disk}" "$@"\n')
    wrapper.chmod(0o755)
    start = work / "start_on_disk"
    start.write_text("#!/bin/sh\nexec " + " ".join(f"'{word}'" for word in inside) + f' "{wrapper}" "$@"\n')
    start.chmod(0o755)
    console = Console(start, page=source / "runtime/console/page", stderr=subprocess.DEVNULL)
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


def test_full_disk(programs, source, folder, work, device):
    """The log is on the full disk, too. The page warns, then has the reason within a second of the last free byte, and the recording is whole."""
    made = console_on_small_disk(programs, source, folder, work, "8m")
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
    replayed = subprocess.run([programs / "trocar-run", "replay", folder / "scenes/one_slice.json", "--asset", folder / "sample.glb", disk / name], capture_output=True, text=True, check=False)
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


def main():
    source, programs, asset, work = map(pathlib.Path, sys.argv[1:5])
    folder = make_folder(source, asset, work)
    console = Console(programs / "trocar-console", folder, page=source / "runtime/console/page")
    try:
        test_hung_session(console)
        test_session_that_hangs_in_a_pause(console)
        test_stop_while_starting(console)
        test_stop_in_recovery(console)
        test_pause_is_no_fault(console, folder)
        test_failed_start(console, folder)
        test_broken_scene(console, folder)
        test_places(console)
    finally:
        check(console.stop() == 0, "the console's exit code")
    test_tunnel(programs, source, folder)
    for device in ("inproc", "sim"):
        test_full_disk(programs, source, folder, work, device)
    shutil.rmtree(work / "disk", ignore_errors=True)
    return outcome()


if __name__ == "__main__":
    sys.exit(main())
