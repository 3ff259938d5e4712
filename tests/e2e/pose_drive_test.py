# SPDX-License-Identifier: Apache-2.0
"""formats/examples/pose_drive.cpp, the example of a drive that states poses, with a host of another implementation (device_link.py).

It is compiled as its first lines say, and once more with an emergency stop, a fault and buttons in place of its simulated device.
"""
import math
import os
import re
import signal
import socket
import struct
import subprocess
import time

import device_link as link
import pytest
from programs import SOURCE, run

EXAMPLE = SOURCE / "formats" / "examples" / "pose_drive.cpp"
RESTS = "return {{x_m[0], x_m[1], x_m[2]}, {1, 0, 0, 0}, 0, 0, false};"
REPORTS = ('const auto is_there = [](const char* file) { return access(file, F_OK) == 0; };\n'
           '  return {{x_m[0], x_m[1], x_m[2]}, {0.6, 0, 0.8, 0}, 9, uint8_t(is_there("fault") ? 4 : 0), is_there("stop")};')


def build(folder, text):
    """Compiles the text in the folder as it says."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "pose_drive.cpp").write_text(text, encoding="utf-8")
    command = re.search(r"^//   (g\+\+ .*) && \./pose_drive link\.key 7700$", text, re.M)[1]
    run(*command.split(), "-Wall", "-Wextra", "-Werror", cwd=folder)
    return folder / "pose_drive"


@pytest.fixture(name="example", scope="module")
def built_example(work):
    return build(work / "example", EXAMPLE.read_text(encoding="utf-8"))


class Drive:
    """A running drive. `key` is the shared key, `host()` begins a session."""

    def __init__(self, program, *options):
        self.program, self.options, self.key = program, options, os.urandom(32)

    def __enter__(self):
        folder = self.program.parent
        for name in ("stop", "fault"):
            (folder / name).unlink(missing_ok=True)
        (folder / "link.key").write_text(self.key.hex() + "\n", encoding="ascii")
        (folder / "link.key").chmod(0o600)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        command = [self.program, "link.key", str(self.port), *self.options]
        self.process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout.readline() == f"ready on 127.0.0.1:{self.port}\n"
        return self

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGTERM)
        self.process.communicate(timeout=10)
        assert self.process.returncode == 0

    def socket(self, timeout_s=0.5):
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.connect(("127.0.0.1", self.port))
        made.settimeout(timeout_s)
        return made

    def host(self, **options):
        host = link.PoseHost(self.socket(), self.key, **options)
        host.command(link.HOLD)
        assert host.state() is not None
        return host

    def denial(self, key, contents=link.POSE):
        """The reason of the denial that a hello gets."""
        nonce = os.urandom(16)
        with self.socket() as asking:
            for _ in range(20):
                asking.send(link.hello(key, nonce, 1e-3, contents=contents))
                answer = asking.recv(512)
                if len(answer) == 56 and answer[5] == link.DENIAL:
                    assert answer[:32] == struct.pack("<4sBBHQQ", b"TRCR", 1, link.DENIAL, 56, 0, 1) + answer[24:32]
                    assert answer[32:48] == nonce and answer[49:] == bytes(7)
                    return answer[48]
        return None


def newest(host, wait_s=0.0):
    """The newest state after a time, in which the socket must not fill up (about 100 ms)."""
    time.sleep(wait_s)
    found = None
    host.socket.settimeout(0.0)
    while (state := host.state()) is not None:
        found = state
    host.socket.settimeout(0.5)
    return found or host.state()


def push(host, wrench, seconds):
    """Commands the wrench for a time, and returns the states."""
    states, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        host.command(link.TORQUE, wrench)
        states.append(host.state())
    return [state for state in states if state is not None]


def acknowledge(host):
    """Sends zeros until the drive is ready for a wrench again."""
    for _ in range(50):
        state = newest(host, 0.01)
        if state["mode"] == link.READY:
            return state
        host.command(link.HOLD)
    return state


def test_states_and_wrench(example):
    with Drive(example) as drive:
        host = drive.host()
        states = push(host, (2, -1, 0.5, 0, 0, 0), 1.0)
        times = [state["time_ns"] for state in states]
        assert times == sorted(set(times)), "times that do not rise"
        rate = (states[-1]["sequence"] - states[0]["sequence"]) / (times[-1] - times[0]) * 1e9
        assert rate < 2100, f"{rate} states a second"
        assert link.TORQUE_ON in {state["mode"] for state in states}
        last = states[-1]
        assert last["orientation"] == [1, 0, 0, 0] and last["faults"] == 0 and last["buttons"] == 0
        if all(state["mode"] == link.TORQUE_ON for state in states[10:]):  # no stall of this machine
            for position, force, rest in zip(last["position"], (2, -1, 0.5), (0, 0, 0.02)):
                assert abs(position - rest - force / 1000) < 3e-4, f"the hand's spring gives {last['position']}"


def test_watchdog_is_acknowledged(example):
    with Drive(example) as drive:
        host = drive.host()
        push(host, (3, 0, 0, 0, 0, 0), 0.1)
        before = host.seen
        state = newest(host, 0.2)
        assert state["mode"] == link.WATCHDOG
        assert abs(newest(host, 0.3)["position"][0]) < 1e-3, "the force did not end"
        # Neither a wrench, nor zeros that were sent before the host knew, nor repeated packets bring the force back.
        modes = set()
        for _ in range(20):
            host.command(link.TORQUE, (3, 0, 0, 0, 0, 0))
            host.command(link.TORQUE, (0,) * 6, seen=before)
            modes.add(newest(host, 0.002)["mode"])
        for data in host.sent[:]:
            host.socket.send(data)
            modes.add(host.state()["mode"])
        assert modes == {link.WATCHDOG}
        assert newest(host, 0.01)["command_taken"] == host.sequence
        assert acknowledge(host)["mode"] == link.READY
        assert link.TORQUE_ON in {state["mode"] for state in push(host, (3, 0, 0, 0, 0, 0), 0.1)}


@pytest.mark.parametrize("options, period_s", [(("move",), 1e-3), ((), 0.1)])
def test_watchdog_waits_for_a_slow_host(example, options, period_s):
    """The moving handle rides out a stall; the resting one waits for 2.5 periods."""
    with Drive(example, *options) as drive:
        host = drive.host(period_s=period_s)
        begun = time.monotonic()
        host.command(link.TORQUE, (1, 0, 0, 0, 0, 0))
        while (state := host.state())["mode"] != link.WATCHDOG:
            assert time.monotonic() < begun + 5
        assert time.monotonic() - begun > 0.24
        assert state["command_taken"] == host.sequence


def test_refused_packets_change_nothing(example):
    with Drive(example) as drive:
        host = drive.host()
        good = host.sent[-1]
        host.command(link.HOLD)
        number, key = host.session, host.session_key
        refused = [good, good[:-1], good + b"\0", bytes(200), b"", b"TRCR", good[:60] + b"\1" + good[61:]]
        for mode, wrench in ((link.TORQUE, (math.nan,) * 6), (link.TORQUE, (1000.1, 0, 0, 0, 0, 0)), (link.TORQUE, (0, 0, 0, 0, 0, math.inf)),
                             (link.HOLD, (1, 0, 0, 0, 0, 0)), (0, (0,) * 6), (4, (0,) * 6)):
            refused.append(link.wrench_command(key, number, 99, mode, wrench))
        refused.append(link.wrench_command(drive.key, number, 99, link.HOLD))
        refused.append(link.wrench_command(key, number + 1, 99, link.HOLD))
        refused.append(link.wrench_command(key, 0, 99, link.HOLD))
        refused.append(link.command(key, number, 99, link.HOLD))
        refused.append(link.packet(link.WRENCH_COMMAND, key, number, 99, 0, struct.pack("<BB6xQ6d", link.HOLD, 1, 0, *(6 * (0,)))))
        short = struct.pack("<4sBBHQQq", b"TRCR", 1, link.WRENCH_COMMAND, 127, number, 99, 0) + struct.pack("<B7xQ6d", link.HOLD, 1, *(6 * (0,)))
        refused.append(short + link.mac(key, short))
        newest(host, 0.01)
        for data in refused:
            host.socket.send(data)
            state = newest(host, 0.01)
            assert state["command_taken"] == 2 and state["mode"] == link.READY, data.hex(" ")
        host.command(link.TORQUE, (0,) * 6)
        assert newest(host, 0.01)["command_taken"] == 3


def test_denials_and_sessions(example):
    with Drive(example) as drive:
        assert drive.denial(os.urandom(32)) == 1
        time.sleep(0.11)
        assert drive.denial(drive.key, contents=link.ANGLES) == 3
        host = drive.host(period_s=0.1)
        time.sleep(0.11)
        host.command(link.HOLD)
        assert drive.denial(drive.key) == 2
        host.command(link.STOP)
        newest(host, 0.05)
        assert newest(host) is None, "states after the end of the session"
        for data in host.sent[:-1]:  # not the stop
            host.socket.send(data)
        assert newest(host) is None, "a repeated session"
        again = drive.host()
        for data in host.sent:  # of the session that is over
            again.socket.send(data)
        assert newest(again, 0.05)["command_taken"] == 1
        # After a second without commands there is nobody to send states to.
        time.sleep(1.2)
        assert newest(again) is not None
        assert newest(again, 0.05) is None
        # A hello that is repeated gets the same welcome.
        nonce, offered = os.urandom(16), set()
        with drive.socket() as asking:
            for _ in range(3):
                asking.send(link.hello(drive.key, nonce, 1e-3, contents=link.POSE))
                offered.add(link.open_packet(link.WELCOME, drive.key, asking.recv(512))[3])
        assert len(offered) == 1 and offered.pop()[32:] == struct.pack("<dB7x", 5e-4, 1)


def test_silent_host_that_goes_on_keeps_its_session(example):
    with Drive(example) as drive:
        first = drive.host(period_s=0.1)
        time.sleep(0.4)
        second = link.PoseHost(drive.socket(0.05), drive.key)
        newest(first)  # its socket is full
        first.command(link.HOLD)
        assert newest(first, 0.01)["command_taken"] == 2
        second.command(link.HOLD)
        assert second.state() is None, "a second host has begun a session during the first one's"
        first.command(link.HOLD)
        assert newest(first, 0.01)["command_taken"] == 3


def test_replaced_device(work):
    text = EXAMPLE.read_text(encoding="utf-8")
    assert text.count(RESTS) == 1
    program = build(work / "replaced", text.replace(RESTS, REPORTS).replace("#include <ctime>", "#include <ctime>\n#include <unistd.h>"))
    with Drive(program) as drive:
        host = drive.host()
        push(host, (3, 0, 0, 0, 0, 0), 0.05)
        (program.parent / "stop").touch()
        states = push(host, (3, 0, 0, 0, 0, 0), 0.2)
        assert states[-1]["mode"] == link.EMERGENCY_STOP
        assert states[-1]["buttons"] == 9 and states[-1]["orientation"] == [0.6, 0, 0.8, 0] and states[-1]["faults"] == 0
        host.command(link.HOLD)
        assert newest(host, 0.05)["mode"] == link.EMERGENCY_STOP, "acknowledged while it is pressed"
        (program.parent / "stop").unlink()
        states = push(host, (3, 0, 0, 0, 0, 0), 0.1)
        assert states[-1]["mode"] == link.EMERGENCY_STOP, "not acknowledged by zeros"
        assert acknowledge(host)["mode"] == link.READY
        (program.parent / "fault").touch()
        assert newest(host, 0.1)["faults"] == 4
        (program.parent / "fault").unlink()
        assert newest(host, 0.1)["faults"] == 4, "a fault lasts until the end of the session"
        host.command(link.STOP)
        time.sleep(0.05)
        assert newest(drive.host(), 0.05)["faults"] == 0
