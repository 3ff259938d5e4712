# SPDX-License-Identifier: Apache-2.0
"""What formats/session/device_link.md states, read out of the page.

 1. Test vectors: their bytes are those that device_link.py gives for the fields, their MACs those of Python's BLAKE2b, and each
    opens to its fields. (device_protocol_test.cpp does the same with the programs' own code.)
 2. Angles: the page's formulas, with the angles of a recorded session and of the state's vector, give the recorded pose.
 3. Torques: positive ones do positive work at rising angles, so that the motors' work is that of the wrench on the hand.
"""
import hashlib
import json
import math
import re
import struct

import numpy as np

import device_link as link
import pytest
from exported import rows_of
from programs import SOURCE, run

KINDS = {"hello": link.HELLO, "welcome": link.WELCOME, "command": link.COMMAND, "state": link.STATE, "hello for poses": link.HELLO,
         "wrench command": link.WRENCH_COMMAND, "pose state": link.POSE_STATE}


def block(page, name):
    """The bytes of the page's block of that name."""
    found = re.findall(rf"^```hex {name}\n((?:(?:[0-9a-f]{{2}} ?)+\n)+)```$", page, re.M)
    assert len(found) == 1, f"{len(found)} blocks {name!r}"
    return bytes.fromhex(found[0]) if found else b""


def fields(page, kind):
    """The values of the page's table of that packet, in its order."""
    section = re.search(rf"^### {kind}\n(.*?)^```hex {kind}$", page, re.M | re.S)[1]
    rows = re.findall(r"^\| ([a-z' ]+?) \| `?(.*?)`? \|$", section, re.M)
    return {name: value for name, value in rows if name != "field"}


def numbers(text):
    return [float(word) for word in text.split(",")]


def check_vectors(page):
    key, session_key = block(page, "key"), block(page, "session key")
    hello, welcome, command, state, pose_hello, wrench_command, pose_state = (fields(page, kind) for kind in KINDS)
    host, drive = bytes.fromhex(hello["host's nonce"]), bytes.fromhex(welcome["drive's nonce"])
    assert bytes.fromhex(welcome["host's nonce"]) == host, "the welcome answers another hello"
    assert hashlib.blake2b(b"trocar link 1" + host + drive, key=key, digest_size=32).digest() == session_key, "the session key"
    session = int.from_bytes(drive[:8], "little")
    for each in (command, state, wrench_command, pose_state):
        assert int(each["session"]) == session, f"the session is {session}"

    def made_hello(asked):
        return link.hello(key, bytes.fromhex(asked["host's nonce"]), float(asked["period"]), int(asked["starts again"]), int(asked["time"]),
                          int(asked["contents"]))

    made = {
        "hello": made_hello(hello), "hello for poses": made_hello(pose_hello),
        "welcome": link.welcome(key, host, drive, float(welcome["period"]), int(welcome["clock"]), int(welcome["time"])),
        "command": link.command(session_key, session, int(command["sequence"]), int(command["mode"]), numbers(command["torques"]),
                                int(command["newest state"]), int(command["time"])),
        "state": link.state(session_key, session, int(state["sequence"]), int(state["mode"]), int(state["motor faults"]),
                            int(state["newest command"]), numbers(state["angles"]), int(state["time"])),
        "wrench command": link.wrench_command(session_key, session, int(wrench_command["sequence"]), int(wrench_command["mode"]),
                                              numbers(wrench_command["force"]) + numbers(wrench_command["moment"]),
                                              int(wrench_command["newest state"]), int(wrench_command["time"])),
        "pose state": link.pose_state(session_key, session, int(pose_state["sequence"]), int(pose_state["mode"]), int(pose_state["fault"]),
                                      int(pose_state["buttons"]), int(pose_state["newest command"]), numbers(pose_state["position"]),
                                      numbers(pose_state["orientation"]), int(pose_state["time"]))}
    assert (hello["contents"], pose_hello["contents"]) == ("0", "1"), "the contents of the hellos"
    for kind, number in KINDS.items():
        shown, used = block(page, kind), key if number in (link.HELLO, link.WELCOME) else session_key
        assert shown == made[kind], f"{kind}: the page has\n{shown.hex(' ')}\nnot\n{made[kind].hex(' ')}"
        mac = hashlib.blake2b(shown[:-32], key=used, digest_size=32).digest()
        assert len(shown) == link.SIZES[number] and shown[-32:] == mac, f"{kind}: MAC {mac.hex(' ')}"
        opened = link.open_packet(number, used, shown)
        sent = fields(page, kind)
        assert opened is not None and opened[2] == int(sent["time"]), f"{kind} opens to {opened}"
        assert link.open_packet(number, used, shown[:40] + bytes([shown[40] ^ 1]) + shown[41:]) is None, f"{kind}: opens when changed"
    denial = fields(page, "denial")
    shown, nonce = block(page, "denial"), bytes.fromhex(denial["host's nonce"])
    made = struct.pack("<4sBBHQQq16sQ", b"TRCR", 1, 5, 56, 0, 1, int(denial["time"]), nonce, int(denial["reason"]))
    assert shown == made, f"denial: the page has\n{shown.hex(' ')}\nnot\n{made.hex(' ')}"
    assert state["angles"].count(",") == 15 and command["torques"].count(",") == 7, "lists of 16 angles and 8 torques"
    return numbers(state["angles"])


