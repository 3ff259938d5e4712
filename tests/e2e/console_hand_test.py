# SPDX-License-Identifier: Apache-2.0
"""A live hand over the console's WebSocket. It pushes the needle into bone; a closed page, a killed console and a silent page stop the pushing;
hostile messages, 20,000 or TROCAR_HAND_MESSAGES of them, cause no fault and need no memory; --hand-path repeats a session. (Pauses, two
holders, replays: console/drive_hand.mjs.)"""
import json
import math
import os
import random
import signal
import subprocess
import threading
import time

import pytest

from console_client import BINARY, TEXT, Closed, Console, Live, WebSocket
from console_server_test import CONSOLE, make_folder, newest
from e2e import check
from exported import rows_of
from programs import PROGRAMS, SOURCE, WORK

MESSAGES = int(os.environ.get("TROCAR_HAND_MESSAGES", "20000"))
FRAME_S = 1 / 60
START_M = (0, 0, 0.162)
CLOSED = (1008, "end of stream", "reset")  # without a code if a message was on its way to the client


@pytest.fixture(name="folder", scope="module")
def folder_of_scenes():
    """With vertebra_live.json, and a sheet of the law hooke whose hand is live."""
    folder = make_folder()
    scene = json.loads((SOURCE / "runtime/scenes/vertebra_live.json").read_text())
    (folder / "scenes/live.json").write_text(json.dumps(scene | {"asset": "../sample.glb"}))
    sheet = json.loads((folder / "scenes/one_slice.json").read_text())
    hand = {"live": True, "trajectory": [{"t_s": 0, "tip_m": [0, 0, 0.125]}]}
    (folder / "scenes/sheet.json").write_text(json.dumps(sheet | {"hand": hand, "duration_s": 600}))
    return folder


@pytest.fixture(name="console", scope="module")
def started_console(folder):
    console = Console(CONSOLE, folder)
    yield console
    check(console.stop() == 0, "the console's exit code")


class Page:
    """A page that holds the hand: it sends the target with each frame, on a thread of its own."""

    def __init__(self, console, target=START_M, sends=True):
        self.live = Live(console.port, console.token)
        self.target, self.number, self.sends = [*target, 0, 0, 0], 0, sends
        self.samples = []  # (t_s, tip z, force along z) of the snapshots
        self.gone = threading.Event()
        self.lock = threading.Lock()  # two threads send
        send = self.live.web.send

        def locked(*arguments):
            with self.lock:
                send(*arguments)
        self.live.web.send = locked
        self.threads = [threading.Thread(target=run, daemon=True) for run in (self._receive, self._send)]
        for thread in self.threads:
            thread.start()

    def _receive(self):
        try:
            while not self.gone.is_set():
                if self.live.next() == 1:
                    self.samples.append((self.live.value("t_s"), self.live.value("tool_m", 2), force_of(self.live)))
        except (OSError, Closed, ValueError):
            pass

    def _send(self):
        try:
            while not self.gone.wait(FRAME_S):
                if self.sends:
                    self.number += 1
                    self.live.web.send(json.dumps({"hand": self.target, "n": self.number}))
        except OSError:
            pass

    def wait(self, condition, timeout=20):
        end = time.monotonic() + timeout
        while not condition(self.live):
            if time.monotonic() > end:
                return False
            time.sleep(0.005)
        return True

    def push_to(self, force_N, deepest_m=0.115, speed_m_per_s=0.02):
        """Lowers the target until the force is reached."""
        while self.target[2] > deepest_m:
            if self.samples and self.samples[-1][2] >= force_N:
                return True
            self.target[2] -= speed_m_per_s * FRAME_S
            time.sleep(FRAME_S)
        return False

    def close(self):
        self.gone.set()
        self.live.close()
        for thread in self.threads:
            thread.join()


def force_of(live):
    return math.hypot(*live.array("wrench_delivered")[:3])


