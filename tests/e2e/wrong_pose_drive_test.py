# SPDX-License-Identifier: Apache-2.0
"""A drive of another implementation (device_link.py), in lock-step, whose states go wrong while the tool is in contact.

 1. Contents that the host refuses end the session with the fault refused_state, in one line that names the field; a drive that begins
    with them does not start.
 2. A leap of the drive's clock by 0.2 s or more ends the session, with and without --simulated.
 3. Time stamps that are off by up to 0.49 ms end no session, and the damper after a break stays within the force that was lost, and
    changes by at most a fifth of it in a tick.
"""
import json
import math
import os
import random
import socket
import subprocess
import threading

import device_link as link
import pytest
from exported import rows_of

FAULT, PERIOD_S = 5, 1e-3
MIDDLE_M = (0.0, -0.12, 0.15)  # of the workspace of runtime/device/haply_inverse3.json
TOP_M, BOTTOM_M, SHEET_M, SPEED_M_PER_S = 0.14, 0.10, 0.125, 0.1
BEGIN_S, END_S = 0.1, 0.1 + (TOP_M - BOTTOM_M) / SPEED_M_PER_S
WRONG_S = 0.3  # the sheet bears the tool


def scene(law, **fields):
    """A hand goes down steadily through a sheet."""
    tissue = {"stiffness_N_per_m": 1000, "threshold_N": 300 if law == "hooke" else 8, **fields}
    return {"schema": "trocar.scene/1", "name": "wrong", "asset": "sample.glb", "duration_s": 0.7, "placement": {"anchor_mm": [81.5, 53.6]},
            "slices": [{"index": 17, "z_m": SHEET_M}], "tissue": tissue, "force_law": {"kind": law}, "tool": {"sides": 6, "radius_m": 0.003},
            "hand": {"trajectory": [{"t_s": 0, "tip_m": [0, 0, TOP_M]}, {"t_s": BEGIN_S, "tip_m": [0, 0, TOP_M]},
                                    {"t_s": END_S, "tip_m": [0, 0, BOTTOM_M]}]}}


def good(t_s):
    """(position, orientation, time in s) of a good state."""
    down = min(max(t_s - BEGIN_S, 0) * SPEED_M_PER_S, TOP_M - BOTTOM_M)
    return [MIDDLE_M[0], MIDDLE_M[1], MIDDLE_M[2] + (TOP_M - BOTTOM_M) / 2 - down], [1.0, 0.0, 0.0, 0.0], t_s


class Drive(threading.Thread):
    """One host at a time. `wrong` changes a state."""

    def __init__(self, wrong):
        super().__init__(daemon=True)
        self.wrong, self.key, self.socket = wrong, os.urandom(32), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.2)
        self.address, self.is_over = f"127.0.0.1:{self.socket.getsockname()[1]}", False

    def run(self):
        session = None
        while not self.is_over:
            try:
                data, host = self.socket.recvfrom(512)
            except TimeoutError:
                continue
            asked = link.open_packet(link.HELLO, self.key, data)
            if asked is not None:
                nonce, own = asked[3][:16], os.urandom(16)
                session, key, sent, ticks = int.from_bytes(own[:8], "little"), link.session_key(self.key, nonce, own), 0, 0
                self.socket.sendto(link.welcome(self.key, nonce, own, PERIOD_S, 2), host)
                continue
            command = session and link.open_packet(link.WRENCH_COMMAND, key, data)
            if not command or command[3][0] == link.STOP:
                continue
            ticks += command[3][0] == link.TORQUE
            sent += 1
            position, orientation, time_s = self.wrong(*good(ticks * PERIOD_S))
            self.socket.sendto(link.pose_state(key, session, sent, link.TORQUE_ON, 0, 0, command[1], position, orientation,
                                               round(time_s * 1e9)), host)