class Mechanism:
    """The page's section on angles, with the lengths of a device description."""

    def __init__(self, description):
        self.g = {name.rsplit("_", 1)[0]: value for name, value in description["geometry"].items()}

    def legs(self, angles):
        """E, C and F of each leg in {B}."""
        g, d = self.g, math.radians(self.g["d"])
        for m in range(4):
            th1, th2, th3, th4 = angles[4 * m:4 * m + 4]
            E = np.array([g["R_B1"], 0, g["z_A"]]) + g["l1"] * np.array([math.cos(th1), 0, math.sin(th1)])
            C = E + g["l2"] * np.array([math.cos(th3) * math.cos(th1 + th2), math.sin(th3), math.cos(th3) * math.sin(th1 + th2)])
            F = (np.array([g["R_B2"] * math.cos(d), g["R_B2"] * math.sin(d), g["z_A"] - g["H_B"]])
                 + g["l3"] * np.array([math.cos(th4), math.sin(th4), 0]))
            turn = np.linalg.matrix_power(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), m)  # by m right angles about z
            yield tuple(turn @ point for point in (E, C, F))

    def errors_m(self, angles, position, rotation):
        """Distances between the ball joints by the angles and by the pose, and errors of the link l4's length."""
        for m, (E, C, F) in enumerate(self.legs(angles)):
            azimuth = m * math.pi / 2
            joint = position + rotation @ (self.g["R_T"] * np.array([math.cos(azimuth), math.sin(azimuth), 0]))
            D = E + self.g["l5"] / self.g["l2"] * (C - E)
            yield np.linalg.norm(C - joint)
            yield abs(np.linalg.norm(D - F) - self.g["l4"])


def rotation_of(w, x, y, z):
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def rotation_by(vector):
    angle = np.linalg.norm(vector)
    half = math.sin(angle / 2) / angle if angle > 0 else 0
    return rotation_of(math.cos(angle / 2), *(half * component for component in vector))


