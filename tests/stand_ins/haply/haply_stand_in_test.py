# SPDX-License-Identifier: Apache-2.0
"""The stand-in for the Haply service, through its sockets: the protocol in both versions, the simulated arm against the
closed form of a damped spring, each kind of fault, and hostile clients."""
import http.client
import json
import math
import select
import signal
import socket
import subprocess
import time

import pytest
from console_client import BINARY, Closed, TEXT, WebSocket
from haply_stand_in import PATIENCE_S, PROGRAM, StandIn
from programs import WORK


def request(stand_in, method, path, body=None):
    """(status, answer) of an HTTP request"""
    connection = http.client.HTTPConnection("127.0.0.1", stand_in.port, timeout=PATIENCE_S)
    connection.request(method, path, body if body is None else json.dumps(body))
    answer = connection.getresponse()
    data = json.loads(answer.read())
    connection.close()
    return answer.status, data


class Client:
    """A client of the arm. `inventory` is the first message."""

    def __init__(self, stand_in, spelling="vector"):
        self.spelling = spelling
        self.web = WebSocket(stand_in.port, path="/")
        assert self.web.status == 101
        self.inventory = self.receive()

    def receive(self):
        opcode, data = self.web.receive()
        assert opcode == TEXT
        return json.loads(data)

    def send(self, message):
        self.web.send(message if isinstance(message, (str, bytes)) else json.dumps(message))

    def exchange(self, message):
        self.send(message)
        return self.receive()

    def force(self, x=0.0, y=0.0, z=0.0, **keys):
        return self.exchange(force_message(x, y, z, self.spelling, **keys))

    def is_silent(self, seconds=0.05):
        """Whether nothing comes."""
        return not self.web.buffer and not select.select([self.web.socket], [], [], seconds)[0]

    def close(self):
        self.web.close()


def patient_client(stand_in):
    """A client that tries to connect until it succeeds."""
    end = time.monotonic() + PATIENCE_S
    while True:
        try:
            return Client(stand_in)
        except (OSError, Closed):
            assert time.monotonic() < end
            time.sleep(0.01)


def force_message(x=0.0, y=0.0, z=0.0, spelling="vector", device="049D"):
    return {"inverse3": [{"device_id": device, "commands": {"set_cursor_force": {spelling: {"x": x, "y": y, "z": z}}}}]}


def vector(value):
    return [value[name] for name in "xyz"]


def arm(message):
    return message["inverse3"][0]


def position(message):
    return vector(arm(message)["state"]["cursor_position"])


def mode(message):
    state = arm(message)["state"]
    return state.get("mode") or state["control_mode"]


@pytest.fixture(params=["3.1", "3.5"])
def protocol(request):
    return request.param


SPELLING = {"3.1": "values", "3.5": "vector"}


def test_each_message_has_one_answer(protocol):
    with StandIn("--protocol", protocol) as stand_in:
        client = Client(stand_in, SPELLING[protocol])
        assert client.is_silent()
        messages = [force_message(1, spelling=SPELLING[protocol]), {}, {"inverse3": []}, "{", "[1]", "null", "", {"session": 3},
                    {"inverse3": [{"device_id": "049D", "commands": {"probe_position": {}}}]}, {"inverse3": [7, None]}] * 5
        for message in messages:  # without waiting for the answers
            client.send(message)
        assert all(arm(client.receive())["device_id"] == "049D" for _ in messages)
        assert client.is_silent()
        summary, rows = stand_in.stop()
    assert (summary["clients"], summary["messages"], summary["answers"]) == (1, 50, 51)
    assert (summary["forces"], summary["invalid_messages"], summary["idle_messages"]) == (5, 20, 25)
    assert len(rows) == 5


