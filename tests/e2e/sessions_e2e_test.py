# SPDX-License-Identifier: Apache-2.0
"""Sessions as a user runs them: experiments, recovery, replays, procedures, limits, and their memory as a reader sees it."""
import contextlib
import json
import math
import os
import pathlib
import re
import resource
import signal
import socket
import struct
import subprocess
import threading
import time

from device_link_e2e_test import Simulator
from exported import rows_of
from live_reader import Live
from programs import COUNTED_RUN, NO_ALLOCATIONS, PROGRAMS, SOURCE, WORK, run


# ---- the paper's two experiments at 2 ms and 1 kHz, checked from the recordings alone, without code of the project ----


def check_experiment(name, rows, scene, summary, rate):
    tissue = scene.get("tissue", {})
    stiffness = tissue.get("stiffness_N_per_m", 5000.0)
    threshold = tissue.get("threshold_N", 35.0)
    heights = sorted((piece["z_m"] for piece in scene["slices"]), reverse=True)
    time = [float(row["t_s"]) for row in rows]
    tip = [float(row["tool_z_m"]) for row in rows]
    force = [float(row["fz_wanted_N"]) for row in rows]
    delivered = [float(row["fz_delivered_N"]) for row in rows]

    assert abs(time[1] - time[0] - 1 / rate) < 1e-9, f"{name}: not {rate} Hz"
    assert tip[0] > heights[0], f"{name}: the tool does not start above the slices"
    assert min(tip) < heights[-1] - threshold / stiffness, f"{name}: the tool does not come through"
    assert len(summary["punctures"]) == len(heights), f"{name}: {len(summary['punctures'])} punctures"
    assert summary["faults"] == [], f"{name}: faults {summary['faults']}"
    assert summary["allocations_in_loop"] == NO_ALLOCATIONS, f"{name}: {summary['allocations_in_loop']} allocations"
    assert summary["ticks"] == len(rows), f"{name}: {summary['ticks']} ticks, {len(rows)} rows"
    assert summary["wrench_error_max"] <= 1e-9, f"{name}: wrench error {summary['wrench_error_max']}"
    worst = max(abs(f - d) for f, d in zip(force, delivered))
    assert worst <= 1e-9 * threshold, f"{name}: delivered force is off by {worst} N"

    # In every tick the force follows from the force law and the topmost sheet that is not punctured.
    standing, peaks = list(heights), []
    for i, row in enumerate(rows):
        depth = standing[0] - tip[i] if standing else 0.0
        wanted = stiffness * max(depth, 0.0)
        if wanted > threshold:
            before, rise = force[i - 1], stiffness * (tip[i - 1] - tip[i])
            peaks.append(before)
            assert threshold - rise <= before <= threshold, f"{name}: the force before puncture is {before} N; one tick's rise is {rise} N"
            travel = tip[i - 1] - tip[i]
            assert abs(depth - threshold / stiffness) <= travel, f"{name}: punctured {depth} m deep; one tick's travel is {travel} m"
            told = summary["punctures"][len(peaks) - 1]
            assert abs(told["t_s"] - time[i]) <= 1.5 / rate, f"{name}: puncture reported at {told['t_s']} s, seen at {time[i]} s"
            assert told["hole_vertices"] >= 3, f"{name}: a hole of {told['hole_vertices']} vertices"
            standing.pop(0)
            wanted = 0.0
        assert abs(force[i] - wanted) <= 1e-9 * threshold, f"{name}: t = {time[i]} s: force {force[i]} N, the law gives {wanted} N"
    assert len(peaks) == len(heights), f"{name}: {len(peaks)} peaks"
    print(f"{name}: {len(rows)} ticks, peaks {', '.join(f'{p:.3f} N' for p in peaks)}")


