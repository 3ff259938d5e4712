# SPDX-License-Identifier: Apache-2.0
"""fault_campaign_test.py SOURCE BIN SCAN WORK [--times N] [--only FAULT,...] [--seed N] [--jobs N]: every fault of the
device and its link, N times at random times while the tool is pressed into a sheet, with trocar-device-sim as a
separate process. Prints a table with one row per fault.

Required for each fault, by the drive's record (its steps, on its clock) and the session's files:
 - detected under load, latched, with the right name; torques zero at the drive within 5 ms of detection, and until
   forces are rendered again;
 - the recording has every tick; recovery happens on request only and brings the forces back.
Single losses, short delays, duplicates, reordering and flipped bits must cause no fault, and are counted.

All in real time. (Faults of encoders, motors and stops, at exact times: fault_injection_test, stops_test.py.)
A fault caused by the machine (a stalled process) is counted separately, and injections that it made void are repeated. If too
many were void, that fails unless the machine kept a sleeping program waiting, too.
"""
import argparse
import bisect
import csv
import json
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

from programs import run
from machine_stalls import MachineStalls

RATE_HZ = 1000
CYCLE_S, CONTACT_S = 0.75, (0.40, 0.52)  # of the hand's motion, and when in it the tool is in the sheet
CYCLES = 10  # of a session
TO_ZERO_S = 0.005
WATCHDOG_S = 0.01  # of the drive
LOADED_NM = 0.1
STALLS = {"no_data", "link_lost", "deadline_missed"}


class Kind:
    """How a fault is injected, and its required effect."""

    def __init__(self, plan, names=(), within_s=0.02, counted=None, own_s=None):
        self.plan = plan          # function of (random, time): the fault plan's item
        self.names = set(names)   # allowed names of the fault; empty: no fault may occur
        self.within_s = within_s  # longest time from the injection to the detection
        self.counted = counted    # function of (summary, simulator's summary): number of packets counted as faulty
        self.own_s = own_s        # the drive itself zeroes the torques within this time


def refused(words):
    def count(ours, drives):
        return sum(ours["link"]["packets_refused"][w] + drives["packets"]["refused"][w] for w in words)
    return count


def missed(ours, drives):
    return ours["link"]["states_missed"] + drives["commands_missed"]


def timed(item, lasts_s):
    return lambda random, at: f"{item}@{at:.5f}..{at + lasts_s:.5f}"


CORRUPTED = ("size", "magic", "kind", "session", "mac", "contents")
KINDS = {
    "drive_killed_real": Kind(lambda r, at: f"kill@{at:.5f}", ["link_lost", "no_data"], 0.02, own_s=0.001),
    "loss_of_states": Kind(timed("state-loss:1", 0.04), ["link_lost", "no_data"], 0.02),
    "loss_of_commands": Kind(timed("command-loss:1", 0.04), ["link_lost"], 0.02, own_s=0.0115),
    "loss_both_ways": Kind(timed("loss:1", 0.04), ["link_lost", "no_data"], 0.02, own_s=0.0115),
    "delay_30ms": Kind(timed("delay:1:30", 0.06), ["link_lost", "no_data"], 0.02, own_s=0.0115),
    "host_killed": Kind(None, (), 0, own_s=0.0115),
    "single_loss": Kind(timed("loss:1", 0.001), counted=missed),
    "delay_2ms": Kind(timed("delay:1:2", 0.03), counted=lambda *_: 1e9),
    "duplication": Kind(timed("duplicate:1", 0.01), counted=refused(["sequence"])),
    "reordering": Kind(timed("reorder:0.4", 0.01), counted=refused(["sequence"])),
    "bit_flip": Kind(timed("flip:1", 0.001), counted=refused(CORRUPTED)),
}


class Row:
    """A row of the table."""

    def __init__(self, seed):
        self.random = random.Random(seed)
        self.times = self.found = self.named = self.recovered = self.rows_lost = self.machine = self.void = 0
        self.counted = 0
        self.to_zero_s, self.from_moment_s = [], []
        self.failures = []
        self.missing = None  # why there were too few injections

    def fail(self, message):
        self.failures.append(message)