def test_inventory(protocol):
    with StandIn("--protocol", protocol, "--handedness", "left") as stand_in:
        client = Client(stand_in)
        device = arm(client.inventory)
        config, state = device["config"], device["state"]
        assert config["handedness"] == "left" and config["type"] == "inverse3" and config["gravity_compensation"]["enabled"]
        assert set(state) >= {"cursor_position", "cursor_velocity", "current_cursor_force", "body_orientation", "angular_position"}
        assert device["status"] == {"calibrated": True, "in_use": False, "power_supply": True, "ready": True, "started": True}
        if protocol == "3.1":
            assert state["mode"] == "idle" and "control_mode" not in state and "model" in config["device_info"]
            assert set(state["transform"]) == {"position", "rotation", "scale"} and "filters" not in config
            assert "session_id" not in client.inventory
        else:
            assert (state["control_domain"], state["control_mode"]) == ("cartesian", "idle") and "mode" not in state
            assert "device_type" in config["device_info"] and state["transform"] == {}
            assert config["filters"] == {"damping": {"scalar": 0.0}, "force_gate": {"gain": 0.3}}
            assert client.inventory["session_id"] == 1 and Client(stand_in).inventory["session_id"] == 2


def test_configuration_only_in_full_messages(protocol):
    with StandIn("--protocol", protocol, "--grip", "verse_grip") as stand_in:
        client = Client(stand_in)
        cases = [({}, False, False), (force_message(), False, False),
                 ({"session": {"force_render_full_state": {}}}, True, True),
                 ({"session": {"force_render_full_state": {"device_types": ["inverse3"]}}}, True, False),
                 ({"session": {"force_render_full_state": {"device_types": ["verse_grip"]}}}, False, True)]
        for message, has_arm, has_grip in cases:
            answer = client.exchange(message)
            assert ("config" in arm(answer), "config" in answer["verse_grip"][0]) == (has_arm, has_grip), message
            assert {"state", "status"} <= set(arm(answer))


@pytest.mark.parametrize("version, both, spelling, acts", [
    ("3.1", False, "values", True), ("3.1", False, "vector", False), ("3.5", False, "vector", True),
    ("3.5", False, "values", False), ("3.5", True, "values", True), ("3.5", True, "vector", True)])
def test_spelling(version, both, spelling, acts):
    with StandIn("--protocol", version, *["--accept-both"] * both, *["--force-gate", "0"] * (version == "3.5")) as stand_in:
        client = Client(stand_in, spelling)
        answer = client.force(0.5, -1, 2)
        assert mode(answer) == ("force" if acts else "idle")
        assert vector(arm(answer)["state"]["current_cursor_force"]) == ([0.5, -1, 2] if acts else [0, 0, 0])
        summary, rows = stand_in.stop()
    assert (summary["forces"], summary["misspelt_forces"], len(rows)) == (acts, not acts, acts)


def test_commands_do_not_persist(protocol):
    with StandIn("--protocol", protocol) as stand_in:
        client = Client(stand_in, SPELLING[protocol])
        assert mode(client.force(0, 0, 1)) == "force"
        answer = client.exchange({})
        assert mode(answer) == "idle" and vector(arm(answer)["state"]["current_cursor_force"]) == [0, 0, 0]
        assert mode(client.force(0, 0, 1)) == "force"
        client.close()
        other = Client(stand_in)  # the force has ended with its client
        assert mode(other.inventory) == "idle"
        assert mode(other.exchange(force_message(1, spelling=SPELLING[protocol], device="FFFF"))) == "idle"
        summary, _ = stand_in.stop()
    assert (summary["forces"], summary["other_device"], summary["ends_with_force"]) == (2, 1, False)
    assert summary["last_force_N"] == [0, 0, 1]


def test_log_and_summary():
    forces = [(0.1, -1 / 3, 2e-7), (4.999999999999999, 0, 0), (3, 4.1, 0), (0, 0, -5), (1.7976931348623157e308, 0, 0)]
    with StandIn() as stand_in:
        client = Client(stand_in)
        for one in forces:
            client.force(*one)
        for bad in ('{"x":1,"y":NaN,"z":0}', '{"x":1,"y":1e999,"z":0}', '{"x":1,"y":null,"z":0}', '{"x":1,"y":2}', '[1,2,3]'):
            text = json.dumps(force_message()).replace('{"x": 0.0, "y": 0.0, "z": 0.0}', bad)
            assert bad in text and mode(client.exchange(text)) == "idle"
        summary, rows = stand_in.stop(signal.SIGINT)
    assert [(row["fx_N"], row["fy_N"], row["fz_N"]) for row in rows] == forces  # to the last bit
    assert [row["message"] for row in rows] == [1, 2, 3, 4, 5]
    assert rows[0]["time_s"] == 0 and all(a["time_s"] <= b["time_s"] for a, b in zip(rows, rows[1:]))
    assert (summary["forces"], summary["over_limit_forces"], summary["unusable_forces"]) == (5, 2, 5)
    assert (summary["largest_force_N"], summary["last_force_N"]) == (forces[-1][0], list(forces[-1]))


