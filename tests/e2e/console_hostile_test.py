# SPDX-License-Identifier: Apache-2.0
"""Unauthorised, oversized and malformed requests are refused and logged once for each kind, and other clients are not affected. Fuzzed requests and
frames follow, 2,000 each unless TROCAR_REQUESTS and TROCAR_FRAMES give another number."""
import json
import os
import random
import re
import socket
import struct
import time

from chromium_page import PAGE
from console_client import BINARY, TEXT, Closed, Console, WebSocket
from console_server_test import CONSOLE, make_folder
from e2e import check
from programs import WORK

REQUESTS, FRAMES = (int(os.environ.get(name, "2000")) for name in ("TROCAR_REQUESTS", "TROCAR_FRAMES"))


def raw(console, data, timeout=5, half_close=True):
    """The bytes that the console sends back on a new connection."""
    with socket.create_connection(("127.0.0.1", console.port), timeout) as connection:
        answer = b""
        try:
            connection.sendall(data)
            if half_close:
                connection.shutdown(socket.SHUT_WR)
            while more := connection.recv(65536):
                answer += more
        except OSError:  # reset: the console had closed while data was on its way
            pass
        return answer


def status(answer):
    found = re.match(rb"HTTP/1\.[01] (\d+) ", answer)
    return int(found[1]) if found else None


def refused_socket(console, first=None, after=(), origin=None, host=None):
    """Sends these messages on a new WebSocket. Returns its close code, or the HTTP status."""
    web = WebSocket(console.port, origin=origin, host=host)
    try:
        if web.status != 101:
            return web.status
        return web.closed_by(([] if first is None else [(first, TEXT)]) + list(after))
    finally:
        web.close()