def test_experiments(source, programs, asset, work):
    trocar_run = programs / "trocar-run"

    for name in ("one_slice", "three_slices"):
        scene_file = source / "runtime" / "scenes" / f"{name}.json"
        scene = json.loads(scene_file.read_text())
        needs = run(trocar_run, "check", scene_file, "--asset", asset).stdout
        # The share of the file that is read is about the share of its slices that the scene uses.
        read, of = map(float, re.search(r"([\d.]+) of its ([\d.]+) kB read", needs).groups())
        assert of == round(asset.stat().st_size / 1e3, 1) and read < 1.5 * of * len(scene["slices"]) / 35, f"{name}: {needs}"
        for rate in (500, 1000):
            record, summary = (work / f"{name}_{rate}{end}" for end in (".csv", ".json"))
            loaded = (trocar_run, scene_file, "--asset", asset, "--clock", "virtual", "--quiet")
            common = (*loaded, "--rate", rate)
            run(programs / COUNTED_RUN, *common[1:], "--record", record, "--summary", summary)
            check_experiment(f"{name} at {rate} Hz", rows_of(record), scene,
                             json.loads(summary.read_text()), rate)
            again = work / "again.csv"
            run(*common, "--record", again, "--summary", work / "shipped.json")
            assert again.read_bytes() == record.read_bytes(), f"{name} at {rate} Hz: two runs differ"
            shipped = json.loads((work / "shipped.json").read_text())
            assert shipped["allocations_in_loop"] is None, f"{name}: the shipped program counts allocations"
            replayed = work / "replayed.csv"
            run(trocar_run, "replay", scene_file, record, "--asset", asset, "--record", replayed, "--quiet")
            torques = [[row[c] for c in row if c.startswith("tau_")] for row in rows_of(record)]
            once_more = [[row[c] for c in row if c.startswith("tau_")] for row in rows_of(replayed)]
            assert len(torques[0]) == 8 and torques == once_more, f"{name} at {rate} Hz: the replay's torques differ"


# ---- the hand lifts the plate to the end of its reach, a fault, and comes back; a full disk; output that cannot be written ----


def scene_of(source, asset):
    scene = json.loads((source / "runtime" / "scenes" / "one_slice.json").read_text())
    tip = [0.148, 0.148, 0.245, 0.148, 0.148, 0.1]
    at = [0, 0.1, 0.8, 1.4, 2.2, 4.5]
    scene.update(asset=str(asset), duration_s=4.8)
    scene["hand"] = {"trajectory": [{"t_s": t, "tip_m": [0, 0, z]} for t, z in zip(at, tip)]}
    return scene


def limited(*command, size=5_000):
    """The finished process, with files limited to so many bytes."""
    return subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False,
                          preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size)))


def boxes(folder):
    return sorted(folder.glob("black_box_*.csv"))