def test_arm_moves_like_a_damped_spring():
    mass, damping, stiffness, hand_damping, force = 0.25, 1.5, 400.0, 6.5, 3.0
    with StandIn("--mass", mass, "--damping", damping, "--hand-stiffness", stiffness, "--hand-damping", hand_damping,
                 "--force-gate", 0, "--idle-after", 10) as stand_in:
        client = Client(stand_in)
        start = position(client.inventory)
        end = time.monotonic() + 0.6
        while time.monotonic() < end:
            last = client.force(force)
            time.sleep(0.001)
        _, rows = stand_in.stop()
    rate = (damping + hand_damping) / (2 * mass)
    omega = math.sqrt(stiffness / mass - rate ** 2)
    final = force / stiffness
    for row in rows:
        t = row["arm_time_s"]
        exact = final * (1 - math.exp(-rate * t) * (math.cos(omega * t) + rate / omega * math.sin(omega * t)))
        assert abs(row["x_m"] - start[0] - exact) < 0.01 * final, row
        assert (row["y_m"], row["z_m"]) == pytest.approx(start[1:], abs=1e-7)
    assert sum(0.02 < row["arm_time_s"] < 0.2 for row in rows) > 5
    assert position(last)[0] == pytest.approx(rows[-1]["x_m"], abs=1e-6)


def test_force_ends_in_a_pause_and_the_arm_catches_up_50_ms():
    with StandIn("--mass", 1, "--damping", 0, "--hand-stiffness", 0, "--hand-damping", 0, "--force-gate", 0, "--idle-after", 0.02) as stand_in:
        client = Client(stand_in)
        client.force(1)
        time.sleep(0.1)
        client.force(1)
        _, rows = stand_in.stop()
    assert rows[1]["time_s"] >= 0.1 and rows[1]["arm_time_s"] == 0.05
    assert rows[1]["x_m"] == pytest.approx(0.02 ** 2 / 2 + 0.02 * 0.03, rel=0.02)  # 20 ms of force, then 30 ms without


def test_hand_follows_its_path():
    path = WORK / "path.json"
    turn = [0, 0, math.pi / 2]
    path.write_text(json.dumps([{"t_s": 0, "position_m": [0, 0, 0.1]},
                                {"t_s": 0.2, "position_m": [0.04, 0, 0.1], "rotation_vector_rad": turn, "buttons": 5}]))
    for grip, key, buttons in (("verse_grip", "verse_grip", None), ("wireless", "wireless_verse_grip", {"a": True, "b": False, "c": True})):
        with StandIn("--path", path, "--grip", grip, "--protocol", "3.1") as stand_in:
            client = Client(stand_in, "values")
            assert position(client.inventory) == pytest.approx([0, 0, 0.1], abs=1e-7)
            assert client.inventory[key][0]["state"]["orientation"] == {"w": 1, "x": 0, "y": 0, "z": 0}
            time.sleep(0.05)
            assert position(client.exchange({})) == pytest.approx([0, 0, 0.1], abs=1e-7)  # waits for the first force
            end = time.monotonic() + PATIENCE_S
            while time.monotonic() < end and abs(position(answer := client.force())[0] - 0.04) > 1e-5:
                pass
            assert position(answer) == pytest.approx([0.04, 0, 0.1], abs=2e-5)
            state = answer[key][0]["state"]
            assert state["orientation"] == pytest.approx({"w": math.sqrt(0.5), "x": 0, "y": 0, "z": math.sqrt(0.5)}, abs=1e-6)
            assert state.get("buttons") == buttons and (grip == "wireless" or state["button"] is True)


