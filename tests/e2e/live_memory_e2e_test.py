# SPDX-License-Identifier: Apache-2.0
"""Sessions that are shown in memory and read. Recordings are the same with and without, whatever happens to readers; events and sheets are
those of the summary and of --meshes; a drive is paused. (Commands: live_session_test.cpp, paused_session_test.cpp; links: telemetry_test.cpp.)"""
import json
import math
import os
import shutil
import signal
import struct
import subprocess
import time

import pytest
from device_link_e2e_test import Simulator
from exported import rows_of
from live_reader import Live
from machine_stalls import MachineStalls
from programs import PROGRAMS, SOURCE, WORK, run

RUN = PROGRAMS / "trocar-run"
TIMES = 100  # that readers are killed, and stopped
PUNCTURE, FAULT, NOT_RECOVERED, RECOVERED, CUT_SHOWN, PAUSED, RESUMED, ENDED = range(1, 9)
PATIENCE_S = 60


def wait_for(what, of, session=None):
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        result = what()
        if result:
            return result
        if session is not None and session.poll() is not None:
            break
        time.sleep(0.0005)
    ended = session is not None and session.poll() is not None
    pytest.fail(f"no {of}" + (f": the session ended with {session.returncode}: {session.stderr.read()}" if ended else f" in {PATIENCE_S} s"))