class Session:
    """A recorded session: angles, poses, torques and delivered wrenches as arrays, a row for each tick."""

    def __init__(self, programs, asset, work, trajectory):
        scene, record, exact = work / "scene.json", work / "r.csv", work / "exact.json"
        device = json.loads((SOURCE / "formats/session/four_legs.json").read_text())
        device["simulation"]["encoder_counts_per_revolution"] = 0
        exact.write_text(json.dumps(device))
        scene.write_text(json.dumps({
            "schema": "trocar.scene/1", "name": "sign", "asset": str(asset), "duration_s": 1,
            "placement": {"anchor_mm": [81.5, 53.6]}, "slices": [{"index": 17, "z_m": 0.12}], "hand": {"trajectory": trajectory}}))
        run(programs / "trocar-run", scene, "--clock", "virtual", "--record", record, "--quiet", "--device-description", exact)
        rows = rows_of(record)
        legs = range(1, 5)
        self.angles = self.columns(rows, [f"th_{leg}_{joint}_rad" for leg in legs for joint in range(1, 5)])
        self.motors = self.columns(rows, [f"th_{leg}_{joint}_rad" for leg in legs for joint in (1, 4)])
        self.torques = self.columns(rows, [f"tau_{leg}_{joint}_Nm" for leg in legs for joint in (1, 4)])
        self.positions = self.columns(rows, ["x_m", "y_m", "z_m"])
        self.rotations = [rotation_of(*q) for q in self.columns(rows, ["qw", "qx", "qy", "qz"])]
        self.forces = self.columns(rows, ["fx_delivered_N", "fy_delivered_N", "fz_delivered_N"])
        self.moments = self.columns(rows, ["tx_delivered_Nm", "ty_delivered_Nm", "tz_delivered_Nm"])

    @staticmethod
    def columns(rows, names):
        return np.array([[float(row[name]) for name in names] for row in rows])

    def work_J(self):
        """Of each motor, and of the wrench, up to the last tick before the puncture; by central differences."""
        pressed = np.nonzero(np.linalg.norm(self.torques, axis=1))[0]
        ticks = range(pressed[0] + 1, pressed[-1])
        motors, wrench = np.zeros(8), 0.0
        for k in ticks:
            motors += self.torques[k] * (self.motors[k + 1] - self.motors[k - 1]) / 2
            turned = self.rotations[k + 1] @ self.rotations[k - 1].T
            axis = np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]) / 2
            wrench += (self.forces[k] @ (self.positions[k + 1] - self.positions[k - 1]) + self.moments[k] @ axis) / 2
        return motors, wrench


def key(t_s, tip_m, rotation_deg):
    return {"t_s": t_s, "tip_m": tip_m, "rotation_deg": rotation_deg}


def check_angles(page, source, programs, asset, work, angles_of_vector):
    description = json.loads((source / "formats" / "session" / "four_legs.json").read_text())
    mechanism = Mechanism(description)
    moving = Session(programs, asset, work, [key(0, [0.006, -0.004, 0.13], [4, -3, 5]), key(0.9, [0.009, -0.001, 0.114], [-2, 3, -8])])
    for row in range(0, len(moving.angles), 50):
        worst = max(mechanism.errors_m(moving.angles[row], moving.positions[row], moving.rotations[row]))
        assert worst < 1e-9, f"row {row}: the formulas are {worst} m off"
    # The state's vector, at the pose that the page states.
    stated = re.search(r"origin at \((.*?)\) m in \{B\}\. The plate is rotated by the\s+rotation vector \((\S+), (\S+), (\S+)\)\s+deg", page)
    rotation = rotation_by([math.radians(float(text)) for text in stated.groups()[1:]])
    worst = max(mechanism.errors_m(angles_of_vector, np.array(numbers(stated[1])), rotation))
    assert worst < 1e-9, f"the state's vector is {worst} m off"
    # The level plate.
    level = re.search(r"level at \((.*?)\) m, each leg has\s+th1 = (\S+) deg, th2 = (\S+) deg, th3 = (\S+) deg and th4 = (\S+) deg", page)
    shown = [float(text) for text in level.groups()[1:]]
    rests = Session(programs, asset, work, [key(0, numbers(level[1]), [0, 0, 0])])
    worst = np.max(np.abs(np.degrees(rests.angles[0]) - shown * 4))
    assert worst < 1e-3, f"the level plate: {np.degrees(rests.angles[0][:4])}, not {shown}"
    for name, angle in zip(("theta1", "theta2", "theta3", "theta4"), shown):
        low, high = description["joint_limits_deg"][name]
        assert low <= angle <= high, f"{name} = {angle} is not within {low} to {high}"
    # The sign of torques.
    motors, wrench = moving.work_J()
    assert abs(wrench) > 0.01, f"no work was done: {wrench} J"
    assert abs(sum(motors) - wrench) < 1e-3 * abs(wrench), f"the motors' work is {sum(motors)} J, the wrench's {wrench} J"
    for i, of_motor in enumerate(motors):
        assert abs(2 * of_motor) > 0.01 * abs(wrench), f"motor {i}: its sign would not be noticed: {of_motor} of {wrench} J"


@pytest.fixture(name="page")
def page_text(source):
    return (source / "formats" / "session" / "device_link.md").read_text(encoding="utf-8")


def test_page(page, source, programs, asset, work):
    angles = check_vectors(page)
    check_angles(page, source, programs, asset, work, angles)