def test_second_device_and_numbered_buttons():
    with StandIn("--second-device", "--grip", "wireless", "--numbered-buttons", "--device-id", "BEEF") as stand_in:
        client = Client(stand_in)
        assert [device["device_id"] for device in client.inventory["inverse3"]] == ["BEEF", "0A2C"]
        assert all("config" in device for device in client.inventory["inverse3"])
        assert set(client.inventory["wireless_verse_grip"][0]["state"]["buttons"]) == {f"button_{i}" for i in range(4)}
        assert mode(client.force(1, device="0A2C")) == "idle" and mode(client.force(1, device="BEEF")) == "force"


def test_force_gate():
    route = "/inverse3/049D/config/filters/force_gate"
    with StandIn("--hand-stiffness", 0, "--hand-damping", 0) as stand_in:
        def applied(client, force):
            return arm(client.force(force))["state"]["current_cursor_force"]["x"]

        first, second = Client(stand_in), Client(stand_in)
        assert [applied(first, 1) for _ in range(3)] == pytest.approx([0.7, 0.91, 0.973])
        first.exchange({})
        configure = {"inverse3": [{"device_id": "049D", "configure": {"force_gate": {"gain": 0}}}]}
        assert mode(first.exchange(configure)) == "idle"
        assert [applied(first, 1) for _ in range(2)] == [1, 1]
        full = first.exchange({"session": {"force_render_full_state": {}}})
        assert arm(full)["config"]["filters"]["force_gate"]["gain"] == 0
        assert applied(second, 1) == pytest.approx(0.7)  # the gain is one of the session
        assert request(stand_in, "POST", f"{route}?session=:-1", {"gain": 0}) == (200, {"ok": True, "data": {"gain": 0}})
        assert applied(second, 2) == 2
        assert request(stand_in, "POST", f"{route}?session=%232", {"gain": 0.5})[0] == 200
        assert applied(second, 4) == 3
        assert request(stand_in, "GET", f"{route}?session=:1") == (200, {"ok": True, "data": {"gain": 0.5}})
        assert request(stand_in, "DELETE", route)[0] == 200
        assert request(stand_in, "GET", f"{route}?session=1")[1]["data"]["gain"] == 0.3
        for status, method, path, body in (
                (400, "POST", route, {"gain": 0}), (404, "POST", f"{route}?session=:7", {"gain": 0}),
                (400, "POST", f"{route}?session=:0", {"gain": 1.5}), (400, "POST", f"{route}?session=:0", ["gain"]),
                (404, "POST", "/inverse3/FFFF/config/filters/force_gate?session=:0", {"gain": 0}),
                (400, "GET", "/inverse3/*/config/filters/force_gate?session=:0", None), (404, "GET", "/", None),
                (405, "PUT", f"{route}?session=:0", {"gain": 0})):
            answer = request(stand_in, method, path, body)
            assert answer[0] == status and answer[1]["ok"] is False and answer[1]["error"], (method, path)
        assert request(stand_in, "POST", "/*inverse/0/config/filters/force_gate?session=1", {"gain": 0})[0] == 200
        assert request(stand_in, "GET", "/version")[1]["data"]["git_tag"] == "3.5.0"
        assert arm(request(stand_in, "GET", "/devices")[1]["data"])["device_id"] == "049D"
        assert stand_in.process.poll() is None


# Faults. Each see_... function looks at the answer to the next message.

def in_state(see):
    """For a fault that shows in a state: `see` gets the inventory before the fault, and the state."""
    return lambda client: see(client.inventory, client.force())


def text_of_next(client):
    client.send(force_message())
    opcode, data = client.web.receive()
    assert opcode == TEXT
    return data


def see_silence(client):
    client.send(force_message())
    assert client.is_silent(0.1)


def see_late(client):
    start = time.monotonic()
    client.force()
    assert time.monotonic() - start >= 0.03


def see_twice(client):
    first = client.force()
    assert client.receive() == first


def see_garbage(client):
    with pytest.raises(json.JSONDecodeError):
        json.loads(text_of_next(client).decode())


def see_bad_utf8(client):
    with pytest.raises(UnicodeDecodeError):
        text_of_next(client).decode()


def see_truncated(client):
    text = text_of_next(client).decode()
    assert text.startswith('{"inverse3":[{"device_id":"049D"')
    with pytest.raises(json.JSONDecodeError):
        json.loads(text)