@pytest.fixture(name="session")
def session_with(programs, source, asset, work):
    def session(wrong, *options, law="hooke", **fields):
        """(exit code, stderr, rows)"""
        drive = Drive(wrong)
        drive.start()
        file, key, record = work / "wrong.json", work / "key", work / "wrong.csv"
        file.write_text(json.dumps(scene(law, **fields)))
        key.unlink(missing_ok=True)
        record.unlink(missing_ok=True)
        with os.fdopen(os.open(key, os.O_CREAT | os.O_WRONLY, 0o600), "w") as out:
            out.write(drive.key.hex() + "\n")
        command = [programs / "trocar-run", file, "--asset", asset, "--device", f"pose:{drive.address}", "--key-file", key,
                   "--device-description", source / "runtime/device/haply_inverse3.json", "--clock", "virtual", "--record", record,
                   "--black-box", work, "--quiet", *options]
        done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False, timeout=60)
        drive.is_over = True
        drive.join()
        return done.returncode, done.stderr, rows_of(record) if record.exists() else []

    return session


def from_then_on(change):
    return lambda p, q, t: change(p, q, t) if t >= WRONG_S else (p, q, t)


REFUSED = {
    "nan": (lambda p, q, t: ([math.nan, *p[1:]], q, t), "measured position x nan mm"),
    "infinite": (lambda p, q, t: ([p[0], math.inf, p[2]], q, t), "measured position y inf mm"),
    "mm": (lambda p, q, t: ([1e3 * each for each in p], q, t), "measured position y -1.2e+05 mm"),
    "no quaternion": (lambda p, q, t: (p, [0.0] * 4, t), "length of the measured quaternion 0"),
    "long quaternion": (lambda p, q, t: (p, [1.1, 0.0, 0.0, 0.0], t), "length of the measured quaternion 1.1"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused_contents_are_named(session, name):
    change, field = REFUSED[name]
    code, stderr, rows = session(from_then_on(change))
    assert code == FAULT and len(rows) > 200, stderr
    line = next(line for line in stderr.splitlines() if "refused_state" in line)
    assert "refused because of their contents" in line and field in line and "power" not in stderr, stderr
    assert float(rows[int(1e3 * WRONG_S) - 2]["fz_wanted_N"]) > 0, "not in contact"
    code, stderr, rows = session(change)
    assert code == FAULT and not rows and len(stderr.splitlines()) == 1, stderr
    assert "the device's states are refused (contents)" in stderr and field in stderr, stderr


@pytest.mark.parametrize("leap_s", [0.2, 0.5, 3.0])
@pytest.mark.parametrize("options", [(), ("--simulated",), ("--late-ticks-in-row", "0")])
def test_a_leap_of_the_clock_is_a_fault(session, leap_s, options):
    code, stderr, rows = session(from_then_on(lambda p, q, t: (p, q, t + leap_s)), *options)
    assert code == FAULT and f"time without data {1e3 * leap_s + 1:.4g} ms" in stderr, stderr
    assert rows[-1]["fault"] == "no_data"


@pytest.mark.parametrize("off_s", [0.0, 0.3e-3, 0.475e-3, 0.49e-3])
def test_the_damper_stays_within_the_lost_force(session, off_s):
    chance = random.Random(7)
    code, stderr, rows = session(lambda p, q, t: (p, q, t + chance.uniform(-off_s, off_s)), law="cutting")
    assert code == 0, stderr
    force_N = [float(row["fz_wanted_N"]) for row in rows]
    at = max(range(1, len(rows)), key=lambda k: force_N[k - 1] - force_N[k])
    lost_N = force_N[at - 1]
    assert lost_N > 2 and force_N[at] < 0.5 * lost_N, f"no break: {lost_N} to {force_N[at]} N"
    after = force_N[at:at + 120]
    most_N, step_N = max(after), max(abs(b - a) for a, b in zip(after, after[1:]))
    print(f"off by {1e3 * off_s} ms: {lost_N:.2f} N lost, then at most {most_N:.2f} N in steps of at most {step_N:.2f} N")
    assert 0 < most_N <= lost_N and step_N <= 0.2 * lost_N * (1 + 1e-6)
