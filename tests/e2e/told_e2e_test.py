# SPDX-License-Identifier: Apache-2.0
"""What the operator is told, and when.

 1. A fault is a line in a redirected log while the session goes on: name, sensor, value, limit, what to do. The summary has them.
 2. A recovery that is not granted says why, once for each reason, and a granted one says so.
 3. A device that cannot be reached, one with another key, one in another session, another program at its place, and a name
    without an address are different messages.
 4. A replay on another scene, asset, device or option is refused and names it; torques that differ are exit code 3. One of another
    version is replayed with a warning. A replay of an interrupted session is interrupted.
 5. A session that is interrupted before its first tick leaves the files of an earlier session as they were. One whose recording may become
    too large to be read is warned of at its start.
"""
import contextlib
import csv
import json
import os
import re
import signal
import socket
import struct
import subprocess
import threading
import time

from device_link import HELLO, HOLD, SIZES, Host, hello
from programs import run

READY_S = 20  # a limit for a hanging program, not a bound


class Simulator:
    """A running trocar-device-sim on a port of its own."""

    def __init__(self, programs, work, *arguments):
        self.key = work / "link.key"
        command = [programs / "trocar-device-sim", "--listen", "127.0.0.1:0", "--key-file", self.key, "--quiet", *arguments]
        self.process = subprocess.Popen([str(word) for word in command], stdout=subprocess.PIPE, text=True)
        self.address = self.process.stdout.readline().split()[2]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.communicate(timeout=READY_S)

    def link(self):
        return "--device", f"udp:{self.address}", "--key-file", self.key


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


def recoveries(source, programs, work, asset):
    """In virtual time, in lock-step with the device: the hand presses from 2.5 s on."""
    scene = source / "runtime" / "scenes" / "one_slice.json"
    for plan, wanted in (("stop@2.5..2.9", []),  # nothing but the operator resets a stop
                         ("jump:3:0.03@2.5..2.51", ["the tool is in material: lift it N mm"])):
        with Simulator(programs, work, scene, "--clock", "lock-step", "--faults", plan) as simulator:
            done = run(programs / "trocar-run", scene, "--asset", asset, *simulator.link(), "--clock", "virtual", "--recover", "auto", "--simulated", "--duration", "3.3",
                       "--quiet", cwd=work, expect=5)
        assert plan[:4] != "stop" or "fault emergency_stop at" in done.stderr, f"{plan}: {done.stderr}"
        told = [line for line in done.stderr.splitlines() if "no recovery yet" in line]
        reasons = [re.sub(r"lift it \d+ mm", "lift it N mm", line.partition(" s: ")[2]) for line in told]
        assert reasons == wanted, f"{plan}: told {told}"
        lift = re.search(r"lift it (\d+) mm", done.stderr)
        assert (lift is None and not wanted) or 1 <= int(lift[1]) <= 15, f"{plan}: {lift}"
    # A recovery that is granted.
    lifted = work / "lifted.json"
    up = json.loads(scene.read_text())
    up["hand"] = {"trajectory": [{"t_s": t, "tip_m": [0, 0, z]} for t, z in ((0, 0.148), (0.1, 0.148), (0.8, 0.245), (1.4, 0.148))]}
    up.update(asset=str(asset), duration_s=2.5)
    lifted.write_text(json.dumps(up))
    done = run(programs / "trocar-run", lifted, "--clock", "virtual", "--recover", "auto", "--quiet", cwd=work)
    lines = done.stderr.splitlines()
    assert len(lines) == 4 and "fault joint_limit" in lines[0] and "no recovery yet" in lines[1] and "recovered at" in lines[2] and "black box" in lines[3], f"a recovery: {lines}"


