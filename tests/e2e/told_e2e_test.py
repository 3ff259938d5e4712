# SPDX-License-Identifier: Apache-2.0
"""What the operator is told. (Lines of faults and recoveries: operator_messages_test; inputs that a replay needs: origin_test.)
 1. Another program in place of a device, and a name without an address, are different messages. (udp_device_test.cpp has the others.)
 2. Torques of a replay that differ are exit code 3. A replay of an interrupted session is interrupted, and that of a black box has its fault.
 3. A session whose recording may become too large to be read is warned of at its start.
"""
import contextlib
import json
import signal
import socket
import subprocess
import threading

from exported import rows_of
from programs import run

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
