# SPDX-License-Identifier: Apache-2.0
"""A client of the console that uses only the standard library. It is written from runtime/console/protocol.md and RFC 6455 and starts a
console, sends requests, and speaks the WebSocket protocol."""
import atexit
import base64
import hashlib
import http.client
import json
import os
import re
import signal
import socket
import struct
import subprocess
import time

GUID = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10
SNAPSHOT, SHEET, SHAPE, HISTORY = 1, 2, 3, 4


class Console:
    """Starts a console; stop() ends it."""

    def __init__(self, program, *arguments, page=None, stderr=None, port=0, env=None):
        words = [str(program), *map(str, arguments), "--port", str(port)]
        if page:
            words += ["--page", str(page)]
        self.errors = stderr
        atexit.register(self.stop)  # a test that fails must not leave it and its session behind
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=stderr, text=True, env=env)
        lines = [self.process.stdout.readline() for _ in range(2)]
        found = [re.match(r"\w+: http://(.+):(\d+)/#([0-9a-f]{32})$", line) for line in lines]
        assert all(found), f"the console printed {lines}"
        self.port = int(found[0][2])
        self.host = f"127.0.0.1:{self.port}"
        self.token, self.view = found[0][3], found[1][3]

    def request(self, method, path, body=None, token="", headers=None, raw=False):
        """(status, answer): the answer is parsed if it is JSON, else bytes."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        token = self.token if token == "" else token
        send = {"Authorization": f"Bearer {token}"} if token else {}
        send.update(headers or {})
        if body is not None and not isinstance(body, (bytes, str)):
            body = json.dumps(body)
        connection.request(method, path, body, send)
        answer = connection.getresponse()
        data = answer.read()
        self.headers = dict(answer.getheaders())
        connection.close()
        if not raw and answer.getheader("Content-Type") == "application/json":
            data = json.loads(data)
        return answer.status, data

    def get(self, path, **keys):
        return self.request("GET", path, **keys)

    def post(self, path, body=None, **keys):
        return self.request("POST", path, body, **keys)

    def live(self, token=None, **first):
        return Live(self.port, token or self.token, **first)

    def rss_kB(self):
        with open(f"/proc/{self.process.pid}/status", encoding="ascii") as status:
            return int(re.search(r"VmRSS:\s+(\d+)", status.read())[1])

    def stop(self, number=signal.SIGINT, timeout=30):
        atexit.unregister(self.stop)
        if self.process.poll() is None:
            self.process.send_signal(number)
        code = self.process.wait(timeout)
        self.process.stdout.close()
        return code


def container(data):
    """(JSON, bytes of the arrays) of a binary answer."""
    size = struct.unpack_from("<I", data)[0]
    assert (4 + size) % 8 == 0
    return json.loads(data[4:4 + size]), data[4 + size:]


class Closed(Exception):
    """The peer has closed the WebSocket with this code."""


class WebSocket:
    """A client of RFC 6455 without extensions and fragments."""

    def __init__(self, port, path="/live", host=None, origin=None, receive_buffer=None):
        self.socket = socket.socket()
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.settimeout(20)
        self.socket.connect(("127.0.0.1", port))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        key = base64.b64encode(os.urandom(16)).decode()
        lines = [f"GET {path} HTTP/1.1", f"Host: {host or f'127.0.0.1:{port}'}", "Upgrade: websocket", "Connection: Upgrade",
                 f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13"]
        if origin:
            lines.append(f"Origin: {origin}")
        self.socket.sendall("\r\n".join([*lines, "", ""]).encode())
        self.buffer = b""
        while b"\r\n\r\n" not in self.buffer:
            more = self.socket.recv(65536)
            if not more:
                raise Closed("no answer to the handshake")
            self.buffer += more
        head, self.buffer = self.buffer.split(b"\r\n\r\n", 1)
        self.status = int(head.split()[1])
        if self.status == 101:
            accept = base64.b64encode(hashlib.sha1((key + GUID).encode()).digest())
            assert b"sec-websocket-accept: " + accept.lower() in head.lower()

    def send(self, data, opcode=TEXT):
        if isinstance(data, str):
            data = data.encode()
        size = len(data)
        head = bytes([0x80 | opcode])
        if size < 126:
            head += bytes([0x80 | size])
        elif size < 65536:
            head += bytes([0x80 | 126]) + struct.pack(">H", size)
        else:
            head += bytes([0x80 | 127]) + struct.pack(">Q", size)
        mask = os.urandom(4)
        self.socket.sendall(head + mask + bytes(b ^ mask[i % 4] for i, b in enumerate(data)))

    def _take(self, size):
        while len(self.buffer) < size:
            more = self.socket.recv(262144)
            if not more:
                raise Closed("end of stream")
            self.buffer += more
        taken, self.buffer = self.buffer[:size], self.buffer[size:]
        return taken

    def receive(self):
        """(opcode, bytes) of the next message; pings are answered."""
        while True:
            first, size = self._take(2)
            assert first & 0x80 and not size & 0x80, "a fragment or a masked frame from the server"
            if size == 126:
                size = struct.unpack(">H", self._take(2))[0]
            elif size == 127:
                size = struct.unpack(">Q", self._take(8))[0]
            data = self._take(size)
            opcode = first & 0x0f
            if opcode == PING:
                self.send(data, PONG)
            elif opcode == CLOSE:
                raise Closed(struct.unpack(">H", data[:2])[0] if len(data) >= 2 else None)
            elif opcode != PONG:
                return opcode, data

    def closed_by(self, messages):
        """Sends (data, opcode), one after the other. Returns the code with which the peer then closes, or "reset"."""
        try:
            for data, opcode in messages:
                self.send(data, opcode)
            while True:
                self.receive()
        except Closed as closed:
            return closed.args[0]
        except OSError:
            return "reset"

    def close(self):
        self.socket.close()


class Live:
    """The messages that a page gets. next() takes one message; `ack`: whether binary messages are acknowledged."""

    def __init__(self, port, token, ack=True, receive_buffer=None, **first):
        self.web = WebSocket(port, receive_buffer=receive_buffer)
        assert self.web.status == 101, self.web.status
        self.ack = ack
        self.hello, self.session, self.columns, self.events, self.states = None, None, {}, [], []
        self.values, self.sheets, self.shapes, self.missed, self.snapshots, self.hellos = None, {}, 0, 0, 0, 0
        self.history = None  # (time, force on the hand, height of the tip), of a client that came later
        self.hands = []  # "yours", "other" or "free", as told
        self.web.send(json.dumps({"token": token, **first}))

    def next(self, timeout=20):
        """The kind of the next message: "hello", "events", "missed", "state", "hand", or SNAPSHOT, SHEET, SHAPE, HISTORY."""
        self.web.socket.settimeout(timeout)
        opcode, data = self.web.receive()
        if opcode == TEXT:
            message = json.loads(data)
            kind = next(iter(set(message) & {"hello", "events", "missed", "state", "hand"}))
            if kind == "hello":
                self.hellos += 1
                if message["session"] != self.session:
                    self.values, self.events, self.sheets = None, [], {}
                self.hello, self.session, self.role = message["hello"], message["session"], message["role"]
                self.columns, place = {}, 0
                for column in message["columns"]:
                    self.columns[column["name"]] = (place, column["count"])
                    place += column["count"]
            elif kind == "events":
                self.events += message["events"]
            elif kind == "missed":
                self.missed += message["missed"]
            elif kind == "hand":
                self.hands.append(message["hand"])
            else:
                self.states.append(message)
            return kind
        kind, number = struct.unpack_from("<II", data)
        if self.ack:
            self.web.send(json.dumps({"ack": number}))
        if kind == SNAPSHOT:
            self.values = struct.unpack_from(f"<{(len(data) - 8) // 8}d", data, 8)
            self.snapshots += 1
        elif kind == HISTORY:
            self.history = list(struct.iter_unpack("<3d", data[8:]))
        elif kind == SHEET:
            sheet, cuts, slice_, vertices, triangles, has_hu = struct.unpack_from("<IIiIII", data, 8)
            assert len(data) == 32 + 4 * ((3 if has_hu else 2) * vertices + 3 * triangles)
            self.sheets[sheet] = {"cuts": cuts, "slice": slice_, "vertices": vertices, "triangles": triangles, "bytes": data[32:]}
        else:
            self.shapes += 1
        return kind

    def until(self, condition, timeout=20):
        """Takes messages until condition(self); False if that takes too long."""
        end = time.monotonic() + timeout
        while not condition(self):
            left = end - time.monotonic()
            if left <= 0:
                return False
            try:
                self.next(left)
            except socket.timeout:
                return False
        return True

    def value(self, name, at=0):
        return self.values[self.columns[name][0] + at]

    def array(self, name):
        place, count = self.columns[name]
        return self.values[place:place + count]

    def state(self):
        return self.states[-1]["state"] if self.states else None

    def kinds(self):
        return [event["kind"] for event in self.events]

    def close(self):
        self.web.close()