def check_refusals(console):
    good = console.token
    for path in ("/api/folder", "/api/log", "/api/test", "/api/bone?scene=scenes/one_slice.json", "/api/volume?scene=scenes/one_slice.json"):
        for token in (None, "0" * 32, good[:-1], good + "0", console.view.upper() + "x"):
            check(console.get(path, token=token)[0] == 401, f"{path} with the token {token}")
    for command in ("/api/start", "/api/command", "/api/xray"):
        check(console.post(command, {"command": "stop"}, token=None)[0] == 401, f"{command} without a token")
        check(console.get(command)[0] == 405, f"GET {command}")
    check(console.get("/api/emergency_stop", token=None)[0] == 405, "GET /api/emergency_stop")
    for host in ("evil.example", f"evil.example:{console.port}", f"127.0.0.1:{console.port + 1}", ""):
        check(console.get("/", headers={"Host": host})[0] == 421, f"Host {host}")
        check(console.post("/api/emergency_stop", token=None, headers={"Host": host})[0] == 421, f"emergency stop with Host {host}")
    for origin in ("http://evil.example", "null", f"https://{console.host}", f"http://localhost:{console.port}"):
        check(console.get("/api/folder", headers={"Origin": origin})[0] == 403, f"Origin {origin}")
        check(console.post("/api/emergency_stop", token=None, headers={"Origin": origin})[0] == 403, f"emergency stop from {origin}")
        check(refused_socket(console, origin=origin) == 403, f"WebSocket from {origin}")
    check(console.get("/api/folder", headers={"Origin": f"http://{console.host}"})[0] == 200, "its own Origin")
    check(refused_socket(console, host="evil.example") == 421, "WebSocket with a foreign Host")
    head = f"Host: {console.host}\r\nAuthorization: Bearer {good}\r\n".encode()
    check(status(raw(console, b"GET /api/folder HTTP/1.1\r\n" + head + b"X: " + b"x" * 9000 + b"\r\n\r\n")) == 431, "a long header")
    check(status(raw(console, b"POST /api/command HTTP/1.1\r\n" + head + b"Content-Length: 5000\r\n\r\n" + b"x" * 5000)) == 413, "a long body")
    check(status(raw(console, b"POST /api/command HTTP/1.1\r\n" + head + b"Content-Length: 99999999999999999999\r\n\r\n")) == 400, "a huge length")
    check(status(raw(console, b"NONSENSE\r\n\r\n")) == 400, "nonsense")
    check(status(raw(console, b"GET /api/%zz HTTP/1.1\r\n" + head + b"\r\n")) == 400, "a malformed path")
    check(status(raw(console, b"GET / HTTP/1.1\r\n\r\n")) == 421, "no Host")
    check(status(raw(console, b"GET / HTTP/1.1\r\n" + head + f"Host: {console.host}\r\n\r\n".encode())) == 421, "two Hosts")
    check(status(raw(console, b"GET /api/folder HTTP/1.1\r\n" + head + head + b"\r\n")) in (401, 421), "two tokens")
    first = json.dumps({"token": good})
    for message in (json.dumps({"token": "0" * 32}), "{}", "[]", "x", json.dumps({"token": 1}), json.dumps({"token": good, "x": 1}),
                    json.dumps({"token": good, "last_event": -1}), json.dumps({"token": good, "session": "x" * 5000})):
        check(refused_socket(console, message) in (1008, 1009), f"first message {message[:60]}")
    for message, opcode, code in (("x", TEXT, 1008), ('{"ack":-1}', TEXT, 1008), ('{"ack":1,"x":1}', TEXT, 1008), ("[" * 4000, TEXT, 1008),
                                  (b"\0" * 8, BINARY, 1008), ("x" * 5000, TEXT, 1009), (b"", 3, 1002)):
        found = refused_socket(console, first, [(message, opcode)])
        check(found in (code, "reset", "end of stream"), f"message {message[:20]} of kind {opcode}: {found}")
    pages = [console.live() for _ in range(8)]
    for page in pages:
        check(page.next() == "hello", "eight operators' pages")
    check(refused_socket(console, first) in (1013, "end of stream", "reset"), "the ninth operator's page")
    silent = [socket.create_connection(("127.0.0.1", console.port)) for _ in range(30)]  # they never say who they are
    for connection in silent:
        connection.sendall(f"GET /live HTTP/1.1\r\nHost: {console.host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                           "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode())
    pages.pop().close()
    time.sleep(0.2)
    pages.append(console.live())
    check(pages[-1].next() == "hello", "an operator's page beside thirty silent ones")
    for connection in silent:
        connection.close()
    for page in pages:
        page.close()
    # Connections that send nothing do not delay later ones.
    idle = [socket.create_connection(("127.0.0.1", console.port)) for _ in range(200)]
    begin = time.monotonic()
    check(console.post("/api/emergency_stop", token=None)[0] == 409 and time.monotonic() - begin < 1, "an emergency stop beside 200 connections")
    for connection in idle:
        connection.close()
    # Nor do connections without a token that go on sending after they were refused.
    busy = []
    for _ in range(140):
        busy.append(socket.create_connection(("127.0.0.1", console.port)))
        busy[-1].sendall(b"NONSENSE\r\n\r\n")
    for _ in range(6):
        for connection in busy:
            try:
                connection.sendall(b"x")
            except OSError:  # the console has closed this one
                pass
        time.sleep(0.2)
    check(console.post("/api/emergency_stop", token=None)[0] == 409, "an emergency stop beside 140 refused connections")
    for connection in busy:
        connection.close()
    # Nor do those that request many files of the page and do not read them.
    request, unread = f"GET /main.js HTTP/1.1\r\nHost: {console.host}\r\n\r\n".encode(), []
    check(status(raw(console, request)) == 200, "a file of the page without a token")
    for _ in range(140):
        unread.append(socket.socket())
        unread[-1].setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        unread[-1].connect(("127.0.0.1", console.port))
        unread[-1].sendall(400 * request)
        time.sleep(0.01)  # until the console writes, so that the connection is not idle when the next one comes
    check(console.post("/api/emergency_stop", token=None)[0] == 409, "an emergency stop beside 140 connections that read nothing")
    for connection in unread:
        connection.close()


def mutated(data, random_, most=8):
    data = bytearray(data)
    for _ in range(random_.randint(1, most)):
        at, kind = random_.randrange(len(data) + 1), random_.randrange(6)
        if kind == 0 and at < len(data):
            data[at] ^= 1 << random_.randrange(8)
        elif kind == 1:
            data[at:at] = random_.randbytes(random_.randint(1, 8))
        elif kind == 2:
            del data[at:at + random_.randint(1, 16)]
        elif kind == 3 and data:
            length = random_.randint(1, 64)
            other = random_.randrange(len(data))
            data[at:at] = data[other:other + length]
        elif kind == 4:
            data[at:at] = random_.choice([b"\r\n", b"\r\n\r\n", b"%00", b"../", b"\xff\xff\xff\xff", b"99999999999999999999", b"[[[[[[[[", b'"'])
        else:
            del data[at:]
        if not data:
            data = bytearray(b" ")
    return bytes(data)


