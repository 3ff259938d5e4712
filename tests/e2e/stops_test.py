# SPDX-License-Identifier: Apache-2.0
"""Stops of a device and signals to the program, in lock-step with a drive of this test: the drive's time stands still while a
signal is delivered, so that the machine's speed does not matter. The hand's path is that of the scene with the simulated device."""
import json
import os
import re
import signal
import socket
import struct
import subprocess
import time

import device_link as link
import pytest
from exported import rows_of
from programs import run

PRESSED_S = (1.6, 4.0)


@pytest.fixture(name="scene", scope="module")
def pressing_scene(source, programs, asset, work):
    """A hand that presses 2 mm deep, lifts the tool, and presses again, to the end. Returns (scene, encoder angles of each tick)."""
    scene = json.loads((source / "runtime" / "scenes" / "one_slice.json").read_text())
    path = ((0, 0.13), (0.4, 0.118), (0.8, 0.118), (1.2, 0.13), (4.3, 0.13), (4.5, 0.118), (5, 0.118))
    scene.update(asset=str(asset), duration_s=5, hand={"trajectory": [{"t_s": t, "tip_m": [0, 0, z]} for t, z in path]})
    file, record = work / "scene.json", work / "path.csv"
    file.write_text(json.dumps(scene))
    run(programs / "trocar-run", file, "--clock", "virtual", "--record", record, "--quiet")
    angles = [[float(row[f"th_{leg}_{i}_rad"]) for leg in range(1, 5) for i in range(1, 5)] for row in rows_of(record)]
    return file, angles


class Drive:
    """A drive in lock-step that states the angles of a recorded session, and trocar-run on it."""

    def __init__(self, programs, work, scene, *options):
        self.file, self.angles = scene
        self.work, self.record, self.summary = work, work / "run.csv", work / "run.json"
        key_file = work / "link.key"
        self.key = os.urandom(32)
        key_file.touch(mode=0o600)
        key_file.write_text(self.key.hex() + "\n")
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.05)
        self.process = subprocess.Popen(
            [str(word) for word in (programs / "trocar-run", self.file, "--clock", "virtual", "--device", "udp:%s:%d" % self.socket.getsockname(),
                                    "--key-file", key_file, "--record", self.record, "--summary", self.summary, "--black-box", work,
                                    "--quiet", *options)], stderr=subprocess.PIPE, text=True)
        self.tick = self.sequence = self.reported_from = self.session = 0
        self.pressed, self.jumps, self.signals, self.torques = [], [], {}, []
        self.is_silent = False

    def is_pressed(self):
        return any(begin <= self.tick / 1000 < end for begin, end in self.pressed)

    def serve(self, until=None):
        """Answers the host until it has ended, or `until` is true."""
        while self.process.poll() is None and not (until and until()):
            try:
                data, self.host = self.socket.recvfrom(512)
            except TimeoutError:
                continue
            opened = link.open_packet(link.HELLO, self.key, data)
            if opened is not None:
                nonce, mine = opened[3][:16], os.urandom(16)
                self.session, self.sequence = int.from_bytes(mine[:8], "little"), 0
                self.session_key = link.session_key(self.key, nonce, mine)
                self.socket.sendto(link.welcome(self.key, nonce, mine, 2.5e-4, 2), self.host)
                continue
            opened = self.session and link.open_packet(link.COMMAND, self.session_key, data)
            if opened:
                self.take(opened)
        return self

    def take(self, opened):
        mode, seen, *torques = struct.unpack("<B7xQ8d", opened[3])
        if mode == link.STOP:
            return
        if self.is_pressed() and not self.reported_from:
            self.reported_from = self.sequence + 1
        if not self.is_pressed() and self.reported_from and seen >= self.reported_from and not any(torques):
            self.reported_from = 0
        if mode == link.TORQUE:
            self.torques.append(max(map(abs, torques)))
            self.tick += 1
        for number in self.signals.pop(self.tick, ()) if mode == link.TORQUE else ():
            self.process.send_signal(number)
            time.sleep(0.03)
        self.sequence += 1
        angles = list(self.angles[min(self.tick, len(self.angles) - 1)])
        for begin, end, encoder, by in self.jumps:
            angles[encoder] += by * (begin <= self.tick / 1000 < end)
        states = link.EMERGENCY_STOP if self.reported_from or self.is_pressed() else mode
        self.socket.sendto(link.state(self.session_key, self.session, self.sequence, states, 0, opened[1], angles, self.tick * 1_000_000), self.host)

    def finish(self):
        """(exit code, stderr, rows, summary); in the rows, the command of a tick is that of the drive, too."""
        self.serve()
        self.socket.close()
        errors = self.process.communicate(timeout=60)[1]
        return self.process.returncode, errors, rows_of(self.record), json.loads(self.summary.read_text())


@pytest.fixture(name="drive")
def drives(programs, place, scene):
    """Makes a drive; at the end its program is killed if it still runs."""
    made = []

    def make(*options):
        folder = place / str(len(made))
        folder.mkdir()
        made.append(Drive(programs, folder, scene, *options))
        return made[-1]

    yield make
    for each in made:
        each.process.kill()
        each.process.communicate()


