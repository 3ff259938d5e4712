# SPDX-License-Identifier: Apache-2.0
"""The stand-in for the Haply service, through its socket, where the sessions of tests/e2e/pose_device_sessions_test.py do not
show it: both versions of the protocol, forces that must not act, the force gate, and how long a fault lasts."""
import json
import select
import subprocess
import time

import pytest
from console_client import Closed, TEXT, WebSocket
from haply_stand_in import PATIENCE_S, PROGRAM, StandIn

SPELLING = {"3.1": "values", "3.5": "vector"}


class Client:
    """A client of the arm. `inventory` is the first message."""

    def __init__(self, stand_in, protocol="3.5"):
        self.spelling = SPELLING[protocol]
        self.web = WebSocket(stand_in.port, path="/")
        assert self.web.status == 101
        self.inventory = self.receive()

    def receive(self):
        opcode, data = self.web.receive()
        assert opcode == TEXT
        return json.loads(data)

    def exchange(self, message):
        self.web.send(message if isinstance(message, str) else json.dumps(message))
        return self.receive()

    def force(self, x=0.0, y=0.0, z=0.0, spelling=None, device="049D"):
        command = {"set_cursor_force": {spelling or self.spelling: {"x": x, "y": y, "z": z}}}
        return self.exchange({"inverse3": [{"device_id": device, "commands": command}]})

    def is_silent(self, seconds=0.05):
        return not self.web.buffer and not select.select([self.web.socket], [], [], seconds)[0]


def arm(message):
    return message["inverse3"][0]


def applied(message):
    """Mode and force."""
    state = arm(message)["state"]
    return state.get("mode") or state["control_mode"], [state["current_cursor_force"][axis] for axis in "xyz"]


@pytest.mark.parametrize("protocol, other", [("3.1", "vector"), ("3.5", "values")])
def test_forces_act_in_their_spelling_and_until_the_next_message(protocol, other):
    with StandIn("--protocol", protocol, *["--force-gate", "0"] * (protocol == "3.5"), "--grip", "verse_grip") as stand_in:
        client = Client(stand_in, protocol)
        config, state = arm(client.inventory)["config"], arm(client.inventory)["state"]
        assert config["type"] == "inverse3" and client.inventory["verse_grip"][0]["state"]["button"] is False
        if protocol == "3.1":
            assert state["mode"] == "idle" and "filters" not in config and "session_id" not in client.inventory
        else:
            assert state["control_mode"] == "idle" and config["filters"]["force_gate"] == {"gain": 0.0}
            assert (client.inventory["session_id"], Client(stand_in).inventory["session_id"]) == (1, 2)
        assert applied(client.force(0.5, -1, 2)) == ("force", [0.5, -1, 2])
        idle = ("idle", [0, 0, 0])
        for message in ({}, "{", "[1]", "", {"inverse3": []}, {"inverse3": [7, None]}):
            client.force(0, 0, 1)
            answer = client.exchange(message)
            assert applied(answer) == idle and "config" not in arm(answer), message
        assert applied(client.force(1, spelling=other)) == idle
        assert applied(client.force(1, device="FFFF")) == idle
        for bad in ('{"x":1,"y":NaN,"z":0}', '{"x":1,"y":1e999,"z":0}', '{"x":1,"y":null,"z":0}', '{"x":1,"y":2}', "[1,2,3]"):
            text = '{"inverse3":[{"device_id":"049D","commands":{"set_cursor_force":{"%s":%s}}}]}' % (SPELLING[protocol], bad)
            assert applied(client.exchange(text)) == idle, bad
        assert "config" in arm(client.exchange({"session": {"force_render_full_state": {}}}))
        assert client.is_silent()
        last = (0.1, -1 / 3, 1.7976931348623157e308)
        client.force(*last)
        client.web.close()
        other_client = Client(stand_in, protocol)
        assert applied(other_client.inventory) == idle, "the force has ended with its client"
        summary, rows = stand_in.stop()
    assert (rows[-1]["fx_N"], rows[-1]["fy_N"], rows[-1]["fz_N"]) == last  # to the last bit
    assert (summary["forces"], summary["misspelt_forces"], summary["unusable_forces"]) == (len(rows), 1, 5)
    assert len(rows) == 8 and summary["invalid_messages"] == 5  # with the two that JSON cannot hold


