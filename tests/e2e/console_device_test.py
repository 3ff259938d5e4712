# SPDX-License-Identifier: Apache-2.0
"""The devices that the console's command line lists: a page chooses one by its name or index, and only so; a test of one before a session. The
devices are trocar-device-sim with key files. (Stopped tests, dead devices and sessions on a device: console/drive_devices.mjs.)"""
import json
import os
import pathlib
import signal
import subprocess
import time

import pytest

from chromium_page import PAGE
from console_client import Console
from console_server_test import CONSOLE, add_outside, make_folder
from device_link_e2e_test import Simulator
from e2e import check
from exported import conforms
from programs import PROGRAMS, WORK

DEAD = "udp:127.0.0.1:9"  # nobody answers there
TEST_WITHIN_s, STOP_WITHIN_s = 30, 4


def children(console):
    """{process id: its words} of the console's children."""
    found = {}
    for name in pathlib.Path(f"/proc/{console.process.pid}/task/{console.process.pid}/children").read_text(encoding="ascii").split():
        try:
            found[int(name)] = pathlib.Path(f"/proc/{name}/cmdline").read_text(encoding="utf-8").split("\0")[:-1]
        except OSError:
            pass
    return found


def words_of_test(console):
    """The words of the only child. Between fork and exec a process has none."""
    for _ in range(200):
        words = next(iter(children(console).values()), [])
        if "test" in words:
            break
        time.sleep(0.01)
    return words


def after_test(console, within_s=TEST_WITHIN_s):
    end = time.monotonic() + within_s
    while time.monotonic() < end:
        told = console.get("/api/test")[1]
        if told["state"] != "running":
            return told
        time.sleep(0.05)
    return check(False, f"the test has not ended: {told}") or told


@pytest.fixture(name="folder", scope="module")
def folder_of_scenes():
    folder = make_folder()
    add_outside(folder)
    return folder


@pytest.fixture(name="simulator", scope="module")
def running_simulator(folder):
    keys = WORK / "keys"
    keys.mkdir()
    with Simulator(PROGRAMS, keys, folder / "scenes/outside.json", "--watchdog", "0.25") as simulator:
        yield simulator


@pytest.fixture(name="name", scope="module")
def name_of_device(simulator):
    return f"udp:{simulator.address}"


@pytest.fixture(name="option", scope="module")
def option_of_device(name, simulator):
    return f"{name},simulated,key-file={simulator.key_file}"


@pytest.fixture(name="console", scope="module")
def console_with_devices(folder, simulator, option):
    console = Console(CONSOLE, folder, "--device", "inproc", "--device", option, "--device", f"{DEAD},key-file={simulator.key_file}",
                      "--device", f"udp:127.0.0.1:10,key-file={WORK / 'keys/nowhere.key'}", page=PAGE)
    yield console
    check(console.stop() == 0, "the end of the console")


def shows_a_path(text):
    return any(path in text for path in (str(WORK), str(PROGRAMS), "link.key", "nowhere.key"))


def test_list(console, name):
    status, answer = console.request("GET", "/api/folder", raw=True)
    devices = json.loads(answer)["devices"]
    check([d["name"] for d in devices] == ["inproc", name, DEAD, "udp:127.0.0.1:10"], f"{devices}")
    check([d["simulated"] for d in devices] == [True, True, False, False] and [d["can_be_tested"] for d in devices] == [False, True, True, True], f"{devices}")
    check(status == 200 and not shows_a_path(answer.decode()), "a path is told in the list")


def test_default(folder):
    console = Console(CONSOLE, folder, page=PAGE)
    devices = console.get("/api/folder")[1]["devices"]
    check(devices == [{"name": "inproc", "simulated": True, "can_be_tested": False}], f"without --device: {devices}")
    check(console.get("/api/test") == (200, {"state": "none"}), "a test before any")
    check(console.stop() == 0, "the end of a console")


