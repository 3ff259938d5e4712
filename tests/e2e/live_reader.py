# SPDX-License-Identifier: Apache-2.0
"""Reads and commands a session that is shown in memory; written from formats/session/telemetry.md alone."""
import fcntl
import json
import mmap
import os
import struct
import time

F_GET_SEALS, F_OFD_GETLK = 1034, 36
SEALS = 1 | 2 | 4  # seal, shrink, grow
COMMANDS = ("stop", "pause", "resume", "zero", "recover", "emergency_stop")


class Live:
    """The memory of a session."""

    def __init__(self, file):
        self.fd = os.open(file, os.O_RDWR | os.O_CLOEXEC)
        assert fcntl.fcntl(self.fd, F_GET_SEALS) & SEALS == SEALS, "not sealed"
        size = os.fstat(self.fd).st_size
        self.map = mmap.mmap(self.fd, size)
        assert self.map[:8] == b"TRCRLIVE" and self.word(8) == 1 and self.word(16) == size
        at, length = self.word(24), self.word(32)
        self.about = json.loads(self.map[at:at + length])
        self.places, place = {}, 0
        for column in self.about["columns"]:
            self.places[column["name"]] = slice(place, place + column["count"])
            place += column["count"]
        assert place == self.word(48)
        self.next_event, self.lost = 1, 0

    def word(self, at):
        return struct.unpack_from("<Q", self.map, at)[0]

    def locked(self, at, read):
        """read() between two equal, even sequences; None: not yet written, or always being written."""
        for _ in range(1000):
            sequence = self.word(at)
            if sequence == 0:
                return None
            if sequence % 2 == 0:
                result = read()
                if self.word(at) == sequence:
                    return result
            time.sleep(0)
        return None

    def snapshot(self):
        at, columns = self.word(40), self.word(48)
        values = self.locked(at, lambda: struct.unpack_from(f"<{columns}d", self.map, at + 8))
        return values and {name: values[place] for name, place in self.places.items()}

    def sheet(self, index):
        at = self.word(self.word(72) + 16 * index)

        def read():
            flags, vertices, triangles, _, cuts = struct.unpack_from("<5Q", self.map, at + 16)
            data = at + 64
            xy = struct.unpack_from(f"<{2 * vertices}f", self.map, data)
            hu = struct.unpack_from(f"<{vertices if flags & 2 else 0}f", self.map, data + 4 * len(xy))
            corners = struct.unpack_from(f"<{3 * triangles}I", self.map, data + 4 * (len(xy) + len(hu)))
            return flags, cuts, xy, hu, corners
        return self.locked(at, read)

    def events(self):
        """Those that came since the last call."""
        at, found = self.word(88), []
        while self.next_event <= self.word(at):
            slot = at + 64 + (self.next_event - 1) % 4096 * 128
            words = struct.unpack_from("<QQdqqQddddQQqddd", self.map, slot)
            if words[0] != 2 * self.next_event or self.word(slot) != words[0]:
                after = max(self.next_event + 1, self.word(at) - 4094)
                self.lost += after - self.next_event
                self.next_event = after
                continue
            names = ("kind", "t_s", "sheet", "slice", "cut", "tool_z_m", "penetration_m", "tip_N", "trial_force_N", "fault")
            found.append(dict(zip(names, words[1:])) | {"hand_N": words[15]})
            self.next_event += 1
        return found

    def command(self, name):
        at = self.word(104) + 8 * COMMANDS.index(name)
        struct.pack_into("<Q", self.map, at, self.word(at) + 1)

    def is_alive(self):
        lock = fcntl.fcntl(self.fd, F_OFD_GETLK, struct.pack("hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0))
        return struct.unpack("hhqqi4x", lock)[0] != fcntl.F_UNLCK