def see_binary(client):
    client.send(force_message())
    opcode, data = client.web.receive()
    assert opcode == BINARY and len(data) == 64


def see_huge(client):
    text = text_of_next(client)
    assert len(text) > 2_000_000 and arm(json.loads(text))["device_id"] == "049D"


def see_deep(client):
    text = text_of_next(client)
    assert text.count(b"[") == text.count(b"]") == 100_000


def see_number(shown):
    def see(client):
        assert f'"cursor_position":{{"x":{shown},"y":{shown},"z":{shown}}}'.encode() in text_of_next(client)
    return see


def see_jump(usual, answer):
    assert position(answer)[0] - position(usual)[0] == pytest.approx(0.05, abs=0.002)


def see_other_id(usual, answer):
    assert [device["device_id"] for device in answer["inverse3"]] == ["FFFF"]
    assert position(answer) == pytest.approx(position(usual), abs=0.01)


def see_missing_device(_, answer):
    assert [device["device_id"] for device in answer["inverse3"]] == ["0A2C"]


def see_removed(_, answer):
    assert answer["inverse3"] == []


def see_no_inverse3(_, answer):
    assert "inverse3" not in answer


def see_no_state(_, answer):
    assert "state" not in arm(answer) and arm(answer)["status"]["ready"]


def see_not_ready(usual, answer):
    assert arm(usual)["status"]["ready"] and not arm(answer)["status"]["ready"]


def see_disconnect(client):
    client.send(force_message())
    with pytest.raises(ConnectionResetError):
        client.receive()


def see_close(client):
    client.send(force_message())
    with pytest.raises(Closed) as closed:
        client.receive()
    assert closed.value.args[0] == 1001  # going away


FAULTS = [("silence", see_silence), ("late", see_late), ("twice", see_twice), ("garbage", see_garbage), ("bad-utf8", see_bad_utf8),
          ("truncated", see_truncated), ("binary", see_binary), ("huge", see_huge), ("deep", see_deep),
          ("wrong-types", see_number('"0.1"')), ("null", see_number("null")), ("nan", see_number("NaN")),
          ("big-number", see_number("1e300")), ("overflow", see_number("1e999")), ("jump", in_state(see_jump)),
          ("other-id", in_state(see_other_id)), ("missing-device", in_state(see_missing_device)), ("removed", in_state(see_removed)),
          ("no-inverse3", in_state(see_no_inverse3)), ("no-state", in_state(see_no_state)), ("not-ready", in_state(see_not_ready)),
          ("disconnect", see_disconnect), ("close", see_close)]


def until_fault(stand_in):
    """A client whose next message meets a fault at 0.03 s."""
    client = Client(stand_in)
    client.force(0, 0, 1)
    time.sleep(0.035)
    return client


@pytest.mark.parametrize("kind, see", FAULTS, ids=[kind for kind, _ in FAULTS])
def test_fault(kind, see):
    with StandIn("--fault", f"{kind}@0.03") as stand_in:
        client = until_fault(stand_in)
        see(client)
        if kind in ("disconnect", "close"):
            client = Client(stand_in)
        # Without a duration it is one answer.
        answer = client.force(0, 0, 1)
        assert mode(answer) == "force" and arm(answer)["status"]["ready"] and client.is_silent(0.01)
        summary, rows = stand_in.stop()
    fault = summary["faults"][0]
    assert (fault["kind"], fault["at_s"], fault["answers"]) == (kind, 0.03, 1) and fault["first_s"] >= 0.03
    assert len(rows) == 3  # the force of the message is taken, whatever the answer is


def test_frozen_state():
    with StandIn("--fault", "frozen@0.03") as stand_in:
        client = until_fault(stand_in)
        first, second = [position(client.force(0, 0, 3)) for _ in range(2)]
        assert first == position(client.inventory) != second


def test_restart():
    with StandIn("--fault", "restart@0:0.3") as stand_in:
        client = Client(stand_in)
        client.send(force_message())
        with pytest.raises((Closed, ConnectionResetError)):
            client.receive()
        with pytest.raises(ConnectionRefusedError):
            WebSocket(stand_in.port, path="/")
        assert mode(patient_client(stand_in).force()) == "force"


