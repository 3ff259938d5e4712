# SPDX-License-Identifier: Apache-2.0
"""The console's server as a page uses it: the folder with valid and damaged files, the bone, sessions with their events and commands, roles, the
emergency stop, a console that is killed and started again, a session and a device process that are killed."""
import base64
import hashlib
import json
import os
import pathlib
import re
import shutil
import signal
import struct
import subprocess
import time

import pytest

from chromium_page import PAGE
from console_client import Console, container
from e2e import check
from exported import rows_of
from programs import ASSETS, PROGRAMS, SOURCE, WORK

CONSOLE = PROGRAMS / "trocar-console"
RAMP_S = 0.004  # kRampMax_s of runtime/haptics/loop/safety.h
RUNNING = 2  # SafetyState


def make_folder():
    """A folder with the sample's asset and scenes of it."""
    folder = WORK / "folder"
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "scenes").mkdir(parents=True)
    shutil.copy(ASSETS / "sample.glb", folder / "sample.glb")
    for name in ("one_slice", "three_slices", "vertebra"):
        scene = json.loads((SOURCE / "runtime/scenes" / f"{name}.json").read_text())
        scene["asset"] = "../sample.glb"
        (folder / "scenes" / f"{name}.json").write_text(json.dumps(scene))
    return folder


def add_outside(folder, name="outside", **fields):
    """A scene in which the tool stays above the bone, so that each recovery is granted."""
    scene = json.loads((folder / "scenes/one_slice.json").read_text())
    scene["hand"]["trajectory"] = scene["hand"]["trajectory"][:2]
    (folder / f"scenes/{name}.json").write_text(json.dumps(scene | fields))
    return scene


@pytest.fixture(name="folder", scope="module")
def folder_of_scenes():
    return make_folder()


@pytest.fixture(name="console")
def started_console(folder):
    console = Console(CONSOLE, folder, page=PAGE, stderr=subprocess.DEVNULL)
    yield console
    console.stop()


def spoil(folder):
    (folder / "wrong.json").write_text('{"schema": "trocar.scene/1", "nothing": 1}')
    (folder / "cut.json").write_text('{"schema": "trocar.scene/1", "na')
    (folder / "other.json").write_text('{"schema": "something"}')
    (folder / "broken.glb").write_bytes(b"glTF" + bytes(40))
    (folder / "huge.glb").write_bytes(struct.pack("<4sIIII", b"glTF", 2, 2**31, 2**31 - 20, 0x4E4F534A))
    (folder / "cut.csv").write_text("t_s,x_m,y_m\n0,0,0\n1,")
    (folder / "empty.csv").write_text("t_s,x_m,y_m\n")
    (folder / "table.csv").write_text("a,b\n1,2\n")
    os.symlink("/etc/passwd", folder / "link.json")
    os.symlink("/", folder / "root")
    os.mkfifo(folder / "pipe.json")
    deep = folder / "a/b/c"
    deep.mkdir(parents=True)
    (deep / "deep.json").write_text((folder / "scenes/one_slice.json").read_text())


