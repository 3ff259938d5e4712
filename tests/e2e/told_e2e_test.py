# SPDX-License-Identifier: Apache-2.0
"""What the operator is told, and when.

 1. A fault is a line in a redirected log while the session goes on: name, sensor, value, limit, what to do. The summary has them.
 2. A recovery that is not granted says why, and a granted one says so.
 3. Another program in place of a device, and a name without an address, are different messages. (udp_device_test.cpp has the others.)
 4. A replay on another scene, asset, device or option is refused and names it; torques that differ are exit code 3. A replay of an
    interrupted session is interrupted.
 5. A session that is interrupted before its first tick leaves the files of an earlier session as they were. One whose recording may become
    too large to be read is warned of at its start.
"""
import contextlib
import json
import re
import signal
import socket
import subprocess
import threading
import time

from device_link_e2e_test import Simulator
from exported import rows_of
from programs import run

READY_S = 20  # a limit for a hanging program, not a bound


def at_reach_end(source, asset):
    """The hand lifts the plate to the end of its reach, a fault, and stays there for the rest of a long session."""
    scene = json.loads((source / "runtime" / "scenes" / "one_slice.json").read_text())
    scene.update(asset=str(asset), duration_s=60)
    scene["hand"] = {"trajectory": [{"t_s": t, "tip_m": [0, 0, z]} for t, z in ((0, 0.148), (0.1, 0.148), (0.8, 0.245))]}
    return scene


def wait_for(log, words):
    """The first line of the log with the words, or None."""
    end = time.monotonic() + READY_S
    while time.monotonic() < end:
        for line in log.read_text().splitlines():
            if words in line:
                return line
        time.sleep(0.01)
    return None


def faults_at_once(programs, work, scene):
    """In real time, with the recovery left to the operator: the session would last a minute."""
    log, summary = work / "log", work / "told.json"
    with log.open("w") as stream:
        process = subprocess.Popen([programs / "trocar-run", scene, "--rate", "500", "--recover", "signal", "--summary", summary, "--quiet"],
                                   stdout=stream, stderr=stream, cwd=work)
        line = wait_for(log, "fault joint_limit")
        assert line is not None, f"the fault is not in the log: {log.read_text()!r}"
        assert process.poll() is None and not summary.exists(), "the fault was told after the session only"
        process.send_signal(10)  # SIGUSR1
        waiting = wait_for(log, "no recovery yet")
        assert process.poll() is None and waiting is not None and "still outside its limits" in waiting, f"the recovery is not explained: {waiting!r}"
        process.terminate()
        process.wait(timeout=READY_S)
    shape = (r"trocar-run: fault joint_limit at \d+\.\d{4} s: a joint is outside its limits "
             r"\(angle theta \d of leg \d -?[\d.]+ deg, (limit|at least) -?[\d.]+ deg\); move the tool back towards the middle; "
             r"then request recovery: kill -USR1 \d+")
    assert line is None or re.fullmatch(shape, line) is not None, f"the line is {line!r}"
    fault, = json.loads(summary.read_text())["faults"]
    assert re.fullmatch(r"th_\d_\d_rad", str(fault.get("quantity"))) is not None, fault
    assert 0 < abs(fault.get("value", 0) - fault.get("limit", 0)) < 0.1, fault
    message = fault.get("message")
    assert line is None or f"trocar-run: fault {message};" in line, f"{message!r} in the summary, {line!r} in the log"


def a_granted_recovery(source, programs, work, asset):
    scene = source / "runtime" / "scenes" / "one_slice.json"
    lifted = work / "lifted.json"
    up = json.loads(scene.read_text())
    up["hand"] = {"trajectory": [{"t_s": t, "tip_m": [0, 0, z]} for t, z in ((0, 0.148), (0.1, 0.148), (0.8, 0.245), (1.4, 0.148))]}
    up.update(asset=str(asset), duration_s=2.5)
    lifted.write_text(json.dumps(up))
    done = run(programs / "trocar-run", lifted, "--clock", "virtual", "--recover", "auto", "--quiet", cwd=work)
    lines = done.stderr.splitlines()
    assert len(lines) == 4 and "fault joint_limit" in lines[0] and "no recovery yet" in lines[1] and "recovered at" in lines[2] and "black box" in lines[3], f"a recovery: {lines}"


def outcome_of(process):
    """(exit code, stderr)"""
    _, stderr = process.communicate(timeout=READY_S)
    return process.returncode, stderr


def connections(source, programs, work, asset):
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