def start(console, scene):
    status, answer = console.post("/api/start", {"scene": f"scenes/{scene}.json"})
    check(status == 200, f"start of {scene}: {answer}")
    watcher = console.live()
    check(watcher.until(lambda live: live.state() == "running" and live.values), f"{scene} does not run: {watcher.states}")
    return watcher


def stop(console, watcher):
    console.post("/api/command", {"command": "stop"})
    check(watcher.until(lambda live: live.state() in ("ended", "lost")), "the session does not end")
    watcher.close()


def check_fall(how, events, kind, recording, force_N):
    """The force falls below a tenth, and stays there, within 50 ms of the session's time after the event, 250 ms before which the watchdog
    began to wait."""
    from_s = next(event["t_s"] for event in events if event["kind"] == kind)
    until_s = min([from_s + 0.5] + [event["t_s"] for event in events if event["kind"] == "hand" and event["t_s"] > from_s])
    rows = [(float(row["t_s"]), math.hypot(*(float(row[f"f{axis}_delivered_N"]) for axis in "xyz"))) for row in rows_of(recording)]
    before_N = max(force for t_s, force in rows if from_s - 0.02 <= t_s <= from_s)
    check(before_N > 0.6 * force_N, f"{how}: the force was {before_N:.1f} N")
    passed_s = max(t_s for t_s, force in rows if t_s <= until_s and force >= before_N / 10) - from_s
    print(f"{how} at {before_N:.1f} N: below a tenth {1e3 * passed_s:.0f} ms after {kind}")
    check(passed_s <= 0.05, f"{how}: the force falls within {passed_s} s")


def test_push(console, folder):
    shown = {s["file"]: s for s in console.get("/api/folder")[1]["scenes"]}
    check(shown["scenes/live.json"].get("live_hand") is True and "live_hand" not in shown["scenes/vertebra.json"], "live_hand of the folder")
    watcher = start(console, "live")
    about = watcher.hello["hand"]
    check(about["live"] and about["stiffness_N_per_m"] == 8000 and about["start"]["tip_m"] == list(START_M), f"about: {about}")
    check(all(low < x < high for low, x, high in zip(about["box"]["min_m"], START_M, about["box"]["max_m"])), f"box: {about['box']}")
    check(watcher.until(lambda live: live.hands == ["free"]), f"a free hand: {watcher.hands}")
    page = Page(console)
    check(page.wait(lambda live: live.hands[-1:] == ["yours"]), f"the hand is not ours: {page.live.hands}")
    check(watcher.until(lambda live: "hand" in live.kinds() and live.hands[-1] == "other"), f"{watcher.hands}, {watcher.kinds()}")
    check(page.push_to(25), "25 N are not reached")
    page.close()  # in the middle of pushing
    check(watcher.until(lambda live: "hand_let_go" in live.kinds() and force_of(live) < 2), f"the force stays, or no event: {watcher.kinds()}")
    check(watcher.until(lambda live: live.hands[-1] == "free"), f"{watcher.hands}")
    stop(console, watcher)
    check_fall("page closed", watcher.events, "hand_let_go", newest(folder) / "session.csv", 25)


def test_silence(console, folder):
    """The law cutting, and a sheet that follows the tip: there the target has a longer way back."""
    for scene, force_N in (("live", 25), ("sheet", 25)):
        watcher = start(console, scene)
        page = Page(console, watcher.hello["hand"]["start"]["tip_m"])
        check(page.wait(lambda live: live.hands[-1:] == ["yours"]) and page.push_to(force_N, 0.108), f"{scene}: {force_N} N are not reached")
        page.sends = False
        check(watcher.until(lambda live: "hand_lost" in live.kinds() and force_of(live) < 2), f"the force stays, or no event: {watcher.kinds()}")
        check(watcher.until(lambda live: live.hands[-1] == "free", 5), "the hand is not free after silence")
        check("fault" not in watcher.kinds(), f"{watcher.kinds()}")
        page.close()
        stop(console, watcher)
        check_fall(f"page silent on {scene}", watcher.events, "hand_lost", newest(folder) / "session.csv", force_N)