class Simulator:
    """trocar-device-sim for one session, and its record and summary afterwards."""

    def __init__(self, rig, row, folder, faults, address="127.0.0.1:0"):
        self.files = folder / "drive.csv", folder / "drive.json"
        for file in self.files:
            file.unlink(missing_ok=True)
        command = [rig.programs / "trocar-device-sim", rig.scene, "--listen", address, "--key-file", folder / "key", "--clock", "real",
                   "--seed", row.random.getrandbits(32), "--record", self.files[0], "--summary", self.files[1], "--quiet", *rig.device]
        if faults:
            command += ["--faults", faults]
        self.process = subprocess.Popen([str(word) for word in command], stdout=subprocess.PIPE, text=True)
        self.address = self.process.stdout.readline().split()[2]

    def end(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        self.process.communicate(timeout=30)

    def steps(self):
        """(times, commanded, applied, modes, sessions, commands taken): one entry per step of the drive."""
        with self.files[0].open() as file:
            rows = list(csv.reader(file))[1:]
        return ([float(r[1]) for r in rows], [float(r[6]) for r in rows], [float(r[7]) for r in rows],
                [r[2] for r in rows], [int(r[0]) for r in rows], [int(r[5]) for r in rows])

    def summary(self):
        return json.loads(self.files[1].read_text())


class Recording:
    def __init__(self, file):
        self.lines = file.read_text().splitlines()
        head = {name: i for i, name in enumerate(self.lines[0].split(","))}
        self.torque, self.safety, self.fault, self.outside, self.requested, self.t_s = [], [], [], [], [], []
        first = head["tau_1_1_Nm"]
        for line in self.lines[1:]:
            cells = line.split(",")
            self.torque.append(max(abs(float(cell)) for cell in cells[first:first + 8]))
            self.safety.append(cells[head["safety"]])
            self.fault.append(cells[head["fault"]])
            self.outside.append(cells[head["outside_fault"]])
            self.requested.append(cells[head["recovery_asked"]] == "1")
            self.t_s.append(float(cells[head["t_s"]]))


class Rig:
    """Scene, programs and a folder for each session."""

    def __init__(self, source, programs, scan, work):
        self.programs, self.work = programs, work
        self.sessions, self.lock = 0, threading.Lock()
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(parents=True)
        asset = work / "sample.glb"
        run(programs / "trocar-mesh", scan / "dicom", "-o", asset, "--quiet")
        scene = json.loads((source / "runtime" / "scenes" / "one_slice.json").read_text())
        scene.update(asset=str(asset), duration_s=3600)
        scene["tissue"] = {"stiffness_N_per_m": 5000, "threshold_N": 1000}
        keys = []
        for cycle in range(CYCLES + 3):
            for at, x, y, z in ((0.30, 0, 0, 0.124), (0.38, 0, 0, 0.113), (0.53, 0.008, 0.005, 0.109), (0.60, 0.008, 0.005, 0.124)):
                keys.append({"t_s": round(cycle * CYCLE_S + at, 5), "tip_m": [x, y, z]})
        scene["hand"] = {"trajectory": [{"t_s": 0, "tip_m": keys[0]["tip_m"]}] + keys}
        self.scene = work / "scene.json"
        self.scene.write_text(json.dumps(scene))
        # Exact encoders: rounded ones repeat torques, by which the drive's steps are told apart.
        device = json.loads((source / "formats/session/four_legs.json").read_text())
        device["simulation"]["encoder_counts_per_revolution"] = 0
        self.device = ("--device-description", work / "exact.json")
        self.device[1].write_text(json.dumps(device))

    def folder(self):
        with self.lock:
            self.sessions += 1
            made = self.work / str(self.sessions)
        made.mkdir()
        return made

    def start(self, simulator, folder, kind, duration_s):
        command = [self.programs / "trocar-run", self.scene, "--device", f"udp:{simulator.address}", "--key-file", folder / "key",
                   "--clock", "real", "--rate", RATE_HZ, "--duration", duration_s, "--recover", "signal", "--record", folder / "run.csv",
                   "--summary", folder / "run.json", "--black-box", folder, "--quiet", *self.device]
        return subprocess.Popen([str(word) for word in command], stderr=subprocess.PIPE, text=True)


def operator(process, folder):
    """Requests recovery shortly after each new black box, like an operator, and some times again: it may have been too early."""
    seen, requests = 0, []
    while process.poll() is None:
        boxes = len(list(folder.glob("black_box_*.csv")))
        if boxes > seen:
            seen = boxes
            requests = [time.monotonic() + after_s for after_s in (0.02, 0.2, 0.4)]
        if requests and time.monotonic() >= requests[0]:
            requests.pop(0)
            process.send_signal(signal.SIGUSR1)
        time.sleep(0.01)


def check_files(row, recording, report, folder, duration_s):
    """The recording has every tick. (Black boxes: fault_injection_test.)"""
    expected = round(duration_s * RATE_HZ)
    row.rows_lost += expected - (len(recording.lines) - 1)
    if report["ticks"] != expected or len(recording.lines) - 1 != expected:
        row.fail(f"{folder.name}: {len(recording.lines) - 1} rows, {report['ticks']} ticks of {expected}")
    for event in report["faults"]:  # a session may end before torques are zero only this soon after a fault
        if event["torques_zero_t_s"] is None and event["t_s"] < duration_s - 0.005:
            row.fail(f"{folder.name}: the torques of {event['fault']} at {event['t_s']} s were never zero")


def first_steps(steps):
    """{largest torque of a command: first step of the drive with it}."""
    first = {}
    for i, value in enumerate(steps[1]):
        if value > 0:
            first.setdefault(value, i)
    return first


def on_drives_clock(recording, steps, first_step, event):
    """Time of a fault's detection on the drive's clock, from the last torques before it that the drive received. A single
    offset of the two clocks would be inexact, since a busy machine delays either process."""
    k = round(event["t_s"] * RATE_HZ)
    for row in range(k - 1, max(-1, k - 100), -1):
        if recording.torque[row] in first_step:
            return steps[0][first_step[recording.torque[row]]] + (k - row) / RATE_HZ
    return None


def check_latch(row, recording, event, last_moment, folder):
    """Checks the session's rows from a fault to its recovery."""
    k = round(event["t_s"] * RATE_HZ)
    rest = round(event["torques_zero_t_s"] * RATE_HZ)
    where = f"{folder.name}: {event['fault']} at {event['t_s']} s"
    requested = next((i for i in range(k, len(recording.t_s)) if recording.requested[i]), len(recording.t_s))
    if any(s != "fault" for s in recording.safety[k:min(requested, len(recording.safety))]):
        row.fail(f"{where}: recovered without a request")
    if rest - k > TO_ZERO_S * RATE_HZ or any(recording.torque[rest:requested]):
        row.fail(f"{where}: torques {rest - k} ticks later, or again")
    if event["recovered_t_s"] is None:
        if not last_moment:
            row.fail(f"{where}: no recovery")
        return last_moment
    back = round(event["recovered_t_s"] * RATE_HZ)
    if any(recording.torque[rest:back]):
        row.fail(f"{where}: torques before the recovery")
    if any(f != event["fault"] for f, s in zip(recording.fault[k:back], recording.safety[k:back]) if s != "ready"):
        row.fail(f"{where}: the fault's name changed")
    return True


def stalled_before_zero(row, kind, steps, moment_s, folder):
    """True if the machine stalled the host before torques were zero, though no command was held back. Then the drive's
    watchdog must zero the torques in time."""
    if kind.own_s is not None:
        return False
    times, _, applied, modes, _, taken = steps
    zero = next((i for i in range(bisect.bisect_left(times, moment_s), len(times)) if applied[i] == 0), None)
    if zero is None or modes[zero] != "watchdog":
        return False
    last = next(i for i in range(zero, -1, -1) if i == 0 or taken[i - 1] != taken[zero])
    if times[zero] - times[last] > WATCHDOG_S + 2 * (times[1] - times[0]) + 1e-9:
        row.fail(f"{folder.name}: the watchdog took {(times[zero] - times[last]) * 1e3:.2f} ms")
    return True


def steps_to_zero(steps, first_step, recording, event, moment_s):
    """The drive's steps in which a fault first shows and in which its torques are zero; the number of its steps if there is none."""
    times, _, applied, modes, _, _ = steps
    at = bisect.bisect_left(times, moment_s)
    k = round(event["t_s"] * RATE_HZ)
    ramp = [first_step[v] for v in recording.torque[k:k + 5] if v in first_step]
    own = next((i for i in range(at, len(times)) if modes[i] != "torque"), len(times))
    zero = next((i for i in range(at, len(times)) if applied[i] == 0), len(times))
    return min(ramp + [own, zero]), zero


def stalled_in_ramp(steps, first_step, recording, event, moment_s):
    """True if the machine stalled the host while its torques went to zero: the drive got no command for longer than the ramp's
    bound leaves, or its watchdog zeroed them."""
    found, zero = steps_to_zero(steps, first_step, recording, event, moment_s)
    times, _, _, modes, _, taken = steps
    if zero == len(times) or times[zero] - times[found] <= TO_ZERO_S + 1e-9:
        return False
    new = [found] + [i for i in range(found + 1, zero + 1) if taken[i] != taken[i - 1]] + [zero]
    return modes[zero] == "watchdog" or max(times[b] - times[a] for a, b in zip(new, new[1:])) > 2 / RATE_HZ


def check_drive(row, kind, steps, first_step, recording, event, moment_s, folder):
    """Checks by the drive's record how the torques went to zero."""
    times, _, applied, modes, _, _ = steps
    step_s = times[1] - times[0]
    found, zero = steps_to_zero(steps, first_step, recording, event, moment_s)
    if zero == len(times):
        row.fail(f"{folder.name}: no zero torque at the drive after {event['fault']}")
        return
    to_zero, from_moment = times[zero] - times[found], times[zero] - step_s - moment_s
    row.to_zero_s.append(to_zero)
    row.from_moment_s.append(max(0.0, from_moment))
    if to_zero > TO_ZERO_S + 1e-9:
        row.fail(f"{folder.name}: {to_zero * 1e3:.2f} ms to zero at the drive after {event['fault']} at {event['t_s']} s")
    if kind.own_s is not None and from_moment > kind.own_s + step_s + 1e-9:
        row.fail(f"{folder.name}: the drive itself took {from_moment * 1e3:.2f} ms")
    # The next torques at the drive must be those of the session's rows after its recovery.
    back = round(event["recovered_t_s"] * RATE_HZ) if event["recovered_t_s"] is not None else len(recording.torque)
    again = next((i for i in range(zero, len(times)) if applied[i] != 0), len(times))
    if again < len(times) and steps[1][again] not in set(recording.torque[back:]):
        row.fail(f"{folder.name}: torques at the drive again at {times[again]} s, before the recovery")


def stalled_in_recovery(recording, event):
    """True if the machine kept a session from recovering that had been asked to: it waits for 0.25 s without a fault and with the
    tool in free space, which every cycle of the hand has, and no cycle long was it without a fault of the machine."""
    if event["recovered_t_s"] is not None:
        return False
    stalls = quiet = 0
    for k in range(round(event["t_s"] * RATE_HZ), len(recording.t_s)):
        is_stalled = recording.outside[k] in STALLS
        quiet = quiet + 1 if recording.safety[k] == "recovering" and not is_stalled else 0
        stalls += recording.safety[k] == "recovering" and is_stalled
        if quiet >= CYCLE_S * RATE_HZ:
            return False
    return stalls > 0


def many(rig, name, kind, row, wanted):
    """One session with a fault in each of its cycles."""
    folder = rig.folder()
    count = min(wanted, CYCLES)
    moments = [cycle * CYCLE_S + row.random.uniform(*CONTACT_S) for cycle in range(count)]
    plan = ",".join(kind.plan(row.random, at) for at in moments) if kind.plan else ""
    duration_s = round((count + 1) * CYCLE_S, 3)
    simulator = Simulator(rig, row, folder, plan)
    process = rig.start(simulator, folder, kind, duration_s)
    threading.Thread(target=operator, args=(process, folder), daemon=True).start()
    stderr = process.communicate(timeout=300)[1]
    simulator.end()
    if process.returncode not in (0, 5) or not (folder / "run.csv").exists():
        row.fail(f"{folder.name}: trocar-run ended with {process.returncode}: {stderr}")
        return 0
    report, recording = json.loads((folder / "run.json").read_text()), Recording(folder / "run.csv")
    check_files(row, recording, report, folder, duration_s)
    steps = simulator.steps()
    done = check_moments(kind, row, moments, report, recording, steps, folder)
    if kind.counted and done:
        row.counted += min(kind.counted(report, simulator.summary()), 10**6)
    if not row.failures:
        shutil.rmtree(folder)
    return done


def check_moments(kind, row, moments, report, recording, steps, folder):
    times, _, applied, _, _, _ = steps
    first_step = first_steps(steps)
    events = list(report["faults"])
    for event in events:
        event["drive_s"] = on_drives_clock(recording, steps, first_step, event)
    done = 0
    for i, moment_s in enumerate(moments):
        at = bisect.bisect_left(times, moment_s) - 1
        found = [e for e in events if e["drive_s"] is not None and -0.003 <= e["drive_s"] - moment_s <= kind.within_s + 0.003]
        # A fault caused by the machine came before, and torques may not have been zero yet.
        own = [e for e in events if e["fault"] in STALLS and e["drive_s"] is not None
               and e not in found and moment_s - TO_ZERO_S - WATCHDOG_S <= e["drive_s"] < moment_s]
        if applied[at] < LOADED_NM or own:
            row.void += 1
            continue
        if not kind.names:
            if found and {e["fault"] for e in found} <= STALLS:
                row.machine += 1
                continue
            row.times += 1
            done += 1
            if found:
                row.fail(f"{folder.name}: {found[0]['fault']} at {moment_s:.4f} s, where none may occur")
            else:
                row.found += 1
            continue
        late = [e["fault"] for e in found] == ["deadline_missed"]  # the machine stalled first
        if late or (len(found) == 1 and (stalled_before_zero(row, kind, steps, moment_s, folder) or
                                         stalled_in_ramp(steps, first_step, recording, found[0], moment_s) or
                                         (i + 1 < len(moments) and stalled_in_recovery(recording, found[0])))):
            row.machine += 1
            row.void += 1
            events.remove(found[0])
            check_latch(row, recording, found[0], True, folder)
            continue
        row.times += 1
        done += 1
        if len(found) != 1:
            row.fail(f"{folder.name}: {len(found)} faults after {moment_s:.4f} s")
            continue
        event = found[0]
        events.remove(event)
        row.found += 1
        if event["fault"] in kind.names:
            row.named += 1
        else:
            row.fail(f"{folder.name}: named {event['fault']} at {moment_s:.4f} s")
        row.recovered += check_latch(row, recording, event, i + 1 == len(moments) and event["recovered_t_s"] is None, folder)
        check_drive(row, kind, steps, first_step, recording, event, moment_s, folder)
    for event in events:
        if event["fault"] in STALLS:
            row.machine += 1
        elif kind.names:
            row.fail(f"{folder.name}: {event['fault']} at {event['t_s']} s without an injection")
    return done


def await_end(first, other):
    """True if the first process ends before the other one."""
    while first.poll() is None:
        if other.poll() is not None:
            time.sleep(0.2)
            return first.poll() is not None
        time.sleep(0.002)
    return True


def killed_drive(rig, name, kind, row, _):
    """One session whose drive is killed and restarted."""
    folder = rig.folder()
    moment_s = row.random.uniform(*CONTACT_S)
    duration_s = 3.25  # long enough for a slow start and for the hand to come back a second time
    simulator = Simulator(rig, row, folder, kind.plan(row.random, moment_s))
    process = rig.start(simulator, folder, kind, duration_s)
    threading.Thread(target=operator, args=(process, folder), daemon=True).start()
    if not await_end(simulator.process, process):
        stderr = process.communicate(timeout=30)[1]
        simulator.end()
        if process.returncode == 5 and any(f"_{name}.csv" in stderr for name in STALLS):
            row.void += 1  # stopped by the machine before the kill
            row.machine += 1
        else:
            row.fail(f"{folder.name}: trocar-run ended with {process.returncode}: {stderr}")
        return 0
    steps = simulator.steps()
    if simulator.process.returncode != -signal.SIGKILL:
        row.fail(f"{folder.name}: the simulator ended with {simulator.process.returncode}")
    again = Simulator(rig, row, folder, "", simulator.address)
    stderr = process.communicate(timeout=300)[1]
    again.end()
    if process.returncode not in (0, 5) or not (folder / "run.csv").exists():
        row.fail(f"{folder.name}: trocar-run ended with {process.returncode}: {stderr}")
        return 0
    report, recording = json.loads((folder / "run.json").read_text()), Recording(folder / "run.csv")
    check_files(row, recording, report, folder, duration_s)
    if steps[2][-1] < LOADED_NM:
        row.void += 1
        return 0
    first_step = first_steps(steps)
    for event in report["faults"]:
        event["drive_s"] = on_drives_clock(recording, steps, first_step, event)
    events = [e for e in report["faults"] if e["drive_s"] is not None and e["drive_s"] >= moment_s - 0.003]
    if len(events) == 1 and events[0]["recovered_t_s"] is None and (stalled_in_recovery(recording, events[0]) or any(
            e["fault"] in STALLS and e["t_s"] > events[0]["t_s"] and e["recovered_t_s"] is not None for e in report["faults"])):
        row.void += 1  # the machine stalled a process during the recovery, which it recovered from afterwards or not at all
        row.machine += 1
        return 0
    if events and events[0]["fault"] == "deadline_missed":
        row.void += 1  # the machine stalled first
        row.machine += 1
        return 0
    row.times += 1
    if not events or events[0]["drive_s"] > moment_s + kind.within_s + 0.003:
        row.fail(f"{folder.name}: {report['faults']}")
        return 1
    event = events[0]
    row.found += 1
    row.named += event["fault"] in kind.names
    row.machine += len(report["faults"]) - 1
    if event["fault"] not in kind.names:
        row.fail(f"{folder.name}: named {event['fault']}")
    # Torques after the recovery are those of the new process.
    after = again.steps()
    largest_Nm = max(after[2]) if after[2] else 0
    if event["recovered_t_s"] is None or (largest_Nm < LOADED_NM and len(report["faults"]) == 1):
        row.fail(f"{folder.name}: no recovery with the new process: {report['faults']}")
    else:
        row.recovered += check_latch(row, recording, event, False, folder)
    row.to_zero_s.append(0.0)  # torques end with the process
    row.from_moment_s.append(max(0.0, steps[0][-1] - moment_s))
    if report["link"]["sessions"] < 2:
        row.fail(f"{folder.name}: {report['link']['sessions']} sessions")
    if not row.failures:
        shutil.rmtree(folder)
    return 1


def killed_host(rig, name, kind, row, _):
    """trocar-run is killed under load: the drive's watchdog trips; then another host gets a session."""
    folder = rig.folder()
    simulator = Simulator(rig, row, folder, "")
    process = rig.start(simulator, folder, kind, 2.0)
    time.sleep(0.1 + row.random.uniform(*CONTACT_S))
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=30)
    second = rig.start(simulator, folder, kind, 0.6)
    stderr = second.communicate(timeout=60)[1]
    simulator.end()
    times, _, applied, modes, sessions, _ = simulator.steps()
    last = max((i for i in range(len(times)) if sessions[i] == 1 and modes[i] == "torque"), default=0)
    if not applied or applied[last] < LOADED_NM:
        row.void += 1
        return 0
    row.times += 1
    row.found += modes[min(last + 1, len(modes) - 1)] == "watchdog"
    row.named += modes[min(last + 1, len(modes) - 1)] == "watchdog"
    # Age of its last command: from the step in which it was received.
    with simulator.files[0].open() as file:
        taken = [int(r["command_taken"]) for r in csv.DictReader(file)]
    first = next(i for i in range(len(times)) if sessions[i] == 1 and taken[i] == taken[last])
    row.to_zero_s.append(0.0)
    row.from_moment_s.append(times[last] - times[first])
    if times[last] - times[first] > kind.own_s:
        row.fail(f"{folder.name}: the drive kept a killed host's torques for {(times[last] - times[first]) * 1e3:.2f} ms")
    if any(applied[i] for i in range(last + 1, len(times)) if sessions[i] == 1):
        row.fail(f"{folder.name}: torques of a killed host")
    report = json.loads((folder / "run.json").read_text()) if (folder / "run.json").exists() else {"faults": [{"fault": stderr}]}
    if second.returncode == 0 and max(a for a, s in zip(applied, sessions) if s == 2) > LOADED_NM:
        row.recovered += 1
    elif {e["fault"] for e in report["faults"]} <= STALLS:
        row.machine += 1
        row.recovered += 1
    else:
        row.fail(f"{folder.name}: the next host: {second.returncode} {stderr}")
    if (folder / "run.csv").exists() and len((folder / "run.csv").read_text().splitlines()) != 601 and second.returncode == 0:
        row.fail(f"{folder.name}: the next host's recording is incomplete")
    if not row.failures:
        shutil.rmtree(folder)
    return 1