def check_closed_folder(trocar_run, scene, work):
    """In a folder that cannot be written to, a session runs, and says that a black box would go to the folder for temporary files."""
    closed = work / "closed"
    closed.mkdir(exist_ok=True)
    closed.chmod(0o555)
    # Root may write everywhere, so the session runs as nobody, if nobody can read program and scene.
    as_user = ["setpriv", "--reuid", "65534", "--clear-groups"] if os.geteuid() == 0 else []
    if subprocess.run([*as_user, trocar_run, "check", scene.resolve()], cwd="/", capture_output=True, check=False).returncode != 0:
        return
    done = subprocess.run([*as_user, trocar_run, scene.resolve(), "--clock", "virtual", "--duration", "0.01"], cwd=closed, capture_output=True, text=True,
                          check=False)
    assert done.returncode == 0 and "note: the current folder cannot be written to" in done.stderr, f"no current folder: {done}"
    # A new scene is no session, and has no black box.
    opened = work / "opened"
    opened.mkdir(exist_ok=True)
    opened.chmod(0o777)
    done = subprocess.run([*as_user, trocar_run, "new-scene", (work / "sample.glb").resolve(), "-o", opened.resolve() / "scene.json"],
                          cwd=closed, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stderr == "", f"a new scene: {done}"


def test_recovery(source, programs, asset, work):
    trocar_run = programs / "trocar-run"
    scene = work / "scene.json"
    scene.write_text(json.dumps(scene_of(source, asset)))

    # No recovery: exit code 5, with a recording and a black box.
    never = work / "never"
    never.mkdir()
    done = run(trocar_run, scene, "--clock", "virtual", "--record", never / "r.csv", "--summary", never / "s.json", "--quiet", expect=5)
    assert "joint_limit" in done.stderr, f"the fault is not named: {done.stderr!r}"
    summary = json.loads((never / "s.json").read_text())
    fault, = summary["faults"]
    assert fault["fault"] == "joint_limit" and fault["recovered_t_s"] is None, fault
    assert 0 <= fault["torques_zero_t_s"] - fault["t_s"] <= 0.005, f"torques were not zero in time: {fault}"
    box, = boxes(never)
    assert box.name == pathlib.Path(fault["black_box"]).name and "_joint_limit" in box.name, f"{box} or {fault}"
    recording = (never / "r.csv").read_bytes()
    assert recording == box.read_bytes(), "the black box of a session of less than 4 s is not its recording"
    assert len(recording.splitlines()) == summary["ticks"] + 1, "rows are missing"

    # Automatic recovery: the session continues, and the tool punctures the slice.
    auto = work / "auto"
    auto.mkdir()
    run(trocar_run, scene, "--clock", "virtual", "--recover", "auto", "--record", auto / "r.csv", "--summary", auto / "s.json", "--quiet")
    summary = json.loads((auto / "s.json").read_text())
    fault, = summary["faults"]
    assert fault["recovered_t_s"] is not None and fault["recovered_t_s"] > fault["t_s"] + 0.25, fault
    assert len(summary["punctures"]) == 1 and abs(summary["punctures"][0]["tip_N"] - 35) < 0.2, summary["punctures"]
    assert len(boxes(auto)) == 1, boxes(auto)
    replayed = run(trocar_run, "replay", scene, auto / "r.csv", "--recover", "auto", "--record", auto / "again.csv")
    assert "identical" in replayed.stdout, replayed.stdout
    assert (auto / "r.csv").read_bytes() == (auto / "again.csv").read_bytes(), "the replay of a recovery differs"
    assert len(boxes(auto)) == 1, "a replay wrote a black box"

    # A full disk: the files that fit are written, and the exit code is a fault's before that of the files.
    full = work / "full"
    full.mkdir()
    one_slice = source / "runtime" / "scenes" / "one_slice.json"
    outputs = ("--asset", asset, "--clock", "virtual", "--meshes", full / "m.json", "--summary", full / "s.json", "--quiet")
    for asked, more, code, fault in ((scene, ("--black-box", full), 5, "joint_limit"), (one_slice, ("--record", full / "r.csv"), 4, "recording_failed")):
        done = limited(trocar_run, asked, *more, *outputs)
        assert done.returncode == code, f"a full disk: {done.returncode}, not {code}: {done.stderr!r}"
        assert f"fault {fault} at" in done.stderr and "m.json: File too large" in done.stderr, f"a full disk: {done.stderr!r}"
        assert ("joint_limit" in done.stderr.rpartition("trocar-run: ")[2]) == (code == 5), f"a full disk: {done.stderr!r}"
        assert "-USR1" not in done.stderr and "link_lost" not in done.stderr, f"a full disk: {done.stderr!r}"
        summary = json.loads((full / "s.json").read_text())
        assert [each["fault"] for each in summary["faults"]] == [fault], f"a full disk: {summary['faults']}"
        assert summary["end"] == ("fault" if code == 5 else "interrupted") and not boxes(full), f"a full disk: {summary['end']}, {boxes(full)}"
    # What was recorded is kept, and said to be; the files that must be whole are not there.
    kept = full / "r.csv.partial"
    text = kept.read_bytes()
    assert text.endswith(b"\n") and f"r.csv: File too large; the first {text.count(bytes([10])) - 1} rows are in {kept}" in done.stderr, f"a full disk: {done.stderr!r}"
    left = sorted(file.name for file in full.iterdir() if not file.name.startswith("black_box_"))
    assert left == ["r.csv.partial", "s.json"], f"a full disk: {left}"
    # The disk is full only after a fault, with the last rows: the session keeps the fault, and so does its exit code.
    late = work / "full_late"
    late.mkdir()
    done = limited(trocar_run, scene, "--clock", "virtual", "--record", late / "r.csv", "--summary", late / "s.json", "--black-box", late,
                   "--quiet", size=len(recording) - 100)
    assert done.returncode == 5 and "joint_limit" in done.stderr and "r.csv: File too large; the first " in done.stderr, f"full after a fault: {done}"
    assert [each["fault"] for each in json.loads((late / "s.json").read_text())["faults"]] == ["joint_limit"], f"full after a fault: {done}"
    # Standard output that cannot be written is an error, except for a closed pipe.
    with open("/dev/full", "w") as nowhere:
        printed = subprocess.run([trocar_run, "check", scene], stdout=nowhere, stderr=subprocess.PIPE, text=True, check=False)
    assert printed.returncode == 4 and "standard output could not be written" in printed.stderr, f"a full standard output: {printed.returncode}, {printed.stderr!r}"
    process = subprocess.Popen([trocar_run, "--help"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    process.stdout.close()
    assert process.wait() == 0, f"a closed pipe: {process.returncode}, {process.stderr.read()!r}"
    check_closed_folder(trocar_run, scene, work)


# ---- what the operator is told: connections, replays that differ or were interrupted, recordings that become too large ----


READY_S = 20  # a limit for a hanging program, not a bound


def outcome_of(process):
    """(exit code, stderr)"""
    _, stderr = process.communicate(timeout=READY_S)
    return process.returncode, stderr


def test_connections(source, programs, work, asset):
    key = work / "other.key"
    key.touch(mode=0o600)
    key.write_text("1" * 64 + "\n")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        other.settimeout(0.1)
        for address, code, words in (("127.0.0.1:%d" % other.getsockname()[1], 5, "another program answers there, not a device"),
                                     ("no-such-host.invalid:4840", 2, 'the name "no-such-host.invalid" gives no address')):
            command = (programs / "trocar-run", source / "runtime" / "scenes" / "one_slice.json", "--asset", asset, "--device", f"udp:{address}",
                       "--key-file", key, "--black-box", work)
            process = subprocess.Popen([str(word) for word in command], stderr=subprocess.PIPE, text=True)
            while process.poll() is None:  # the other program sends back what it gets
                with contextlib.suppress(TimeoutError):
                    other.sendto(*other.recvfrom(512))
            returncode, stderr = outcome_of(process)
            assert returncode == code and len(stderr.splitlines()) == 1 and words in stderr, f"{address}: {returncode}, {stderr!r}"


def test_replays(source, programs, work, asset):
    scene_file, recording = work / "replayed.json", work / "replayed.csv"
    scene = json.loads((source / "runtime" / "scenes" / "one_slice.json").read_text())
    scene.update(asset=str(asset), duration_s=0.8)
    scene["hand"] = {"trajectory": [{"t_s": 0, "tip_m": [0, 0, 0.125]}, {"t_s": 0.7, "tip_m": [0, 0, 0.105]}]}
    scene_file.write_text(json.dumps(scene))
    trocar_run, virtual = programs / "trocar-run", ("--clock", "virtual", "--quiet")
    run(trocar_run, scene_file, *virtual, "--record", recording)
    rows = rows_of(recording)
    assert list(rows[0])[-1] == "origin" and all(None not in row and None not in row.values() for row in rows), "the columns"
    # Torques that differ.
    lines = recording.read_text().splitlines(keepends=True)
    changed = work / "changed.csv"
    column = list(rows[0]).index("tau_1_1_Nm")
    at = next(i for i in range(1, len(lines)) if i > 300 and float(lines[i].split(",")[column]) != 0)
    fields = lines[at].split(",")
    fields[column] = repr(float(fields[column]) * (1 + 1e-15))
    changed.write_text("".join(lines[:at] + [",".join(fields)] + lines[at + 1:]))
    done = run(trocar_run, "replay", scene_file, changed, "--quiet", expect=3)
    assert f"the torques differ from the recording's from row {at} on" in done.stderr, f"other torques: {done.stderr!r}"
    # With --duration, the recording and not the scene says how long its session was to be.
    for duration_s, kept in ((0.5, 100), (1, 900)):
        planned, told = work / "planned.csv", work / "planned.json"
        run(trocar_run, scene_file, *virtual, "--duration", duration_s, "--record", planned)
        for ticks, end in ((round(1000 * duration_s), "done"), (kept, "interrupted")):
            planned.write_text("".join(planned.read_text().splitlines(keepends=True)[:ticks + 1]))
            done = run(trocar_run, "replay", scene_file, planned, "--summary", told, "--record", work / "again.csv")
            said = f"planned.csv: has {ticks} ticks, and its session was to last {round(1000 * duration_s)}: it ended early" in done.stderr
            assert said == (end == "interrupted"), f"{ticks} ticks of {duration_s} s: {done.stderr!r}"
            assert json.loads(told.read_text())["end"] == end, f"{ticks} ticks of {duration_s} s"
            assert (work / "again.csv").read_bytes() == planned.read_bytes(), f"{ticks} ticks of {duration_s} s: another recording"
            assert ("touched nothing" in done.stdout) == (ticks == 100), f"{ticks} ticks of {duration_s} s: {done.stdout}"

    # A black box names its origin too, and the replay of a fault has the fault's exit code.
    reach = work / "reach.json"
    up = [{"t_s": t, "tip_m": [0, 0, z]} for t, z in ((0, 0.148), (0.1, 0.148), (0.8, 0.245))]
    reach.write_text(json.dumps({**scene, "hand": {"trajectory": up}, "duration_s": 1}))
    boxes = work / "boxes"
    boxes.mkdir()
    run(trocar_run, reach, *virtual, "--black-box", boxes, expect=5)
    box, = boxes.iterdir()
    run(trocar_run, "replay", reach, box, "--quiet", expect=5)


def test_too_long(source, programs, work, asset):
    """A warning at the start, if the recording of the whole session would be too large to be read."""
    scene = source / "runtime" / "scenes" / "one_slice.json"
    command = (programs / "trocar-run", scene, "--asset", asset, "--duration", "7200", "--record", work / "long.csv")
    with subprocess.Popen([str(word) for word in command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        # Without the warning the first line is the note at the end of the session.
        threading.Timer(2, process.send_signal, (signal.SIGINT,)).start()
        line = process.stderr.readline()
    assert "long.csv: may become larger than 4 GiB" in line and "record at most 59 minutes" in line, f"two hours: {line!r}"
    done = run(programs / "trocar-run", scene, "--asset", asset, "--duration", "0.1", "--clock", "virtual",
               "--record", work / "brief.csv")
    assert "GiB" not in done.stderr, f"0.1 s: {done.stderr!r}"


# ---- procedures on the command line and in a scene give the same session, which its recording names ----


NAMES = ("pedicle-probe", "jamshidi-8g", "vertebroplasty-11g", "bone-marrow-trephine", "spinal-needle", "tuohy-needle")


def test_procedures(programs, asset, work):
    trocar_run, file = programs / "trocar-run", work / "procedure.json"
    run(trocar_run, "new-scene", asset, "-o", file, "--quiet")
    scene = json.loads(file.read_text())
    top = scene["body"]["top_z_m"]

    # The same through the command line and in the scene.
    session = ("--clock", "virtual", "--quiet", "--summary", work / "summary.json")
    forces = {}
    for strength in ("low", "median", "high"):
        run(trocar_run, file, "--procedure", "pedicle-probe", "--strength", strength, "--record", work / f"{strength}.csv", *session)
        forces[strength] = json.loads((work / "summary.json").read_text())["cutting"]["tip_max_N"]
    assert 0 < forces["low"] < forces["median"] < forces["high"], forces
    stated = {key: value for key, value in scene.items() if key not in ("tissue", "tissues", "layers", "tool")}
    stated["procedure"] = {"name": "pedicle-probe"}
    (work / "stated.json").write_text(json.dumps(stated))
    run(trocar_run, work / "stated.json", "--record", work / "stated.csv", *session)
    table = {name: [line.rsplit(",", 1)[0] for line in (work / f"{name}.csv").read_text().splitlines()] for name in ("median", "stated")}
    assert table["median"] == table["stated"] and len(table["median"]) > 1000

    # A recording says what it was made with.
    assert "procedure=pedicle-probe/high" in (work / "high.csv").read_text()
    replay = (trocar_run, "replay", file, work / "high.csv", "--quiet")
    run(*replay, "--procedure", "pedicle-probe", "--strength", "high")
    other = subprocess.run([str(word) for word in (*replay, "--procedure", "pedicle-probe")], capture_output=True, text=True, check=False)
    assert other.returncode == 3 and "procedure (pedicle-probe/high, here pedicle-probe/median)" in other.stderr, other

    # Through soft tissue: the hand must begin above the skin.
    for name in ("spinal-needle", "tuohy-needle", "vertebroplasty-11g"):
        below = subprocess.run([str(trocar_run), str(file), "--procedure", name, "--quiet"], capture_output=True, text=True, check=False)
        assert below.returncode == 3 and f"within the layers of {name}" in below.stderr, below
        soft = json.loads(json.dumps(stated)) | {"procedure": {"name": name, "strength": "low"}, "duration_s": 3}
        soft["body"]["top_z_m"] = 0.13
        soft["hand"]["trajectory"] = [{"t_s": 0, "tip_m": [0, 0, 0.22]}, {"t_s": 3, "tip_m": [0, 0, 0.129]}]
        (work / "soft.json").write_text(json.dumps(soft))
        run(trocar_run, work / "soft.json", *session)
        assert json.loads((work / "summary.json").read_text())["cutting"]["tissue_max_N"] > 0.5
    assert top < 0.2

    everything = run(trocar_run, "procedures").stdout
    for name in NAMES:
        one = run(trocar_run, "procedures", name).stdout
        assert one.startswith(name + ": ") and one in everything and "assumed" in one, name


# ---- limits of the stiffness of contact by operator, device and stated mass; a recording names them ----


def rendered(summary):
    cutting = json.loads(summary.read_text())["cutting"]
    assert cutting["axis"] == "coupled", cutting
    return cutting["coupling_N_per_m"] * cutting["force_scale"]


def test_stiffness_limit(programs, asset, work):
    trocar_run, scene = programs / "trocar-run", work / "stiff.json"
    run(trocar_run, "new-scene", asset, "-o", scene, "--quiet")
    summary = work / "summary.json"
    fast = ("--clock", "virtual", "--quiet", "--summary", summary)
    run(trocar_run, scene, *fast)
    full = rendered(summary)

    limit = full / 3
    run(trocar_run, scene, *fast, "--stiffness-limit", limit, "--record", work / "limited.csv")
    assert abs(rendered(summary) / limit - 1) < 1e-6
    assert "stiffness-limit=" in (work / "limited.csv").read_text()
    run(trocar_run, "replay", scene, "--quiet", work / "limited.csv", "--stiffness-limit", limit)
    run(trocar_run, "replay", scene, "--quiet", work / "limited.csv", expect=3)
    assert "the limit that the device or the operator states" in run(trocar_run, "check", scene, "--stiffness-limit", limit).stdout

    device = json.loads((SOURCE / "formats/session/four_legs.json").read_text())
    device["plate"]["stiffness_max_N_per_m"] = 5000
    (work / "soft.json").write_text(json.dumps(device))
    run(trocar_run, scene, *fast, "--device-description", work / "soft.json", "--stiffness-limit", limit)
    assert abs(rendered(summary) / min(limit, 5000) - 1) < 1e-6

    # Over the link, with a device that is exact and prompt, for which the margin of the mass is all that differs.
    device = json.loads((SOURCE / "formats/session/four_legs.json").read_text())
    device["simulation"]["encoder_counts_per_revolution"], device["delay_s"] = 0, 0
    (work / "exact.json").write_text(json.dumps(device))
    exact = ("--device-description", work / "exact.json")
    run(trocar_run, scene, *fast, *exact)
    full = rendered(summary)
    for words, part in (((), 0.5), (("--simulated",), 1)):
        record = work / f"link{part}.csv"
        with Simulator(programs, work, scene, "--clock", "lock-step", "--sessions", "1") as drive:
            run(trocar_run, scene, *fast, *drive.link(), *exact, "--record", record, *words)
            assert drive.process.wait(60) == 0
        assert abs(rendered(summary) / full / part - 1) < 1e-6
        assert ("stiffness-margin=2" in record.read_text()) == (part == 0.5)
        run(trocar_run, "replay", scene, "--quiet", record, *exact)


# ---- sessions shown in memory: snapshots are rows, events and sheets those of the summary and of --meshes ----


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