def test_taken_again_untold(console):
    """A page lets go and takes the hand again while the console cannot send to it. It is told again that the hand is its own."""
    start(console, "live").close()
    for _ in range(3000):  # their events are more than a socket takes
        check(console.post("/api/xray", {"take": "shot"})[0] == 200, "a shot")
    page, target = Live(console.port, console.token, receive_buffer=16384), [*START_M, 0, 0, 0]
    page.web.send(json.dumps({"hand": target, "n": 1}))
    check(page.until(lambda live: "yours" in live.hands), f"the hand is not ours: {page.hands}")
    told = len(page.hands)
    time.sleep(0.3)  # nothing is read, so a message of the console's waits
    for message in ({"hand": None}, {"hand": target, "n": 2}):
        page.web.send(json.dumps(message))
    time.sleep(0.1)
    check(page.until(lambda live: "yours" in live.hands[told:], 10), f"the hand that was taken again is not told: {page.hands}")
    page.close()
    stop(console, console.live())


def close_code(web, message, opcode=TEXT):
    """What closes the connection after this message."""
    return web.closed_by([(message, opcode)])


def operator(console):
    web = WebSocket(console.port)
    web.send(json.dumps({"token": console.token}))
    return web


def malformed(rng):
    good = [rng.uniform(-0.1, 0.2) for _ in range(6)]
    wrong = rng.choice([1e300, -1e300, 1.5, -7, "0", None, True, [], {}, 10**400])
    at = rng.randrange(6)
    return rng.choice([
        json.dumps({"hand": good[:at], "n": 1}), json.dumps({"hand": good + good, "n": 1}), json.dumps({"hand": good}),
        json.dumps({"hand": good, "n": -1}), json.dumps({"hand": good, "n": 0.5}), json.dumps({"hand": good, "n": "1"}),
        json.dumps({"hand": good, "n": 1, "ack": 1}), json.dumps({"hand": "null"}), json.dumps({"hand": None, "n": -3}),
        json.dumps({"hand": {"x": 0}, "n": 1}), json.dumps({"hand": [*good[:at], wrong if at < 3 or wrong != -7 else 8, *good[at + 1:]], "n": 1}),
        '{"hand": [NaN, 0, 0, 0, 0, 0], "n": 1}', '{"hand": [0, Infinity, 0, 0, 0, 0], "n": 1}', '{"hand": [1e999, 0, 0, 0, 0, 0], "n": 1}',
        '{"hand": [0, 0, 0, 0, 0, 0], "n": 1, "n": 2}', '{"hand": [0, 0, 0, 0, 0, 0], "n": 1', f'{{"hand": {"[" * 500}'])