@contextlib.contextmanager
def program_at(answer):
    """A socket of this machine at which another program receives and, if `answer`, sends back what it gets."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        other.settimeout(0.1)
        done = threading.Event()

        def serve():
            while not done.is_set():
                try:
                    data, peer = other.recvfrom(512)
                except TimeoutError:
                    continue
                if answer:
                    other.sendto(data, peer)
        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield f"127.0.0.1:{other.getsockname()[1]}"
        finally:
            done.set()
            thread.join()


def outcome_of(process):
    """(exit code, stderr)"""
    _, stderr = process.communicate(timeout=READY_S)
    return process.returncode, stderr


def held_meanwhile(address, key, start):
    """(exit code, stderr) of start() while another host holds the session. That host has the longest period that there is, so that the
    drive waits for its commands longer than a machine stands still; an attempt in which it was late all the same does not count."""
    period_s = 0.1
    for _ in range(10):
        gaps_s, over = [], threading.Event()

        def hold():
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
                link.connect(address)
                link.settimeout(0.5)
                host, last = Host(link, key, period_s), time.monotonic()
                while not over.is_set():
                    host.command(HOLD)
                    time.sleep(0.002)
                    now = time.monotonic()
                    gaps_s.append(now - last)
                    last = now
        holder = threading.Thread(target=hold)
        holder.start()
        while holder.is_alive() and not gaps_s:
            time.sleep(0.01)
        code, stderr = outcome_of(start())
        over.set()
        holder.join()
        if gaps_s and max(gaps_s) <= period_s:  # the drive waits 2.5 of them
            break
        time.sleep(0.3)  # the drive lets the session go
    return code, stderr


def connections(source, programs, work, asset):
    scene, key, other_key = source / "runtime" / "scenes" / "one_slice.json", work / "link.key", work / "other.key"
    other_key.touch(mode=0o600)
    other_key.write_text("1" * 64 + "\n")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as closed:
        closed.bind(("127.0.0.1", 0))
        nobody = f"127.0.0.1:{closed.getsockname()[1]}"
    with Simulator(programs, work, scene, "--rate", "1000") as simulator, program_at(False) as silent, program_at(True) as echo:
        host, port = simulator.address.split(":")
        link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        link.connect((host, int(port)))
        link.settimeout(0.5)
        # To the byte, and one for many hellos; noise of a hello's size has no answer.
        nonce, answers = os.urandom(16), []
        for _ in range(20):
            link.send(os.urandom(SIZES[HELLO]))
            link.send(hello(os.urandom(32), nonce, 1e-3))
        with contextlib.suppress(TimeoutError):
            while True:
                answers.append(link.recv(512))
        denial = struct.pack("<4sBBHQQ", b"TRCR", 1, 5, 56, 0, 1)
        assert 1 <= len(answers) <= 5 and all(data[:24] == denial and data[32:] == nonce + b"\1" + bytes(7) for data in answers), f"denials: {answers}"
        cases = {"busy": (simulator.address, key, 5, "in a session with another host"),
                 "wrong key": (simulator.address, other_key, 5, "has another key; --key-file must be a copy"),
                 "nobody": (nobody, key, 5, "nothing listens on this port"),
                 "silent": (silent, key, 5, "cannot be reached"),
                 "echo": (echo, key, 5, "another program answers there, not a device"),
                 "name": ("no-such-host.invalid:4840", key, 2, 'the name "no-such-host.invalid" gives no address')}
        def start(name):
            address, key_file, _, _ = cases[name]
            return subprocess.Popen([str(word) for word in (programs / "trocar-run", scene, "--asset", asset, "--device", f"udp:{address}",
                                                            "--key-file", key_file, "--black-box", work)], stderr=subprocess.PIPE, text=True)
        others = {name: start(name) for name in cases if name != "busy"}
        outcomes = {name: outcome_of(process) for name, process in others.items()}
        outcomes["busy"] = held_meanwhile((host, int(port)), bytes.fromhex(key.read_text()), lambda: start("busy"))
        messages = set()
        for name, (returncode, stderr) in outcomes.items():
            _, _, code, words = cases[name]
            assert returncode == code and len(stderr.splitlines()) == 1 and words in stderr, f"{name}: {returncode}, {stderr!r}"
            messages.add(stderr.partition(": ")[2].partition(": ")[2])
        assert len(messages) == len(cases), f"the messages are not different: {messages}"
        link.close()


def ended(code, *command):
    """As run(), and goes on if the exit code is another."""
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    assert done.returncode == code, f"{' '.join(str(word) for word in command[1:])}: ended with {done.returncode}, not {code}: {done.stderr!r}"
    return done


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
    with recording.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0])[-1] == "origin" and all(None not in row and None not in row.values() for row in rows), "the columns"
    stated = rows[0].get("origin", "")
    assert stated.startswith("program=") and all(row["origin"] == "" for row in rows[1:]), f"{stated!r}"
    origin = dict(entry.partition("=")[::2] for entry in stated.split(";")) if stated else {"program": "", "scene": "", "asset": ""}
    for key, file in (("scene", scene_file), ("asset", asset)):
        digest = subprocess.run(["b2sum", "-l", "256", file], capture_output=True, text=True, check=True).stdout.split()[0]
        assert origin[key] == digest, f"{key}: {origin[key]}, b2sum {digest}"

    def refused(name, *words, arguments=(), file=scene_file, of=recording):
        done = ended(3, trocar_run, "replay", file, of, "--quiet", *arguments)
        lines = done.stderr.splitlines()
        assert done.returncode == 3 and len(lines) == 1 and lines[0].startswith(f"trocar-run: {of}: ") and all(word in lines[0] for word in words), f"{name}: {done.stderr!r}"

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
    for option, value, words in (("--passivity", "off", "passivity (on, here off)"), ("--coupling", "10000", "coupling (none, here 10000)"),
                                 ("--compensate", "weight", "compensate (none, here weight)"),
                                 ("--force-law", "network", "force-law (hooke, here network)"),
                                 ("--force-scale", "0.5", "force-scale (not stated, here 0.5)")):
        refused(option, words, arguments=(option, value))

    # Another version is a warning; torques that differ are not.
    lines = recording.read_text().splitlines(keepends=True)
    newer = work / "newer.csv"
    newer.write_text("".join(line.replace(f"program={origin['program']}", "program=99.1") for line in lines))
    done = run(trocar_run, "replay", scene_file, newer, "--quiet")
    assert len(done.stderr.splitlines()) == 1 and "version 99.1" in done.stderr and origin["program"] in done.stderr, f"another version: {done.stderr!r}"
    changed = work / "changed.csv"
    column = list(rows[0]).index("tau_1_1_Nm")
    at = next(i for i in range(1, len(lines)) if i > 300 and float(lines[i].split(",")[column]) != 0)
    fields = lines[at].split(",")
    fields[column] = repr(float(fields[column]) * (1 + 1e-15))
    changed.write_text("".join(lines[:at] + [",".join(fields)] + lines[at + 1:]))
    done = ended(3, trocar_run, "replay", scene_file, changed, "--quiet")
    assert f"the torques differ from the recording's from row {at} on" in done.stderr, f"other torques: {done.stderr!r}"
    silent = work / "silent.csv"
    silent.write_text(lines[0] + lines[1].rpartition(",")[0] + ",\n" + "".join(lines[2:]))
    refused("no origin", "does not say what it was recorded with", of=silent)
    # Hostile text.
    for bad in ("scene", "=1", "a=1;a=2", "a=1;", ";", "a=\x1b[2J", "a=" + "1" * 5000):
        forged = work / "forged.csv"
        forged.write_text(lines[0] + lines[1].rpartition(",")[0] + "," + bad + "\n" + "".join(lines[2:]))
        refused(f"origin {bad[:20]!r}", "line 2: origin is not KEY=VALUE", of=forged)
    twice = work / "twice.csv"
    twice.write_text("".join(lines[:2]) + lines[2].rstrip("\n") + "a=1\n" + "".join(lines[3:]))
    refused("an origin in the second row", "line 3: origin belongs to the first row only", of=twice)

    # Half a recording is replayed, and told; so is a session in which the tool touches nothing.
    short = work / "short.csv"
    short.write_text("".join(recording.read_text().splitlines(keepends=True)[:101]))
    done = run(trocar_run, "replay", scene_file, short)
    assert "short.csv: has 100 ticks, and its session was to last 800" in done.stderr, f"a short recording: {done.stderr}"
    assert "touched nothing" in done.stdout, f"100 ticks above the sheet: {done.stdout}"
    assert "has" not in run(trocar_run, "replay", scene_file, recording).stderr, "a whole recording is called short"

    # With --duration, the recording and not the scene says how long its session was to be.
    for duration_s, kept in ((0.5, 300), (1, 900)):
        planned, told = work / "planned.csv", work / "planned.json"
        run(trocar_run, scene_file, *virtual, "--duration", duration_s, "--record", planned)
        for ticks, end in ((round(1000 * duration_s), "done"), (kept, "interrupted")):
            planned.write_text("".join(planned.read_text().splitlines(keepends=True)[:ticks + 1]))
            done = run(trocar_run, "replay", scene_file, planned, "--summary", told, "--record", work / "again.csv")
            said = f"planned.csv: has {ticks} ticks, and its session was to last {round(1000 * duration_s)}: it ended early" in done.stderr
            assert said == (end == "interrupted"), f"{ticks} ticks of {duration_s} s: {done.stderr!r}"
            assert json.loads(told.read_text())["end"] == end, f"{ticks} ticks of {duration_s} s"
            assert (work / "again.csv").read_bytes() == planned.read_bytes(), f"{ticks} ticks of {duration_s} s: another recording"

    # A black box names its origin too, and the replay of a fault has the fault's exit code.
    reach = work / "reach.json"
    reach.write_text(json.dumps({**at_reach_end(source, asset), "duration_s": 1}))
    boxes = work / "boxes"
    boxes.mkdir()
    ended(5, trocar_run, reach, *virtual, "--black-box", boxes)
    box, = boxes.iterdir()
    ended(5, trocar_run, "replay", reach, box, "--quiet")
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


def test_told(source, programs, scan, work):
    asset, scene = work / "sample.glb", work / "reach_end.json"
    run(programs / "trocar-mesh", scan / "dicom", "-o", asset, "--quiet")
    scene.write_text(json.dumps(at_reach_end(source, asset)))
    faults_at_once(programs, work, scene)
    recoveries(source, programs, work, asset)
    connections(source, programs, work, asset)
    replays(source, programs, work, asset, scan)
    interrupted_at_once(source, programs, work, asset)
    too_long(source, programs, work, asset)
