# SPDX-License-Identifier: Apache-2.0
"""The stand-in for the Haply service, through its socket, where the sessions of tests/e2e/pose_device_sessions_test.py do not
show it: both versions of the protocol, and forces that must not act."""
import json
import select

import pytest
from console_client import TEXT, WebSocket
from haply_stand_in import StandIn

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