def test_hostile(console):
    rng = random.Random(20261125)
    for scene in ("sheet", "live"):
        watcher = start(console, scene)
        for _ in range(min(300, MESSAGES // 20)):
            message = malformed(rng)
            code = close_code(operator(console), message)
            check(code in CLOSED, f"{message[:80]}: {code}")
        check(close_code(operator(console), b"\1", BINARY) in CLOSED, "binary")
        check(close_code(console.live(console.view).web, json.dumps({"hand": [0, 0, 0.162, 0, 0, 0], "n": 1})) in CLOSED, "a hand from the audience")
        check(watcher.hands[-1:] in ([], ["free"]), "a malformed message takes the hand")
        watcher.close()
        watcher, flooder = (Page(console, sends=False) for _ in range(2))  # they read meanwhile
        check(watcher.wait(lambda live: live.values) and flooder.wait(lambda live: live.values), f"{scene}: no snapshots")
        before_kB, number = console.rss_kB(), 0
        while number < MESSAGES:
            # A flood, jumps all over, targets far outside; then calm for some frames.
            mood = rng.randrange(4)
            for _ in range(rng.choice((3, 30, 300))):
                number += 1
                reach_m, reach_rad = ((0.05, 0.3), (1, 7), (0.06, 1), (1e-3, 0))[mood]
                target = [rng.uniform(-reach_m, reach_m) for _ in range(3)] + [rng.uniform(-reach_rad, reach_rad) for _ in range(3)]
                if mood != 1:
                    target[2] += 0.12
                flooder.live.web.send(json.dumps({"hand": target, "n": number} if rng.random() > 0.001 else {"hand": None}))
            time.sleep(rng.choice((0, FRAME_S, 5 * FRAME_S)))
        time.sleep(0.5)
        after_kB, watched = console.rss_kB(), watcher.live
        print(f"{scene}: {number} hostile messages, console {before_kB} to {after_kB} kB, {watched.value('punctures'):.0f} punctures, "
              f"events {sorted(set(watched.kinds()))}")
        check("hand" in watched.kinds() and watched.value("t_s") > 1, f"{scene}: nothing happened")
        check(after_kB - before_kB < 4000, f"the console grew from {before_kB} to {after_kB} kB")
        check(watched.state() == "running", f"{scene}: {watched.states[-1:]}")
        faults = [event for event in watched.events if event["kind"] == "fault"]
        check(not [fault for fault in faults if fault["fault"] in ("speed", "joint_limit", "workspace", "singularity", "tool_tilt",
                                                                     "pose_residual", "encoder_jump")], f"{scene}: {faults}")
        watcher.close()
        flooder.close()
        stop(console, console.live())


def test_killed_console(folder):
    """A session that a console watches: the console is killed while it pushes. The hand's path repeats the session."""
    link, record, path, again = WORK / "link", WORK / "live.csv", WORK / "path.json", WORK / "again.csv"
    run = subprocess.Popen([PROGRAMS / "trocar-run", folder / "scenes/live.json", "--live", link, "--record", record, "--hand-path", path,
                            "--recover", "signal", "--quiet"])
    while not link.is_symlink() and run.poll() is None:
        time.sleep(0.01)
    consoles = [Console(CONSOLE, folder, "--attach", link) for _ in range(2)]
    watcher = consoles[1].live()
    check(watcher.until(lambda live: live.values), "nothing to watch")
    page = Page(consoles[0])
    check(page.wait(lambda live: live.hands[-1:] == ["yours"]) and page.push_to(25), "25 N are not reached")
    consoles[0].process.send_signal(signal.SIGKILL)
    check(watcher.until(lambda live: "hand_lost" in live.kinds() and force_of(live) < 2), f"the force stays, or no event: {watcher.kinds()}")
    page.close()
    page = Page(consoles[1], watcher.array("tool_m"))
    check(page.wait(lambda live: live.hands[-1:] == ["yours"]) and page.push_to(30, 0.11), "30 N are not reached")
    page.target[2] = 0.165
    check(watcher.until(lambda live: live.value("tool_m", 2) > 0.16), "the needle does not come out")
    page.close()
    consoles[1].post("/api/command", {"command": "stop"})
    run.send_signal(signal.SIGINT)
    check(run.wait(20) == 0, f"trocar-run ended with {run.returncode}")
    check_fall("console killed", watcher.events, "hand_lost", record, 25)
    watcher.close()
    for console in consoles:
        console.stop(signal.SIGKILL)

    scene, forces = json.loads((folder / "scenes/live.json").read_text()), [float(row["fz_delivered_N"]) for row in rows_of(record)]
    repeated = folder / "scenes/repeated.json"
    repeated.write_text(json.dumps(scene | {"hand": json.loads(path.read_text()), "duration_s": len(forces) / 1000}))
    subprocess.run([PROGRAMS / "trocar-run", repeated, "--clock", "virtual", "--record", again, "--quiet"], check=True)
    off_N = [float(row["fz_delivered_N"]) - force_N for row, force_N in zip(rows_of(again), forces, strict=True)]
    check(math.hypot(*off_N) < 0.05 * max(forces) * math.sqrt(len(off_N)), f"repeated, the force differs by {math.hypot(*off_N)} N")