def campaign(rig, name, kind, times, seed):
    start = time.monotonic()
    row = Row(f"{seed} {name}")
    one = killed_host if name == "host_killed" else killed_drive if name.startswith("drive_killed") else many
    for _ in range(2 * times + 8):
        if row.times >= times or len(row.failures) >= 5:
            break
        one(rig, name, kind, row, times - row.times)
    if row.times < times and not row.failures:
        row.missing = f"only {row.times} of {times} injections that the machine did not make void"
    if kind.counted and row.counted < row.times:
        row.fail(f"{row.counted} counted of {row.times}")
    row.took_s = time.monotonic() - start
    return row


def largest_ms(values):
    return f"{max(values) * 1e3:.2f}" if values else "-"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folders", nargs=4, type=pathlib.Path)
    parser.add_argument("--times", type=int, default=3)
    parser.add_argument("--only", default="")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=4, help="faults tested at the same time")
    options = parser.parse_args()
    rig = Rig(*options.folders)
    names = [name for name in KINDS if not options.only or name in options.only.split(",")]
    failed, missing = 0, 0
    print(f"{'fault':21} {'times':>5} {'found':>5} {'named':>5} {'recovered':>9} {'rows lost':>9} {'to zero ms':>10} {'since begin ms':>14} "
          f"{'counted':>7} {'machine':>7} {'void':>5} {'s':>4}")
    with MachineStalls() as machine, ThreadPoolExecutor(options.jobs) as pool:
        rows = [pool.submit(campaign, rig, name, KINDS[name], options.times, options.seed) for name in names]
        for name, future in zip(names, rows):
            row, kind = future.result(), KINDS[name]
            survives = not kind.names and name != "host_killed"
            of_faults = ["-"] * 3 if survives else [row.found, row.named, row.recovered]
            counted = row.counted if kind.counted and row.counted < 10**6 else "-"
            print(f"{name:21} {row.times:5} {of_faults[0]:>5} {of_faults[1]:>5} {of_faults[2]:>9} {row.rows_lost:9} "
                  f"{largest_ms(row.to_zero_s):>10} {largest_ms(row.from_moment_s):>14} {counted:>7} {row.machine:7} {row.void:5} "
                  f"{row.took_s:4.0f}", flush=True)
            for line in [*row.failures[:5], *filter(None, [row.missing])]:
                print("   ", line)
            failed += len(row.failures)
            missing += row.missing is not None
    print(machine)
    if missing and machine.is_on_time:
        print("FAILED injections are missing, though the machine was on time")
        failed += missing
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