def test_refused(console, name):
    for wrong in (7, -1, 0.0, 1e300, "", name + ",simulated", "udp:127.0.0.1:2", "haply:", "Inproc", None, True, [0], {"name": name}):
        for path, body in (("/api/test", {"device": wrong}), ("/api/start", {"scene": "scenes/one_slice.json", "device": wrong})):
            status, answer = console.post(path, body)
            check(status == 400 and "\n" not in answer["error"], f"{path} {wrong}: {status} {answer}")
    for body in ("[]", "{", '{"device": 0, "key_file": "/etc/passwd"}', '{"device": 0, "device": 1}', '"inproc"'):
        check(console.post("/api/test", body)[0] == 400, f"/api/test {body}")
    check(console.post("/api/test", '{"device": "' + 5000 * "x" + '"}')[0] == 413, "a body of 5 kB")
    for what, keys, status in (("an audience", {"token": console.view}, 403), ("nobody", {"token": None}, 401),
                               ("a foreign page", {"headers": {"Origin": "http://evil.example"}}, 403)):
        check(console.post("/api/test", {"device": name}, **keys)[0] == status, f"{what} tests a device")
    check(console.get("/api/test", token=console.view)[0] == 200 and console.get("/api/test", token=None)[0] == 401, "who may read a test")
    check(console.request("PUT", "/api/test", {"device": name})[0] == 405, "PUT /api/test")
    for simulated in ("inproc", 0, "sim"):
        status, answer = console.post("/api/test", {"device": simulated})
        check(status == 409 and "nothing to test" in answer["error"], f"a test of {simulated}: {status} {answer}")
    check(not children(console) and console.get("/api/test")[1] == {"state": "none"}, f"a refused request started {children(console)}")


def test_trial(console, name):
    check(console.post("/api/test", {"device": name}) == (200, {"ok": True}), "the start of a test")
    words = words_of_test(console)
    check({"test", "--simulated", "--key-file"} <= set(words) and name in words, f"the test's process: {words}")
    for path, body in (("/api/test", {"device": name}), ("/api/start", {"scene": "scenes/one_slice.json"})):
        status, answer = console.post(path, body)
        check(status == 409 and "being tested" in answer["error"], f"{path} during a test: {status} {answer}")
    told = console.get("/api/test")[1]
    check(told["state"] == "running" and told["device"] == name and "result" not in told, f"a test that runs: {told}")
    told = after_test(console)
    conforms("device_test", told["result"])
    result = told["result"]
    check(told["exit_code"] == (0 if result["holds"] else 5) and result["holds"] == (not result["troubles"]), f"{told}")
    check(result["device"] == name and "round trip" in result["numbers"] and result["verdict"] in told["text"], f"{told}")
    check("stopped" not in told and not shows_a_path(json.dumps(told)), f"a path is told: {told}")


def test_stop_beside_a_session(console, folder, name):
    """An emergency stop reaches the test and a session that somebody else has started meanwhile."""
    live = console.live()
    check(console.post("/api/test", {"device": name})[0] == 200, "a test before a foreign session")
    with subprocess.Popen([PROGRAMS / "trocar-run", folder / "scenes/outside.json", "--live", folder / "sessions/live", "--duration", "60",
                           "--recover", "signal", "--quiet"], stderr=subprocess.DEVNULL) as session:
        check(live.until(lambda l: l.state() == "running" and l.values and l.value("t_s") > 0.1, 4), f"{live.states}")
        check(console.get("/api/test")[1]["state"] == "running", "the test has ended before the emergency stop")
        check(console.post("/api/emergency_stop", token=None)[0] == 200, "an emergency stop of both")
        check(live.until(lambda l: any(e.get("fault") == "emergency_stop" for e in l.events), 5), f"{live.events}")
        check(after_test(console, STOP_WITHIN_s)["stopped"], "the test goes on after an emergency stop")
        check(console.post("/api/command", {"command": "stop"})[0] == 200 and live.until(lambda l: l.state() == "ended", 10), f"{live.states}")
        session.wait(20)
    live.close()


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_killed_test(folder, name, option, how):
    """A test ends with its console."""
    console = Console(CONSOLE, folder, "--device", option, page=PAGE)
    check([d["name"] for d in console.get("/api/folder")[1]["devices"]] == [name], "a list without inproc")
    check(console.post("/api/test", {})[0] == 200, "a test of the first device")
    tested = list(children(console))
    time.sleep(0.5)
    console.stop(how)
    end = time.monotonic() + TEST_WITHIN_s  # it ends by itself if the console could not end it
    while time.monotonic() < end and any(os.path.exists(f"/proc/{pid}") for pid in tested):
        time.sleep(0.05)
    check(tested and not any(os.path.exists(f"/proc/{pid}") for pid in tested), f"{how}: the test goes on")
