# SPDX-License-Identifier: Apache-2.0
"""A client of OpenIGTLink that uses only the standard library and numpy. It is written from the protocol's specification
(openigtlink.org, protocol version 2) and shares no code with the library that the console uses."""
import socket
import struct
import time
from dataclasses import dataclass

import numpy as np

HEADER = struct.Struct(">H12s20sQQQ")
POLYNOMIAL = 0x42F0E1EBA9EA3693  # ECMA-182, most significant bit first


def crc_table():
    table = []
    for byte in range(256):
        value = byte << 56
        for _ in range(8):
            value = (value << 1 ^ (POLYNOMIAL if value >> 63 else 0)) & (1 << 64) - 1
        table.append(value)
    return table


TABLE = crc_table()


def crc64(data):
    value = 0
    for byte in data:
        value = TABLE[value >> 56 ^ byte] ^ value << 8 & (1 << 64) - 1
    return value


def packed(kind, name=b"", body=b"", version=1, size=None, crc=None):
    return HEADER.pack(version, kind, name, 0, len(body) if size is None else size, crc64(body) if crc is None else crc) + body


class Closed(Exception):
    """The console has closed the connection."""


@dataclass
class Message:
    kind: str
    name: str
    stamp: int  # units of 2^-32 s since 1970
    body: bytes
    received_s: float  # time.time()

    def unix_s(self):
        return self.stamp / 2**32

    def transform(self):
        """4 x 4."""
        assert self.kind == "TRANSFORM" and len(self.body) == 48
        columns = np.frombuffer(self.body, ">f4").reshape(4, 3).astype(float)
        return np.vstack([columns.T, [0, 0, 0, 1]])

    def sensor(self):
        """(values, unit)."""
        count, status, unit = struct.unpack_from(">BBQ", self.body)
        assert self.kind == "SENSOR" and status == 0 and len(self.body) == 10 + 8 * count
        return np.frombuffer(self.body, ">f8", count, 10), unit

    def status(self):
        """(code, subcode, error's name, text)."""
        code, subcode, error = struct.unpack_from(">Hq20s", self.body)
        return code, subcode, error.rstrip(b"\0").decode(), self.body[30:].rstrip(b"\0").decode()

    def polydata(self):
        """(vertices n x 3 float32, triangles m x 3)."""
        (points, vertices, vertex_bytes, lines, line_bytes, polygons, polygon_bytes, strips, strip_bytes,
         attributes) = struct.unpack_from(">10I", self.body)
        assert self.kind == "POLYDATA" and not any((vertices, vertex_bytes, lines, line_bytes, strips, strip_bytes, attributes))
        xyz = np.frombuffer(self.body, ">f4", 3 * points, 40).reshape(-1, 3)
        assert polygon_bytes == 16 * polygons and len(self.body) == 40 + 12 * points + polygon_bytes
        cells = np.frombuffer(self.body, ">u4", 4 * polygons, 40 + 12 * points).reshape(-1, 4)
        assert (cells[:, 0] == 3).all()
        return xyz.astype(np.float32), cells[:, 1:].astype(int)


class IgtlClient:
    def __init__(self, port, host="127.0.0.1", receive_buffer=None):
        self.socket = socket.socket()
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.settimeout(20)
        self.socket.connect((host, port))
        self.buffer = bytearray()

    def send(self, *words, **keys):
        self.socket.sendall(packed(*words, **keys))

    def fill(self, count):
        """Reads until the buffer has so many bytes. What has come before a timeout stays in it."""
        while len(self.buffer) < count:
            try:
                more = self.socket.recv(1 << 16)
            except ConnectionError as error:
                raise Closed(str(error)) from error
            if not more:
                raise Closed("end of data")
            self.buffer += more

    def next(self, timeout=20):
        """The next message, whose checksum must be right. Raises socket.timeout."""
        self.socket.settimeout(timeout)
        self.fill(HEADER.size)
        version, kind, name, stamp, size, crc = HEADER.unpack_from(self.buffer)
        self.fill(HEADER.size + size)
        received = time.time()
        body = bytes(self.buffer[HEADER.size:HEADER.size + size])
        del self.buffer[:HEADER.size + size]
        assert version == 1 and crc64(body) == crc, f"{kind}: version {version}, or a wrong checksum"
        return Message(kind.rstrip(b"\0").decode(), name.rstrip(b"\0").decode(), stamp, body, received)

    def until(self, wanted, timeout=20):
        """The messages up to the first for which wanted() is true; the last is None if it has not come."""
        end, found = time.monotonic() + timeout, []
        while True:
            left = end - time.monotonic()
            try:
                found.append(self.next(max(left, 0.001)))
            except socket.timeout:
                return [*found, None]
            if wanted(found[-1]):
                return found

    def collect(self, seconds):
        """All messages of this time."""
        end, found = time.monotonic() + seconds, []
        while (left := end - time.monotonic()) > 0:
            try:
                found.append(self.next(left))
            except socket.timeout:
                break
        return found

    def is_closed_within(self, seconds):
        """Reads and drops what comes."""
        end = time.monotonic() + seconds
        try:
            while (left := end - time.monotonic()) > 0:
                self.socket.settimeout(left)
                if not self.socket.recv(1 << 16):
                    return True
        except socket.timeout:
            return False
        except ConnectionError:
            return True
        return False

    def close(self):
        self.socket.close()