def start(folder, scene, asset, *options, clock="virtual", live=True):
    """The session's process, and its memory."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    command = [RUN, scene, "--asset", asset, "--clock", clock, "--record", folder / "r.csv", "--summary", folder / "s.json",
               "--meshes", folder / "m.json", "--black-box", folder, "--quiet", *options]
    if not live:
        return subprocess.Popen(list(map(str, command)), stderr=subprocess.PIPE, text=True), None
    link = folder / "live"
    session = subprocess.Popen(list(map(str, [*command, "--live", link])), stderr=subprocess.PIPE, text=True)
    wait_for(link.is_symlink, f"{link}: {scene}", session)
    return session, Live(link)


def finish(session, expect=0):
    _, errors = session.communicate(timeout=PATIENCE_S)
    assert session.returncode == expect, f"{session.args} ended with {session.returncode}: {errors}"
    return errors


def fork_reader(link):
    """A process that reads all the time. None: the session ended before it could begin."""
    ready, tell = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            live = Live(link)
            os.write(tell, b"1")
            while True:
                live.snapshot()
                live.sheet(0)
                live.events()
        finally:
            os._exit(1)
    os.close(tell)
    began = os.read(ready, 1) == b"1"
    os.close(ready)
    if not began:
        os.waitpid(child, 0)
    return child if began else None


def end_reader(child):
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)


def with_bad_readers(folder, scene, asset, counts):
    """A session during which readers are killed and stopped, in turns, until it ends."""
    session, live = start(folder, scene, asset)
    stopped = []
    while session.poll() is None:
        child = fork_reader(folder / "live")
        if child is None:
            break
        time.sleep(0.002)
        alive = live.is_alive()
        if counts["killed"] <= counts["stopped"]:
            end_reader(child)
            counts["killed"] += alive
        else:
            os.kill(child, signal.SIGSTOP)  # it keeps the memory, stopped, until the session has ended
            counts["stopped"] += alive
            stopped.append(child)
    finish(session)
    for child in stopped:
        end_reader(child)
    return live


def check_events(name, live, summary, scene_sheets):
    events = live.seen + live.events()
    assert live.lost == 0, f"{name}: {live.lost} events lost"
    punctures = [e for e in events if e["kind"] == PUNCTURE]
    assert len(punctures) == len(summary["punctures"]), f"{name}: {len(punctures)} punctures, not {len(summary['punctures'])}"
    for event, wanted in zip(punctures, summary["punctures"]):
        for field in ("slice", "t_s", "tool_z_m", "penetration_m", "tip_N", "hand_N", "trial_force_N"):
            assert event[field] == wanted[field], f"{name}: {field} {event[field]} of a puncture, not {wanted[field]}"
    last = events[-1]
    assert last["kind"] == ENDED and last["cut"] == 0, f"{name}: the last event is {last}"
    cuts = {}
    for event in events:
        if event["kind"] == CUT_SHOWN:
            assert event["cut"] > cuts.get(event["sheet"], 0), f"{name}: holes of a sheet do not ascend: {event}"
            cuts[event["sheet"]] = event["cut"]
    wanted = {i: len(sheet["cuts"]) for i, sheet in enumerate(scene_sheets) if sheet["cuts"]}
    assert cuts == wanted, f"{name}: holes shown {cuts}, not {wanted}"


def f32(x):
    return struct.unpack("<f", struct.pack("<f", x))[0]


def check_sheets(name, live, meshes):
    step_mm = 2.0 ** -meshes["lattice_bits"]
    for i, sheet in enumerate(meshes["sheets"]):
        after = sheet["after"]
        flags, cuts, xy, hu, corners = live.sheet(i)
        where = f"{name}: sheet {i}"
        assert flags & 1 == 1 and cuts == len(sheet["cuts"]), f"{where}: flags {flags}, {cuts} holes"
        assert list(corners) == [v for t in after["triangles"] for v in t], f"{where}: other triangles than --meshes"
        angle = math.radians(sheet["rotation_deg"])
        worst = len(xy) != 2 * len(after["vertices"])
        for k, (u, v) in enumerate(after["vertices"]):
            du, dv = (u * step_mm - sheet["anchor_mm"][0]) * 1e-3, (v * step_mm - sheet["anchor_mm"][1]) * 1e-3
            x = sheet["at_m"][0] + math.cos(angle) * du - math.sin(angle) * dv
            y = sheet["at_m"][1] + math.sin(angle) * du + math.cos(angle) * dv
            worst = max(worst, abs(xy[2 * k] - f32(x)), abs(xy[2 * k + 1] - f32(y)))
        assert worst < 1e-8, f"{where}: a vertex is {worst} m off"
        assert len(hu) == len(after["vertices"]), f"{where}: {len(hu)} HU"
        assert all(-1100 < value < 3100 for value in hu), f"{where}: HU from {min(hu, default=0)} to {max(hu, default=0)}"


def check_rows(name, snapshots, recording):
    """Each snapshot is a row of the recording."""
    rows = rows_of(recording)
    joints = [f"tau_{leg}_{joint}_Nm" for leg in (1, 2, 3, 4) for joint in (1, 4)]
    for snapshot in snapshots:
        ticks = int(snapshot["ticks"][0])
        if ticks == 0:
            continue
        row = rows[ticks - 1]
        assert snapshot["t_s"][0] == float(row["t_s"]), f"{name}: time {snapshot['t_s']} after {ticks} ticks"
        assert list(snapshot["tau_Nm"]) == [float(row[joint]) for joint in joints], f"{name}: other torques at {row['t_s']}"
        assert snapshot["tool_m"][2] == float(row["tool_z_m"]), f"{name}: another tip at {row['t_s']}"


def check_same_recording(name, scene, asset):
    """Without --live, with it, and with readers that are killed and stopped."""
    folder = WORK / name
    session, _ = start(folder / "without", scene, asset, live=False)
    finish(session)
    plain = (folder / "without" / "r.csv").read_bytes()
    meshes = json.loads((folder / "without" / "m.json").read_text())
    summary = json.loads((folder / "without" / "s.json").read_text())

    session, live = start(folder / "with", scene, asset)
    live.seen, snapshots = [], []
    while session.poll() is None:
        live.seen += live.events()
        snapshots.append(live.snapshot())
        time.sleep(0.001)
    finish(session)
    assert (folder / "with" / "r.csv").read_bytes() == plain, f"{name}: another recording with --live"
    assert not (folder / "with" / "live").is_symlink(), f"{name}: the link was not removed"
    assert not live.is_alive(), f"{name}: alive after its end"
    assert live.snapshot()["ended"][0] == 1, f"{name}: the last snapshot does not say that it ended"
    check_rows(name, snapshots, folder / "with" / "r.csv")
    check_events(name, live, summary, meshes["sheets"])
    check_sheets(name, live, meshes)
    print(f"{name}: {len(snapshots)} snapshots, {live.next_event - 1} events, {len(meshes['sheets'])} sheets")

    counts, sessions = {"killed": 0, "stopped": 0}, 0
    while counts["killed"] < TIMES or counts["stopped"] < TIMES:
        with_bad_readers(folder / "bad", scene, asset, counts)
        sessions += 1
        assert (folder / "bad" / "r.csv").read_bytes() == plain, f"{name}: another recording with readers that are killed or stopped"
        if sessions > 1000:
            pytest.fail(f"{name}: readers could not be killed often enough: {counts}")
            break
    print(f"{name}: readers killed {counts['killed']} times, stopped {counts['stopped']} times, in {sessions} sessions: the same recording")


def replay(folder, scene, asset, expect=0):
    done = run(RUN, "replay", scene, "--asset", asset, folder / "r.csv", "--record", folder / "again.csv", expect=expect)
    assert "identical" in done.stdout, f"{folder.name}: {done.stdout} {done.stderr}"
    assert (folder / "again.csv").read_bytes() == (folder / "r.csv").read_bytes(), f"{folder.name}: the replay differs"


def pause_a_drive(scene, asset, clock, of_drive, seconds):
    """The folder of a session that was paused for 1.5 s; None if it lost its link in real time."""
    folder = WORK / f"drive_{clock}"
    with Simulator(PROGRAMS, WORK, scene, "--clock", of_drive) as drive:
        session, live = start(folder, scene, asset, *drive.link(), "--duration", str(seconds), clock=clock)
        wait_for(lambda: live.snapshot()["ticks"][0] > 200 or session.poll() is not None, "ticks")
        live.command("pause")
        wait_for(lambda: live.snapshot()["paused"][0] == 1 or session.poll() is not None, "the pause")
        time.sleep(1.5)
        live.command("resume")
        errors = session.communicate(timeout=PATIENCE_S)[1]
    summary = json.loads((folder / "s.json").read_text())
    faults = [fault["fault"] for fault in summary["faults"]]
    if clock == "real" and (summary["link"]["sessions"] > 1 or set(faults) & {"no_data", "link_lost", "deadline_missed"}):
        return None
    assert session.returncode == 0 and faults == ["paused"], f"{clock}: ended with {session.returncode}, {summary['faults']}: {errors}"
    assert summary["link"]["sessions"] == 1 and summary["ticks"] == 1000 * seconds, f"{clock}: {summary['link']}, {summary['ticks']} ticks"
    return folder


def check_pause_of_a_drive(scene, asset):
    """A drive with a clock of its own gets zero torques in a pause of 1.5 s, so that its watchdog does not trip; one in lock-step
    gets nothing, and its time stands still. A machine that stands still loses the link, too; one session of 20 must not."""
    # In virtual time a tick takes some 20 us: long enough that the pause comes before the end.
    for clock, of_drive, seconds in (("real", "real", 1.2), ("virtual", "lock-step", 30)):
        folder = None
        with MachineStalls() as machine:
            for _ in range(20):
                folder = folder or pause_a_drive(scene, asset, clock, of_drive, seconds)
        if folder is None:
            print(f"{clock}: all 20 sessions lost their link. {machine}")
            assert not machine.is_on_time, "links were lost, though the machine was on time"
            continue
        lost = [row["device_read"] for row in rows_of(folder / "r.csv") if row["device_read"] not in ("ok", "no_data")]
        assert not lost, f"{clock}: {lost[:3]}"
        replay(folder, scene, asset)


def test_live_memory(asset):
    scenes = SOURCE / "runtime" / "scenes"
    three = scenes / "three_slices.json"
    check_same_recording("three_slices", three, asset)
    check_same_recording("vertebra", scenes / "vertebra.json", asset)
    check_pause_of_a_drive(three, asset)