def replays(source, programs, work, asset, scan):
    scene_file, recording = work / "replayed.json", work / "replayed.csv"
    scene = json.loads((source / "runtime" / "scenes" / "one_slice.json").read_text())
    scene.update(asset=str(asset), duration_s=0.8)
    scene["hand"] = {"trajectory": [{"t_s": 0, "tip_m": [0, 0, 0.125]}, {"t_s": 0.7, "tip_m": [0, 0, 0.105]}]}
    scene_file.write_text(json.dumps(scene))
    trocar_run, virtual = programs / "trocar-run", ("--clock", "virtual", "--quiet")
    run(trocar_run, scene_file, *virtual, "--record", recording)
    replay = ("replay", scene_file, recording, "--quiet")
    assert run(trocar_run, *replay).stderr == "", "the same session: something was said"

    # The column: last, full in the first row only, and any reader of CSV gets the other columns.
    rows = rows_of(recording)
    assert list(rows[0])[-1] == "origin" and all(None not in row and None not in row.values() for row in rows), "the columns"
    stated = rows[0].get("origin", "")
    assert stated.startswith("program=") and all(row["origin"] == "" for row in rows[1:]), f"{stated!r}"
    origin = dict(entry.partition("=")[::2] for entry in stated.split(";")) if stated else {"program": "", "scene": "", "asset": ""}
    for key, file in (("scene", scene_file), ("asset", asset)):
        digest = subprocess.run(["b2sum", "-l", "256", file], capture_output=True, text=True, check=True).stdout.split()[0]
        assert origin[key] == digest, f"{key}: {origin[key]}, b2sum {digest}"

    def refused(name, *words, arguments=(), file=scene_file, of=recording):
        done = run(trocar_run, "replay", file, of, "--quiet", *arguments, expect=3)
        lines = done.stderr.splitlines()
        assert len(lines) == 1 and lines[0].startswith(f"trocar-run: {of}: ") and all(word in lines[0] for word in words), f"{name}: {done.stderr!r}"

    other = work / "other.json"
    other.write_text(json.dumps({**scene, "tissue": {"stiffness_N_per_m": 5000, "threshold_N": 20}}))
    refused("another scene", "the scene", origin["scene"][:12], file=other)
    other_asset = work / "other.glb"
    run(programs / "trocar-mesh", scan / "dicom", "-o", other_asset, "--threshold", "300", "--quiet")
    refused("another asset", "the asset", origin["asset"][:12], arguments=("--asset", other_asset))
    description = json.loads((source / "formats" / "session" / "four_legs.json").read_text())
    same_device, other_device = work / "same_device.json", work / "other_device.json"
    same_device.write_text(json.dumps(description))
    description["plate"]["mass_kg"] *= 1.1
    other_device.write_text(json.dumps(description))
    refused("another device", "the device (built-in", arguments=("--device-description", other_device))
    run(trocar_run, *replay, "--device-description", same_device)
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
    reach.write_text(json.dumps({**at_reach_end(source, asset), "duration_s": 1}))
    boxes = work / "boxes"
    boxes.mkdir()
    run(trocar_run, reach, *virtual, "--black-box", boxes, expect=5)
    box, = boxes.iterdir()
    run(trocar_run, "replay", reach, box, "--quiet", expect=5)
    refused("a black box on another scene", "the scene", file=other, of=box)


def interrupted_at_once(source, programs, work, asset):
    """Ctrl-C while the session waits for its device, whose process stands still."""
    scene = source / "runtime" / "scenes" / "one_slice.json"
    record = work / "kept.csv"
    summary = work / "kept.summary.json"
    record.write_text("of an earlier session")
    with Simulator(programs, work, scene, "--rate", "1000") as simulator:
        simulator.process.send_signal(signal.SIGSTOP)
        command = (programs / "trocar-run", scene, "--asset", asset, *simulator.link(), "--simulated", "--record", record,
                   "--summary", summary, "--quiet")
        process = subprocess.Popen([str(word) for word in command], stderr=subprocess.PIPE, text=True)
        partial, end = record.with_name("kept.csv.partial"), time.monotonic() + READY_S
        while not partial.exists() and time.monotonic() < end:  # it is made before the device is reached
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        simulator.process.send_signal(signal.SIGCONT)
        code, stderr = outcome_of(process)
    assert (code, stderr) == (0, ""), f"{code}: {stderr!r}"
    assert json.loads(summary.read_text())["end"] == "interrupted"
    assert record.read_text() == "of an earlier session", "the recording was replaced"
    assert not partial.exists()


def too_long(source, programs, work, asset):
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


def test_told(source, programs, asset, scan, work):
    scene = work / "reach_end.json"
    scene.write_text(json.dumps(at_reach_end(source, asset)))
    faults_at_once(programs, work, scene)
    a_granted_recovery(source, programs, work, asset)
    connections(source, programs, work, asset)
    replays(source, programs, work, asset, scan)
    interrupted_at_once(source, programs, work, asset)
    too_long(source, programs, work, asset)