def test_bone(console):
    head, arrays = container(console.get("/api/bone?scene=scenes/three_slices.json")[1])
    check(head["schema"] == "trocar.bone/1" and [s["slice"] for s in head["slices"]] == [21, 17, 13], f"bone: {head['slices']}")
    for part in head["slices"]:
        offset, count = part["vertices"]
        places = struct.unpack_from(f"<{count}f", arrays, offset)
        at, corners = part["triangles"]
        triangles = struct.unpack_from(f"<{corners}I", arrays, at)
        check(max(triangles) < count // 2 and all(abs(x) < 0.2 for x in places), f"slice {part['slice']}: places or triangles")
        twice = sum((places[2 * b] - places[2 * a]) * (places[2 * c + 1] - places[2 * a + 1]) -
                    (places[2 * c] - places[2 * a]) * (places[2 * b + 1] - places[2 * a + 1])
                    for a, b, c in zip(*[iter(triangles)] * 3))
        check(4e-4 < twice / 2 < 4e-3, f"slice {part['slice']}: area {twice / 2} m^2")
    check(len(head["tool"]["outline_m"]) == 6 and abs(head["tool"]["radius_m"] - 0.003) < 1e-9, f"tool: {head['tool']}")
    head, arrays = container(console.get("/api/bone?scene=scenes/vertebra.json")[1])
    heights = [s["z_m"] for s in head["slices"]]
    check(len(heights) == 35 and heights == sorted(heights, reverse=True) and head["slices"][0]["hu"], "bone of a body")


def newest(folder):
    return max((p for p in (folder / "sessions").iterdir() if p.is_dir()), key=lambda p: p.stat().st_mtime_ns)


def start(console, live, **what):
    check(live.until(lambda l: l.hellos > 0), "no hello")
    before = live.session
    status, answer = console.post("/api/start", what)
    check(status == 200 and answer == {"ok": True}, f"start {what}: {status} {answer}")
    check(live.until(lambda l: l.session not in (before, "")), f"no hello after start {what}: {live.states[-1:]}")


def test_virtual(console, folder):
    live = console.live(console.view)
    start(console, live, scene="scenes/three_slices.json", clock="virtual", duration_s=7)
    check(console.post("/api/start", {"scene": "scenes/one_slice.json"})[0] == 409 or live.until(lambda l: l.state() == "ended"),
          "a second start is granted")
    check(live.until(lambda l: l.state() in ("ended", "lost"), 60) and live.state() == "ended", f"states: {live.states}")
    check([e["seq"] for e in live.events] == list(range(1, len(live.events) + 1)) and not live.missed, f"events: {live.events}")
    punctures = [e for e in live.events if e["kind"] == "puncture"]
    check([e["slice"] for e in punctures] == [21, 17, 13] and live.kinds()[-1] == "ended", f"events: {live.kinds()}")
    check(live.until(lambda l: len(l.sheets) == 3, 5) and all(s["cuts"] == 1 and s["vertices"] > 0 for s in live.sheets.values()),
          f"sheets: {[(k, s['cuts']) for k, s in live.sheets.items()]}")
    recording = newest(folder) / "session.csv"
    check(recording.exists() and live.states[-1].get("recording") == str(recording.relative_to(folder)), f"{live.states[-1]}")
    live.close()
    # A page that comes later gets the same, and one that has seen events the rest.
    later = console.live(session=live.session, last_event=punctures[0]["seq"])
    check(later.until(lambda l: l.events and l.kinds()[-1] == "ended", 5) and later.events == live.events[punctures[0]["seq"]:],
          f"later: {later.kinds()}")
    check(later.until(lambda l: len(l.sheets) == 3, 5), "a later page gets no sheets")
    later.close()
    other = console.live(session="another", last_event=10**9)
    check(other.until(lambda l: len(l.events) == len(live.events), 5), "events after another session's number")
    other.close()
    # The list and the rows.
    shown = console.get("/api/folder")[1]
    name = str(recording.relative_to(folder))
    listed = [r for r in shown["recordings"] if r["file"] == name]
    table = rows_of(recording)
    check(listed and listed[0].get("scene") == "scenes/three_slices.json" and listed[0]["ticks"] == len(table), f"{listed} {len(table)}")
    head, arrays = container(console.get(f"/api/recording?file={name}")[1])
    width = sum(c["count"] for c in head["columns"])
    offset, count = head["rows_at"]
    check(head["rows"] == len(table) and count == head["rows"] * width and len(arrays) == offset + 8 * count, f"rows: {head['rows']}")
    middle = len(table) // 2
    row = struct.unpack_from(f"<{width}d", arrays, offset + 8 * width * middle)
    check(row[0] == float(table[middle]["t_s"]) and row[3] == float(table[middle]["z_m"]), "a row of the recording")
    check([e["slice"] for e in head["events"] if e["kind"] == "puncture"] == [21, 17, 13], f"{head['events']}")


def test_commands(console, folder):
    live, audience = console.live(), console.live(console.view)
    start(console, live, scene="scenes/one_slice.json", duration_s=60)
    check(audience.until(lambda l: l.hello is not None) and audience.role == "view" and live.role == "operator", "roles")
    check(live.until(lambda l: l.values and l.value("t_s") > 0.2), "no snapshots")
    t_s = live.value("t_s")
    check(live.until(lambda l: l.value("t_s") > t_s + 0.2, 5), "time does not advance")
    for command in ("stop", "pause", "resume", "zero", "recover"):
        status, _ = console.post("/api/command", {"command": command}, token=console.view)
        check(status == 403, f"an audience commands {command}: {status}")
    for body in ({"command": "emergency_stop"}, {"command": 1}, {}, [], "{", {"command": "stop", "x": 1}):
        check(console.post("/api/command", body if isinstance(body, str) else json.dumps(body))[0] == 400, f"command {body}")
    take = lambda what, **keys: console.post("/api/xray", {"take": what}, **keys)[0]
    for body in ({"take": "x"}, {"take": 1}, {}, [], {"take": "shot", "x": 1}):
        check(console.post("/api/xray", json.dumps(body))[0] == 400, f"X-ray {body}")
    check((take("shot"), take("shot", token=console.view)) == (200, 403), "who takes a picture")
    check(console.post("/api/command", {"command": "pause"})[0] == 200 and live.until(lambda l: l.state() == "paused", 5),
          f"pause: {live.states[-1]}")
    check((take("shot"), take("screening"), take("nothing")) == (409, 409, 200), "a picture in a pause")
    check(not live.until(lambda l: l.state() == "silent", 1), "a pause counts as silence")
    check(live.until(lambda l: all(x == 0 for x in l.array("tau_Nm")), 5), "torques while paused")
    check("paused" in live.kinds() or live.until(lambda l: "paused" in l.kinds(), 5), f"{live.kinds()}")
    check(console.post("/api/command", {"command": "resume"})[0] == 200 and live.until(lambda l: l.state() == "running", 5),
          f"resume: {live.states[-1]}")
    check(live.until(lambda l: "recovered" in l.kinds(), 5), f"recovered after a pause: {live.events}")
    faults = live.kinds().count("fault")
    check(console.post("/api/command", {"command": "zero"})[0] == 200 and live.until(lambda l: l.kinds().count("fault") > faults, 5) and
          live.events[-1]["fault"] == "forces_off", f"zero: {live.events[-1]}")
    t_s = live.value("t_s")
    check(live.until(lambda l: l.value("t_s") > t_s + 0.1, 5) and not any(live.array("tau_Nm")), "after zero")
    recovered = live.kinds().count("recovered")
    check(console.post("/api/command", {"command": "recover"})[0] == 200 and
          live.until(lambda l: l.kinds().count("recovered") > recovered, 5), "recover after zero")
    check(console.post("/api/command", {"command": "stop"})[0] == 200 and live.until(lambda l: l.state() == "ended", 10),
          f"stop: {live.states[-1]}")
    check(live.kinds()[-1] == "ended" and live.events[-1]["end"] == "interrupted", f"{live.events[-1]}")
    check(audience.until(lambda l: l.state() == "ended" and l.events == live.events, 5), f"the audience: {audience.session} {live.session} {audience.states[-1:]} {audience.kinds()} {live.kinds()}")
    check(b"forces_off" in console.get("/api/log", raw=True)[1] and take("shot") == 409, "the log; a picture after the end")
    told = json.loads((newest(folder) / "session.json").read_text())
    check(told["faults"] == [] and told["operator_stops_count"] == 2, f"pause and zero are faults: {told['faults']}, {told['operator_stops_count']} stops")
    report = live.states[-1].get("report", "")
    status, page = console.get(f"/api/report?file={report}")
    policy = console.headers["Content-Security-Policy"]
    check(status == 200 and b"</html>" in page and "sandbox allow-scripts;" in policy, f"report {report}: {status}, {policy}")
    script = re.search(rb"<script>(.*?)</script>", page, re.S)[1]
    allowed = f"'sha256-{base64.b64encode(hashlib.sha256(script).digest()).decode()}'"
    check(allowed in policy and re.search(r"script-src( 'sha256-\S+'){2};", policy),
          f"report: the policy allows other scripts than those of report and history: {policy}")
    console.get("/")
    check(allowed in console.headers["Content-Security-Policy"], "the page's policy does not allow the report's script")
    for page in (live, audience):
        page.close()


def test_emergency_stop(console, folder):
    live = console.live()
    # The tool presses on the slice from 0.5 s on.
    start(console, live, scene="scenes/one_slice.json", duration_s=30)
    check(live.until(lambda l: l.values and max(map(abs, l.array("tau_Nm"))) > 0.05, 10), "no torques to stop")
    begin = time.monotonic()
    status, answer = console.post("/api/emergency_stop", token=None)
    check(status == 200, f"emergency stop: {status} {answer}")
    check(live.until(lambda l: l.kinds() and l.kinds()[-1] == "fault", 5), f"{live.events}")
    check(live.until(lambda l: not any(l.array("tau_Nm")) and l.value("taken_at_s") > begin, 5), "torques after the emergency stop")
    print(f"page saw zero torques {1e3 * (live.value('taken_at_s') - begin):.1f} ms after its request")
    check(live.events[-1]["fault"] == "emergency_stop" and "operator" in live.events[-1]["meaning"], f"{live.events[-1]}")
    console.post("/api/command", {"command": "stop"})
    check(live.until(lambda l: l.state() == "ended", 10), f"{live.states[-1]}")
    rows = rows_of(newest(folder) / "session.csv")
    taus = [name for name in rows[0] if name.startswith("tau_")]
    saw = next((i for i, row in enumerate(rows) if row["outside_fault"] == "emergency_stop"), None)
    check(len(taus) == 8 and saw is not None, "the recording has no emergency stop")
    t_s, tick_s = float(rows[saw]["t_s"]), float(rows[1]["t_s"]) - float(rows[0]["t_s"])
    zero = next(i for i, row in enumerate(rows) if i >= saw and all(float(row[t]) == 0 for t in taus))
    check(any(abs(float(rows[saw - 1][t])) > 0.05 for t in taus), "torques were zero before")
    print(f"torques zero {1e3 * (float(rows[zero]['t_s']) - t_s):.1f} ms after the tick that saw the emergency stop")
    check(float(rows[zero]["t_s"]) - t_s <= RAMP_S + tick_s + 1e-9, "zero torques came late")
    check(all(float(row[t]) == 0 for row in rows[zero:] for t in taus), "torques after they were zero")
    live.close()


def test_killed_console(console, folder):
    live = console.live()
    start(console, live, scene="scenes/three_slices.json", duration_s=60)
    check(live.until(lambda l: "puncture" in l.kinds(), 20), "no puncture")
    session, seen, t_s = live.session, live.events[-1]["seq"], live.value("t_s")
    console.stop(signal.SIGKILL)
    live.close()
    time.sleep(0.3)
    other = Console(CONSOLE, folder, page=PAGE)
    again = other.live(session=session, last_event=seen)
    check(again.until(lambda l: l.values, 5) and again.session == session, f"the new console shows {again.session}, not {session}")
    check(again.until(lambda l: l.value("t_s") > t_s + 0.2, 5), "the session did not go on")
    check(again.until(lambda l: l.kinds().count("puncture") > 0, 20) and again.events[0]["seq"] == seen + 1,
          f"events after {seen}: {[e['seq'] for e in again.events]}")
    check(again.until(lambda l: 0 in l.sheets, 5), "the sheet that was cut before is missing")
    check(other.get("/api/bone?session=1")[0] == 200, "bone of an adopted session")
    check(other.post("/api/command", {"command": "stop"})[0] == 200 and again.until(lambda l: l.state() == "ended", 10),
          f"stop of an adopted session: {again.states}")
    again.close()
    other.stop()


def test_killed_session(console, folder):
    live = console.live()
    start(console, live, scene="scenes/one_slice.json", duration_s=60)
    os.kill(live.hello["pid"], signal.SIGKILL)
    check(live.until(lambda l: l.state() == "lost", 5) and "signal 9" in live.states[-1]["message"], f"{live.states}")
    check(console.post("/api/command", {"command": "stop"})[0] == 409, "a command to a dead session")
    start(console, live, scene="scenes/one_slice.json", duration_s=60)
    check(live.until(lambda l: l.values and l.state() == "running", 5), "no session after a lost one")
    # The process is stopped: an emergency stop must not wait for its ticks, and further ones must not give it more time.
    os.kill(live.hello["pid"], signal.SIGSTOP)
    stat, end = pathlib.Path(f"/proc/{live.hello['pid']}/stat"), time.monotonic() + 2
    while time.monotonic() < end:
        console.post("/api/emergency_stop", token=None)
        time.sleep(0.01)
    check(not stat.exists() or ") T " not in stat.read_text(), "a stopped process lives on while emergency stops come")
    check(live.until(lambda l: l.state() == "lost", 5), f"a stopped process: {live.states}")
    live.close()


def test_recording_of_killed_session(console, folder):
    """At most 0.2 s are missing. The page lists and plays what was recorded, and trocar-run replays it and makes its report."""
    live = console.live()
    start(console, live, scene="scenes/one_slice.json", duration_s=60)
    check(live.until(lambda l: l.values and l.value("t_s") > 1, 10), "no second")
    name = str((newest(folder) / "session.csv.partial").relative_to(folder))
    listed = lambda: [r for r in console.get("/api/folder")[1]["recordings"] if r["file"] == name]
    check(not listed(), "a recording that is being written is listed")
    os.kill(live.hello["pid"], signal.SIGKILL)
    check(live.until(lambda l: l.state() == "lost", 5) and live.states[-1].get("recording") == name, f"{live.states[-1]}")
    t_s = live.value("t_s")
    live.close()
    with open(folder / name, "ab") as file:  # as if it had been killed within a write
        file.write(b"99,0.1,")
    rows = rows_of(folder / name)[:-1]
    check(t_s - float(rows[-1]["t_s"]) < 0.2, f"the recording ends at {rows[-1]['t_s']} s, and the session at {t_s} s")
    found = listed()
    check(len(found) == 1 and found[0].get("partial") is True and found[0]["ticks"] == len(rows) and found[0]["scene"] == "scenes/one_slice.json" and "report" not in found[0], f"{found}")
    head, _ = container(console.get(f"/api/recording?file={name}")[1])
    check(head["rows"] == len(rows) and head["is_cut"] is True, f"playback of {head['rows']} rows of {len(rows)}")
    check(name.removeprefix("sessions/").encode() in console.get("/api/history", raw=True)[1], "the history does not name it")
    report = folder / "killed.html"
    done = subprocess.run([PROGRAMS / "trocar-run", "replay", folder / "scenes/one_slice.json", folder / name, "--session-report", report],
                          capture_output=True, text=True, check=False)
    check(done.returncode == 0 and "identical" in done.stdout and "its last row is cut off" in done.stderr and report.exists(), f"the replay: {done}")


def recover(console, live, is_done):
    """Requests recovery until it succeeds: on a loaded machine a late tick may be the next fault."""
    for _ in range(100):
        if live.until(is_done, 0.3):
            return True
        check(console.post("/api/command", {"command": "recover"})[0] == 200, "recover")
    return False


def kill_device(console, folder):
    """False if the machine was too slow, so that a late tick is the fault and not the device's death."""
    live = console.live()
    start(console, live, scene="scenes/outside.json", duration_s=120, device="sim")
    check(recover(console, live, lambda l: l.values and l.value("safety") == RUNNING and l.value("t_s") > 0.2), f"{live.states}, {live.events}")
    seen = live.events[-1]["seq"] if live.events else 0
    device_of = lambda: json.loads((newest(folder) / "console.json").read_text())["device_pid"]
    killed = device_of()
    os.kill(killed, signal.SIGKILL)
    faults = lambda l: [e for e in l.events if e["kind"] == "fault" and e["seq"] > seen]
    if not live.until(faults, 5):
        check(False, f"no fault when the device process is killed: {live.events}")
        return True
    fault = faults(live)[0]
    is_of_device = fault["fault"] != "deadline_missed"
    if is_of_device:
        check(fault["fault"] in ("link_lost", "no_data", "write_failed") and fault["advice"] and fault["text"], f"{fault}")
        check(live.until(lambda l: not any(l.array("tau_Nm")), 5), "torques after the device is lost")
        before = live.kinds().count("recovered")
        check(console.post("/api/command", {"command": "recover"})[0] == 200, "recover")
        # A pause that follows is not ended by the recovery, which waits for the new device process.
        check(console.post("/api/command", {"command": "pause"})[0] == 200, "pause")
        check(live.until(lambda l: l.state() == "paused", 5), f"no pause: {live.states}")
        check(not live.until(lambda l: l.state() == "running", 1), f"a recovery has ended the pause that came after it: {live.states}")
        check(console.post("/api/command", {"command": "resume"})[0] == 200, "resume")
        check(recover(console, live, lambda l: l.kinds().count("recovered") > before),
              f"no recovery with a new device process: {[e['text'] for e in live.events]}")
        check(device_of() != killed, "a later console would not find the new device process")
    console.post("/api/command", {"command": "stop"})
    check(live.until(lambda l: l.state() == "ended", 10), f"{live.states}")
    live.close()
    return is_of_device


def test_killed_device(console, folder):
    add_outside(folder)
    check(any(kill_device(console, folder) for _ in range(5)), "late ticks only")
    (folder / "scenes/outside.json").unlink()


def test_end(console, folder):
    """Ctrl-C ends its session."""
    live = console.live()
    start(console, live, scene="scenes/one_slice.json", duration_s=60)
    pid = live.hello["pid"]
    check(live.until(lambda l: l.values and l.value("t_s") > 0), "no snapshot")
    check(console.stop() == 0, "the console's exit code")
    try:
        os.kill(pid, 0)
        check(False, "the session goes on after the console has ended")
    except ProcessLookupError:
        pass
    check((newest(folder) / "session.csv").exists(), "the session's recording is not whole")
    live.close()


def test_playback(folder):
    """Of the session of test_virtual."""
    recording = sorted(folder.glob("sessions/*three*/session.csv"))[0]
    console = Console(CONSOLE, "--recording", recording, "--against", recording, "--scene", folder / "scenes/three_slices.json", page=PAGE)
    shown = console.get("/api/folder")[1]
    play = shown["playback"]
    check(len(shown["recordings"]) == 2 and play["recording"] == "session.csv" and play["scene"] == "three_slices.json", f"{shown}")
    for name in (play["recording"], play["against"]):
        check(console.get(f"/api/recording?file={name}")[0] == 200, f"rows of {name}")
    check(console.get(f"/api/bone?scene={play['scene']}")[0] == 200, "bone of playback")
    check(console.post("/api/start", {"scene": play["scene"]})[0] == 409, "a session in playback")
    check(console.stop() == 0, "end of playback")


def test_attach(folder):
    link = folder / "mylink"
    run = subprocess.Popen([PROGRAMS / "trocar-run", folder / "scenes/one_slice.json", "--live", link, "--duration", "30", "--quiet",
                            "--recover", "signal"])
    try:
        console = Console(CONSOLE, folder, "--attach", link, page=PAGE)
        live = console.live()
        check(live.until(lambda l: l.values, 10), f"{live.states}")
        check(console.post("/api/start", {"scene": "scenes/one_slice.json"})[0] == 409, "a start beside an attached session")
        status, answer = console.post("/api/xray", {"take": "shot"})
        check(status == 409 and "--xray" in answer["error"], f"a picture of a session without --xray: {status} {answer}")
        check(console.stop() == 0 and run.poll() is None, "the attached session ended with the console")
        live.close()
    finally:
        run.send_signal(signal.SIGINT)
        run.wait(20)


def test_folder(console, folder):
    """The last test: it spoils the folder."""
    shutil.rmtree(folder / "sessions", ignore_errors=True)
    spoil(folder)
    status, shown = console.get("/api/folder")
    check(status == 200, f"/api/folder: {status}")
    scenes = {s["file"]: s for s in shown["scenes"]}
    check(set(scenes) == {"scenes/one_slice.json", "scenes/three_slices.json", "scenes/vertebra.json", "wrong.json", "cut.json"},
          f"scenes: {sorted(scenes)}")
    check(scenes["scenes/three_slices.json"]["slices"] == [21, 17, 13] and "error" not in scenes["scenes/three_slices.json"],
          f"{scenes['scenes/three_slices.json']}")
    for name in ("wrong.json", "cut.json"):
        check(set(scenes[name]) == {"file", "error"} and "\n" not in scenes[name]["error"], f"{scenes[name]}")
    assets = {a["file"]: a for a in shown["assets"]}
    check(set(assets) == {"sample.glb", "broken.glb", "huge.glb"} and "error" in assets["broken.glb"] and "error" in assets["huge.glb"],
          f"assets: {assets}")
    sample = assets["sample.glb"]
    # The phantom: 35 slices 1 mm apart; its body is some 90 by 90 mm.
    check(sample["slices"] == 35 and abs(sample["extent_mm"][2] - 34) < 1e-6 and all(60 < x < 130 for x in sample["extent_mm"][:2]),
          f"{sample}")
    recordings = {r["file"]: r for r in shown["recordings"]}
    check(set(recordings) == {"cut.csv", "empty.csv"} and all("error" in r for r in recordings.values()), f"{recordings}")
    check(shown["session"] is None and shown["role"] == "operator" and console.get("/api/folder", token=console.view)[1]["role"] == "view",
          "the folder's session and role")
    for name in ("../folder/sample.glb", "/etc/passwd", "link.json", "root/etc/passwd", "scenes/../sample.glb", "scenes", "", "pipe.json",
                 "a%00b", ".hidden", "%2e%2e/x", "nothing.json"):
        status, _ = console.get(f"/api/bone?scene={name}")
        check(status in (400, 404, 422), f"/api/bone?scene={name}: {status}")
    check(console.post("/api/start", {"scene": "root/etc/passwd"})[0] == 404, "a start through a link")