def test_force_gate_filters():
    with StandIn() as stand_in:
        client = Client(stand_in)
        forces = [applied(client.force(1))[1][0] for _ in range(3)]
    assert forces == pytest.approx([0.7, 0.91, 0.973])


def test_force_ends_in_a_pause_and_the_arm_catches_up_50_ms():
    with StandIn("--hand-stiffness", 0, "--hand-damping", 0, "--force-gate", 0) as stand_in:
        client = Client(stand_in)
        client.force(1)
        time.sleep(0.1)
        client.force(1)
        _, rows = stand_in.stop()
    assert rows[1]["time_s"] >= 0.1 and rows[1]["arm_time_s"] == pytest.approx(0.05)
    # 20 ms of 1 N on 0.2 kg, then 30 ms without; its own damping takes a twentieth of it.
    assert rows[1]["x_m"] == pytest.approx(0.02 ** 2 / 0.4 + 0.1 * 0.03, rel=0.2)


def test_hand_follows_its_path(work):
    path = work / "path.json"
    path.write_text(json.dumps([{"t_s": 0, "position_m": [0, 0, 0.1]}, {"t_s": 0.2, "position_m": [0.04, 0, 0.1], "buttons": 5}]))
    with StandIn("--path", path, "--grip", "verse_grip") as stand_in:
        client = Client(stand_in)
        time.sleep(0.05)  # it waits for the first force
        start = arm(client.exchange({}))["state"]["cursor_position"]
        end = time.monotonic() + PATIENCE_S
        while (answer := client.force())["verse_grip"][0]["state"]["button"] is False and time.monotonic() < end:
            pass
        while abs(arm(answer)["state"]["cursor_position"]["x"] - 0.04) > 1e-4 and time.monotonic() < end:
            answer = client.force()
    assert start == pytest.approx({"x": 0, "y": 0, "z": 0.1}, abs=1e-7)
    assert arm(answer)["state"]["cursor_position"] == pytest.approx({"x": 0.04, "y": 0, "z": 0.1}, abs=2e-4)


def test_a_fault_is_of_one_answer_or_of_a_time():
    with StandIn("--fault", "not-ready@0.03,removed@0.1:0.1") as stand_in:
        client = Client(stand_in)
        assert all(arm(client.exchange({}))["status"]["ready"] for _ in range(100))  # it counts from the first force
        client.force()
        end = time.monotonic() + 0.25
        answers = []
        while time.monotonic() < end:
            answers.append(client.force())
            time.sleep(0.001)
        summary, rows = stand_in.stop()
    assert sum(not arm(answer)["status"]["ready"] for answer in answers if answer["inverse3"]) == 1
    removed = sum(not answer["inverse3"] for answer in answers)
    assert abs(removed - sum(0.1 <= row["time_s"] < 0.2 for row in rows)) <= 2
    assert [each["answers"] for each in summary["faults"]] == [1, removed]


def test_restart_ends_and_the_port_is_the_same():
    with StandIn("--fault", "restart@0:0.3") as stand_in:
        client = Client(stand_in)
        with pytest.raises((Closed, ConnectionResetError)):
            client.force()
        with pytest.raises(ConnectionRefusedError):
            WebSocket(stand_in.port, path="/")
        end = time.monotonic() + PATIENCE_S
        while True:
            try:
                assert applied(Client(stand_in).force())[0] == "force"
                return
            except (OSError, Closed):
                assert time.monotonic() < end
                time.sleep(0.01)


@pytest.mark.parametrize("words, complaint", [
    (["--fault", "jump"], "is not KIND@SECONDS"), (["--fault", "jmp@1"], "is not KIND@SECONDS"), (["--fault", "jump@1:-1"], "is not KIND"),
    (["--path", "/no/file"], "/no/file"), (["--protocol", "3.1", "--force-gate", "0.1"], "3.1"),
    (["--log", "/no/folder/log"], "cannot be written")])
def test_wrong_option(words, complaint):
    done = subprocess.run([str(PROGRAM), "--port", "0", *words], capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 2 and complaint in done.stderr and done.stderr.count("\n") == 1
