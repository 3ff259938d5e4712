# SPDX-License-Identifier: Apache-2.0
"""A drive of another implementation (device_link.py), in lock-step, whose time stamps are off by up to 0.49 ms while the tool is in contact: they end
no session, and the damper after a break stays within the force that was lost, and changes by at most a fifth of it in a tick. (Contents that are
refused, and clocks that leap: pose_hand_test, udp_pose_device_test, device_time_test.)
"""
import json
import os
import random
import socket
import subprocess
import threading

import device_link as link
import pytest
from exported import rows_of

PERIOD_S = 1e-3
MIDDLE_M = (0.0, -0.12, 0.15)  # of the workspace of runtime/device/haply_inverse3.json
TOP_M, BOTTOM_M, SHEET_M, SPEED_M_PER_S = 0.14, 0.10, 0.125, 0.1
BEGIN_S, END_S = 0.1, 0.1 + (TOP_M - BOTTOM_M) / SPEED_M_PER_S


def scene():
    """A hand goes down steadily through a sheet."""
    return {"schema": "trocar.scene/1", "name": "wrong", "asset": "sample.glb", "duration_s": 0.7, "placement": {"anchor_mm": [81.5, 53.6]},
            "slices": [{"index": 17, "z_m": SHEET_M}], "tissue": {"stiffness_N_per_m": 1000, "threshold_N": 8}, "force_law": {"kind": "cutting"}, "tool": {"sides": 6, "radius_m": 0.003},
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
    def session(wrong):
        """(exit code, stderr, rows)"""
        drive = Drive(wrong)
        drive.start()
        file, key, record = work / "wrong.json", work / "key", work / "wrong.csv"
        file.write_text(json.dumps(scene()))
        key.unlink(missing_ok=True)
        record.unlink(missing_ok=True)
        with os.fdopen(os.open(key, os.O_CREAT | os.O_WRONLY, 0o600), "w") as out:
            out.write(drive.key.hex() + "\n")
        command = [programs / "trocar-run", file, "--asset", asset, "--device", f"pose:{drive.address}", "--key-file", key,
                   "--device-description", source / "runtime/device/haply_inverse3.json", "--clock", "virtual", "--record", record,
                   "--black-box", work, "--quiet"]
        done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False, timeout=60)
        drive.is_over = True
        drive.join()
        return done.returncode, done.stderr, rows_of(record) if record.exists() else []

    return session


@pytest.mark.parametrize("off_s", [0.0, 0.3e-3, 0.475e-3, 0.49e-3])
def test_the_damper_stays_within_the_lost_force(session, off_s):
    chance = random.Random(7)
    code, stderr, rows = session(lambda p, q, t: (p, q, t + chance.uniform(-off_s, off_s)))
    assert code == 0, stderr
    force_N = [float(row["fz_wanted_N"]) for row in rows]
    at = max(range(1, len(rows)), key=lambda k: force_N[k - 1] - force_N[k])
    lost_N = force_N[at - 1]
    assert lost_N > 2 and force_N[at] < 0.5 * lost_N, f"no break: {lost_N} to {force_N[at]} N"
    after = force_N[at:at + 120]
    most_N, step_N = max(after), max(abs(b - a) for a, b in zip(after, after[1:]))
    print(f"off by {1e3 * off_s} ms: {lost_N:.2f} N lost, then at most {most_N:.2f} N in steps of at most {step_N:.2f} N")
    assert 0 < most_N <= lost_N and step_N <= 0.2 * lost_N * (1 + 1e-6)