def entries_into_running(rows):
    return [float(b["t_s"]) for a, b in zip(rows, rows[1:]) if b["safety"] == "running" != a["safety"]]


def test_a_request_while_the_stop_is_pressed(programs, drive):
    """Recovery is asked for while the device's stop is held: it is refused, and its release brings nothing back."""
    sim = drive("--recover", "signal")
    sim.pressed = [PRESSED_S]
    sim.signals = {2600: [signal.SIGUSR1]}
    code, errors, rows, summary = sim.finish()
    assert code == 5 and len(entries_into_running(rows)) == 1, (code, entries_into_running(rows))
    assert not any(sim.torques[1620:]), "force after the release"
    assert re.search(r"recovery refused at 2\.60\d+ s: the device's emergency stop is pressed, or was until now; release it", errors), errors
    assert [fault["fault"] for fault in summary["faults"]] == ["emergency_stop"]

    # Asked for again after the release, forces return.
    sim = drive("--recover", "signal")
    sim.pressed = [PRESSED_S]
    sim.signals = {2600: [signal.SIGUSR1], 4005: [signal.SIGUSR1]}
    code, errors, rows, summary = sim.finish()
    assert code == 0 and len(entries_into_running(rows)) == 2, (code, entries_into_running(rows), errors)
    assert summary["faults"][0]["recovered_t_s"] > 4.25 and any(sim.torques[4300:])
    run(programs / "trocar-run", "replay", sim.file, sim.record, "--recover", "signal", "--quiet")


def test_automatic_recovery_resets_no_stop(drive):
    sim = drive("--recover", "auto", "--simulated")
    sim.pressed = [PRESSED_S]
    sim.jumps = [(0.5, 0.6, 4, 0.2)]  # this fault ends by itself
    code, errors, rows, summary = sim.finish()
    assert code == 5 and len(entries_into_running(rows)) == 2, (code, entries_into_running(rows))
    assert not any(sim.torques[1620:]), "force after the release"
    assert [fault["fault"] for fault in summary["faults"]] == ["encoder_jump", "emergency_stop"], errors


@pytest.mark.parametrize("asks_at", [1200, 2000])
def test_a_stop_during_a_fault(drive, asks_at):
    """The stop is pressed while another fault is latched: it replaces the fault, is reported, and is in a black box of its own."""
    sim = drive("--recover", "signal")
    sim.jumps, sim.pressed = [(0.5, 0.6, 4, 0.2)], [(1.0, 1.5), (1.7, 1.8)]
    sim.signals = {asks_at: [signal.SIGUSR1]}
    code, errors, rows, summary = sim.finish()
    assert [fault["fault"] for fault in summary["faults"]] == ["encoder_jump", "emergency_stop", "emergency_stop"], errors
    assert errors.count("fault emergency_stop at ") == 2
    assert len(list(sim.work.glob("black_box_*_emergency_stop*.csv"))) == 2
    assert rows[1100]["fault"] == "emergency_stop"
    is_late = asks_at == 2000
    assert (code, len(entries_into_running(rows))) == ((0, 2) if is_late else (5, 1)), errors
    assert ("recovered at" in errors, "from the fault emergency_stop" in errors) == (is_late, is_late)
    assert ("recovery refused" in errors) != is_late


@pytest.mark.parametrize("number", [signal.SIGTSTP, signal.SIGTTOU])
def test_a_suspended_session(drive, number):
    """Ctrl-Z in contact: first the forces go to zero, then the process stops. Continued, the session is paused."""
    def is_stopped():
        with open(f"/proc/{sim.process.pid}/stat", encoding="ascii") as stat:
            return stat.read().rpartition(")")[2].split()[0] == "T"

    sim = drive("--recover", "signal")
    sim.signals = {500: [number]}
    sim.serve(until=is_stopped)
    assert 500 < sim.tick < 515 and sim.torques[-1] == 0 and sim.torques[500] > 0, (sim.tick, sim.torques[-20:])
    assert sorted(sim.torques[501:505], reverse=True) == sim.torques[501:505], "a ramp"
    sim.process.send_signal(signal.SIGCONT)
    stopped_at, until = sim.tick, time.monotonic() + 0.2
    sim.serve(until=lambda: time.monotonic() > until)
    assert sim.tick == stopped_at, "it goes on without a request"
    sim.process.send_signal(signal.SIGUSR1)
    code, errors, rows, summary = sim.finish()
    assert code == 0 and len(entries_into_running(rows)) == 2, errors
    assert [fault["fault"] for fault in summary["faults"]] == ["paused"]
    assert "is paused: resume it on its page, or let forces return with kill -USR1" in errors
    assert entries_into_running(rows)[1] > 1, "when the tool is out of the tissue"


@pytest.mark.parametrize("number", [signal.SIGQUIT, signal.SIGHUP, signal.SIGXCPU])
def test_a_signal_that_ends_the_session(drive, number):
    sim = drive()
    sim.signals = {500: [number]}
    code, errors, _, summary = sim.finish()
    assert code == 0 and summary["end"] == "interrupted", (code, errors)
    assert sim.torques[-2] > 0 == sim.torques[-1], "the last command is zero torques"
