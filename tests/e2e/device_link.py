# SPDX-License-Identifier: Apache-2.0
"""An independent implementation of the device link, written from formats/session/device_link.md without code of the
project: for the corpus of the fuzz harness, and for tests that talk to a drive."""
import hashlib
import os
import struct

HELLO, WELCOME, COMMAND, STATE, DENIAL, WRENCH_COMMAND, POSE_STATE = range(1, 8)
SIZES = {HELLO: 96, WELCOME: 112, COMMAND: 144, STATE: 208, WRENCH_COMMAND: 128, POSE_STATE: 136}
ANGLES, POSE = 0, 1  # the contents that a hello asks for
HOLD, TORQUE, STOP = 1, 2, 3
READY, TORQUE_ON, WATCHDOG, EMERGENCY_STOP = 1, 2, 3, 4


def mac(key, data):
    return hashlib.blake2b(data, digest_size=32, key=key).digest()


def packet(kind, key, session, sequence, time_ns, contents):
    header = struct.pack("<4sBBHQQq", b"TRCR", 1, kind, SIZES[kind], session, sequence, time_ns)
    assert len(header) == 32 and len(header) + len(contents) + 32 == SIZES[kind]
    return header + contents + mac(key, header + contents)


def hello(key, host_nonce, period_s, resets_world=True, time_ns=0, contents=ANGLES):
    return packet(HELLO, key, 0, 1, time_ns, host_nonce + struct.pack("<dBB6x", period_s, resets_world, contents))


def welcome(key, host_nonce, drive_nonce, period_s, clock, time_ns=0):
    session = int.from_bytes(drive_nonce[:8], "little")
    return packet(WELCOME, key, session, 1, time_ns, host_nonce + drive_nonce + struct.pack("<dB7x", period_s, clock))


def command(key, session, sequence, mode, torques=(0.0,) * 8, state_seen=0, time_ns=0):
    return packet(COMMAND, key, session, sequence, time_ns, struct.pack("<B7xQ8d", mode, state_seen, *torques))


def state(key, session, sequence, mode, motor_faults, command_taken, angles, time_ns=0):
    return packet(STATE, key, session, sequence, time_ns, struct.pack("<BB6xQ16d", mode, motor_faults, command_taken, *angles))


def wrench_command(key, session, sequence, mode, wrench=(0.0,) * 6, state_seen=0, time_ns=0):
    return packet(WRENCH_COMMAND, key, session, sequence, time_ns, struct.pack("<B7xQ6d", mode, state_seen, *wrench))


def pose_state(key, session, sequence, mode, faults, buttons, command_taken, position, orientation, time_ns=0):
    contents = struct.pack("<BB2xIQ3d4d", mode, faults, buttons, command_taken, *position, *orientation)
    return packet(POSE_STATE, key, session, sequence, time_ns, contents)


def session_key(key, host_nonce, drive_nonce):
    return mac(key, b"trocar link 1" + host_nonce + drive_nonce)


def open_packet(kind, key, data):
    """(session, sequence, time_ns, contents) of an authentic packet of the kind, or None."""
    if len(data) != SIZES[kind] or mac(key, data[:-32]) != data[-32:]:
        return None
    magic, version, its_kind, size, session, sequence, time_ns = struct.unpack("<4sBBHQQq", data[:32])
    if (magic, version, its_kind, size) != (b"TRCR", 1, kind, len(data)):
        return None
    return session, sequence, time_ns, data[32:-32]


class Host:
    """One session with a drive over a connected datagram socket."""
    contents = ANGLES

    def __init__(self, socket, key, period_s=1e-3, resets_world=True, tries=20):
        self.socket, self.key, self.sequence, self.seen, self.sent = socket, key, 0, 0, []
        nonce = os.urandom(16)
        for _ in range(tries):
            socket.send(hello(key, nonce, period_s, resets_world, contents=self.contents))
            answer = self.receive(WELCOME, key)
            if answer is not None and answer[3][:16] == nonce:
                break
        else:
            raise TimeoutError("no welcome")
        self.session = answer[0]
        self.session_key = session_key(key, nonce, answer[3][16:32])

    def receive(self, kind, key):
        try:
            data = self.socket.recv(512)
        except (TimeoutError, BlockingIOError, ConnectionRefusedError):
            return None
        return open_packet(kind, key, data)

    def command(self, mode, torques=(0.0,) * 8):
        self.sequence += 1
        data = command(self.session_key, self.session, self.sequence, mode, torques, self.seen)
        self.sent.append(data)
        self.socket.send(data)

    def state(self):
        """{mode, motor_faults, command_taken, sequence, time_ns, encoder_rad} or None after the socket's timeout."""
        opened = self.receive(STATE, self.session_key)
        if opened is None or opened[0] != self.session:
            return None
        mode, motor_faults, taken, *angles = struct.unpack("<BB6xQ16d", opened[3])
        self.seen = max(self.seen, opened[1])
        return {"mode": mode, "motor_faults": motor_faults, "command_taken": taken, "sequence": opened[1],
                "time_ns": opened[2], "encoder_rad": angles}


class PoseHost(Host):
    """One session with a drive that states poses."""
    contents = POSE

    def command(self, mode, wrench=(0.0,) * 6, seen=None):
        self.sequence += 1
        data = wrench_command(self.session_key, self.session, self.sequence, mode, wrench, self.seen if seen is None else seen)
        self.sent.append(data)
        self.socket.send(data)

    def state(self):
        """{mode, faults, buttons, command_taken, sequence, time_ns, position, orientation} or None after the socket's timeout."""
        opened = self.receive(POSE_STATE, self.session_key)
        if opened is None or opened[0] != self.session:
            return None
        mode, faults, buttons, taken, *numbers = struct.unpack("<BB2xIQ3d4d", opened[3])
        self.seen = max(self.seen, opened[1])
        return {"mode": mode, "faults": faults, "buttons": buttons, "command_taken": taken, "sequence": opened[1],
                "time_ns": opened[2], "position": numbers[:3], "orientation": numbers[3:]}