def requests_of(console):
    """Valid requests of each kind. The scenes that they name do not exist."""
    head = f"Host: {console.host}\r\nAuthorization: Bearer {console.token}\r\nOrigin: http://{console.host}\r\n"
    bodies = {"/api/start": {"scene": "scenes/none.json", "duration_s": 1.5, "device": "inproc", "clock": "real", "force_law": "hooke"},
              "/api/command": {"command": "pause"}, "/api/xray": {"take": "screening"}, "/api/test": {"device": "sim"}, "/api/emergency_stop": {}}
    for path in ("/", "/index.html", "/vendor/none.js", "/api/folder", "/api/bone?scene=scenes/one_slice.json&asset=sample.glb",
                 "/api/bone?session=1", "/api/volume?scene=scenes/one_slice.json&asset=sample.glb", "/api/recording?file=one.csv", "/api/report?file=one.csv", "/api/log", "/api/test"):
        yield f"GET {path} HTTP/1.1\r\n{head}\r\n".encode()
    for path, body in bodies.items():
        text = json.dumps(body)
        yield f"POST {path} HTTP/1.1\r\n{head}Content-Type: application/json\r\nContent-Length: {len(text)}\r\n\r\n{text}".encode()
    yield (f"GET /live HTTP/1.1\r\n{head}Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
           "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n").encode()
    yield f"POST /api/command HTTP/1.1\r\n{head}Transfer-Encoding: chunked\r\n\r\n5\r\n{{\"x\":\r\n2\r\n1}}\r\n0\r\n\r\n".encode()


def fuzz_requests(console, count, random_):
    """The statuses of the answers, each with its number."""
    valid, found = list(requests_of(console)), {}
    for _ in range(count):
        code = status(raw(console, mutated(random_.choice(valid), random_)))
        found[code] = found.get(code, 0) + 1
    return found


def frame(data, opcode, random_, flags=0x80, masked=True):
    size = len(data)
    head = bytes([flags | opcode])
    mark = 0x80 if masked else 0
    head += bytes([mark | size]) if size < 126 else bytes([mark | 126]) + struct.pack(">H", size)
    mask = random_.randbytes(4)
    return head + (mask + bytes(b ^ mask[i % 4] for i, b in enumerate(data)) if masked else data)


def fuzz_frames(console, count, random_):
    """Half of the connections send a valid token first; then mutated frames follow. Returns the number of connections."""
    first = json.dumps({"token": console.token, "session": "x", "last_event": 5}).encode()
    sent = connections = 0
    while sent < count:
        try:
            web = WebSocket(console.port)
        except (OSError, Closed):
            continue
        connections += 1
        if web.status != 101:  # earlier pages are still being closed
            web.close()
            time.sleep(0.002)
            continue
        try:
            if random_.random() < 0.5:
                web.socket.sendall(frame(first, TEXT, random_))
            for _ in range(8):
                kind = random_.choice([0, TEXT, TEXT, TEXT, BINARY, 3, 8, 9, 10])
                data = random_.choice([first, b'{"ack":1}', b'{"ack":4294967296}', b"", random_.randbytes(random_.randint(0, 200))])
                if random_.random() < 0.7:
                    data = mutated(data, random_, 3)
                bytes_ = frame(data, kind, random_, random_.choice([0x80, 0x80, 0x80, 0, 0x90, 0xc0]), random_.random() < 0.95)
                if random_.random() < 0.4:
                    bytes_ = mutated(bytes_, random_, 2)
                sent += 1
                web.socket.sendall(bytes_)
        except OSError:
            pass
        web.close()
    return connections


def test_hostile_clients():
    log = open(WORK / "log.txt", "w+", encoding="utf-8")
    console = Console(CONSOLE, make_folder(), page=PAGE, stderr=log)
    check_refusals(console)
    memory = console.rss_kB()
    random_ = random.Random(1)
    begin = time.monotonic()
    codes = fuzz_requests(console, REQUESTS, random_)
    print(f"{REQUESTS} fuzzed requests in {time.monotonic() - begin:.0f} s, answers: {codes}")
    begin = time.monotonic()
    connections = fuzz_frames(console, FRAMES, random_)
    print(f"{FRAMES} fuzzed frames in {connections} connections, {time.monotonic() - begin:.0f} s")
    check(console.process.poll() is None, "the console has ended")
    check(console.get("/api/folder")[0] == 200 and len(console.get("/api/folder")[1]["scenes"]) == 3, "the folder afterwards")
    for _ in range(100):  # pages of the fuzz are closed within seconds
        try:
            live = console.live()
            break
        except (AssertionError, OSError):
            time.sleep(0.1)
    check(live.next() == "hello", "a page afterwards")
    live.close()
    print(f"console: {memory} kB before, {console.rss_kB()} kB after")
    check(set(codes) <= {None, 101, 200, 400, 401, 403, 404, 405, 409, 413, 417, 421, 422, 426, 431, 503, 505}, f"answers {codes}")
    check(console.stop() == 0, "the console's exit code")
    log.seek(0)
    lines = log.read().splitlines()
    kinds = [re.sub(r", from .*", "", line) for line in lines if line.startswith("trocar-console: refused: ")]
    check(len(kinds) == len(set(kinds)) and len(kinds) >= 8, f"refusals in the log: {kinds}")
    others = [line for line in lines if not line.startswith(("trocar-console: refused: ", "trocar-console: emergency stop, "))]
    check(not others, f"other lines in the log: {others[:5]}")
