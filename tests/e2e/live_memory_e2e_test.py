# SPDX-License-Identifier: Apache-2.0
"""Sessions that are shown in memory and read: the recording is the same with and without; snapshots are rows, events and sheets those of the summary
and of --meshes. (Readers that are killed: console_kill_test.py; commands and pauses: live_session_test, paused_session_test; links:
telemetry_test.)"""
import json
import math
import struct
import subprocess
import time

from exported import rows_of
from live_reader import Live
from programs import PROGRAMS, SOURCE, WORK

RUN = PROGRAMS / "trocar-run"
PUNCTURE, CUT_SHOWN, ENDED = 1, 5, 8


def start(folder, scene, asset, *options):
    """The session's process."""
    folder.mkdir(parents=True)
    command = [RUN, scene, "--asset", asset, "--clock", "virtual", "--record", folder / "r.csv", "--summary", folder / "s.json",
               "--meshes", folder / "m.json", "--quiet", *options]
    return subprocess.Popen(list(map(str, command)), stderr=subprocess.PIPE, text=True)


def finish(session):
    _, errors = session.communicate(timeout=60)
    assert session.returncode == 0, f"{session.args} ended with {session.returncode}: {errors}"


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
    """Without --live and with it."""
    folder = WORK / name
    finish(start(folder / "without", scene, asset))
    plain = (folder / "without" / "r.csv").read_bytes()
    meshes = json.loads((folder / "without" / "m.json").read_text())
    summary = json.loads((folder / "without" / "s.json").read_text())

    link = folder / "with" / "live"
    session = start(folder / "with", scene, asset, "--live", link)
    while not link.is_symlink() and session.poll() is None:
        time.sleep(0.0005)
    live = Live(link)
    live.seen, snapshots = [], []
    while session.poll() is None:
        live.seen += live.events()
        snapshots.append(live.snapshot())
        time.sleep(0.001)
    finish(session)
    assert (folder / "with" / "r.csv").read_bytes() == plain, f"{name}: another recording with --live"
    assert not link.is_symlink(), f"{name}: the link was not removed"
    assert not live.is_alive(), f"{name}: alive after its end"
    assert live.snapshot()["ended"][0] == 1, f"{name}: the last snapshot does not say that it ended"
    check_rows(name, snapshots, folder / "with" / "r.csv")
    check_events(name, live, summary, meshes["sheets"])
    check_sheets(name, live, meshes)
    print(f"{name}: {len(snapshots)} snapshots, {live.next_event - 1} events, {len(meshes['sheets'])} sheets")


def test_live_memory(asset):
    for name in ("three_slices", "vertebra"):
        check_same_recording(name, SOURCE / "runtime/scenes" / f"{name}.json", asset)