def test_fault_with_duration():
    with StandIn("--fault", "not-ready@0.05:0.1", "--fault", "removed@0.25:0") as stand_in:
        client = Client(stand_in)
        assert all(arm(client.exchange({}))["status"]["ready"] for _ in range(100))  # it counts from the first force
        end = time.monotonic() + 0.3
        while time.monotonic() < end:
            client.force()
            time.sleep(0.001)
        summary, rows = stand_in.stop()
    assert summary["faults"][1]["answers"] == 0
    fault = summary["faults"][0]
    assert 0.05 <= fault["first_s"] < 0.15
    assert abs(fault["answers"] - sum(0.05 <= row["time_s"] < 0.15 for row in rows)) <= 2


def test_hostile_clients():
    with StandIn("--duration", 60) as stand_in:
        good = Client(stand_in)
        for code, frames in ((1009, [("x" * 70_000, TEXT)]), (1007, [(b"\xff\xfe", TEXT)]), (1002, [("{}", 3)])):
            assert Client(stand_in).web.closed_by(frames) in (code, "reset")
        nested = Client(stand_in)
        assert mode(nested.exchange("[" * 60_000)) == "idle"
        assert mode(nested.exchange('{"inverse3":' + "[" * 30_000 + "]" * 30_000 + "}")) == "idle"
        assert nested.exchange(b"\x00" * 100)["inverse3"]
        for request in (b"GET / HTTP/1.1\r\n\r\n", b"\x16\x03\x01" * 100, b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\n\r\n",
                        b"POST /inverse3/0/config/filters/force_gate?session=:0 HTTP/1.1\r\nContent-Length: 9999999\r\n\r\n",
                        b"GET /live HTTP/1.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n\r\n"):
            with socket.create_connection(("127.0.0.1", stand_in.port), PATIENCE_S) as raw:
                try:
                    raw.sendall(request)
                    raw.shutdown(socket.SHUT_WR)
                    raw.recv(1000)
                except OSError:
                    pass  # it has hung up already
        open_ones = [socket.create_connection(("127.0.0.1", stand_in.port), PATIENCE_S) for _ in range(40)]
        assert mode(good.force(1)) == "force"
        for one in open_ones:
            one.close()
        deaf = patient_client(stand_in)  # reads nothing
        try:
            deaf.web.socket.settimeout(1)
            for _ in range(20_000):
                deaf.web.socket.sendall(b"\x81\x82\0\0\0\0{}")
        except OSError:
            pass
        assert mode(good.force(1)) == "force"
        summary, _ = stand_in.stop()
    assert summary["protocol_errors"] == 3


@pytest.mark.parametrize("words, complaint", [
    (["--fault", "jump"], "is not KIND@SECONDS"), (["--fault", "jmp@1"], "no such kind"), (["--fault", "jump@x"], "SECONDS"),
    (["--fault", "jump@1:-1"], "DURATION"), (["--path", "/no/file"], "cannot be opened"), (["--protocol", "3.1", "--force-gate", "0.1"], "3.1"),
    (["--log", "/no/folder/log"], "cannot be written")])
def test_wrong_option(words, complaint):
    done = subprocess.run([str(PROGRAM), "--port", "0", *words], capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 2 and complaint in done.stderr and done.stderr.count("\n") == 1


@pytest.mark.parametrize("text, complaint", [
    ("[]", "no keyframes"), ("{", "parse error"), ('[{"t_s":0}]', "position_m"), ('[{"t_s":0,"position_m":[1,2]}]', "array"),
    ('[{"t_s":1,"position_m":[0,0,0]},{"t_s":1,"position_m":[0,0,0]}]', "ascend")])
def test_wrong_path(text, complaint):
    path = WORK / "wrong.json"
    path.write_text(text)
    test_wrong_option(["--path", str(path)], complaint)


def test_ends_after_its_duration():
    with StandIn("--duration", 0.2) as stand_in:
        Client(stand_in).force(0, 0, 1)
        summary, rows = stand_in.ended()
    assert summary["ends_with_force"] and len(rows) == 1
