# SPDX-License-Identifier: Apache-2.0
"""console_hand_test.py SOURCE PROGRAMS ASSET WORK [--messages N]: a live hand over the console's WebSocket. It pushes the needle into
bone; a closed page, a killed console and a silent page stop the pushing; one client holds it at a time; hostile messages, N or 20,000
of them, cause no fault and need no memory; a replay has the same bytes; --hand-path repeats the session."""
import argparse
import json
import math
import pathlib
import random
import signal
import subprocess
import sys
import threading
import time

from console_client import BINARY, TEXT, Closed, Console, Live, WebSocket
from console_server_test import make_folder, newest
from e2e import check, outcome
from exported import rows_of

FRAME_S = 1 / 60
START_M = (0, 0, 0.162)
CLOSED = (1008, "end of stream", "reset")  # without a code if a message was on its way to the client


def make_live_folder(source, asset, work):
    """The folder of scenes with vertebra_live.json, and a sheet of the law hooke whose hand is live."""
    folder = make_folder(source, asset, work)
    scene = json.loads((source / "runtime/scenes/vertebra_live.json").read_text())
    scene["asset"] = "../sample.glb"
    (folder / "scenes/live.json").write_text(json.dumps(scene))
    sheet = json.loads((folder / "scenes/one_slice.json").read_text())
    sheet["hand"] = {"live": True, "trajectory": [{"t_s": 0, "tip_m": [0, 0, 0.125]}]}
    sheet["duration_s"] = 600
    (folder / "scenes/sheet.json").write_text(json.dumps(sheet))
    return folder


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
    """Returns the session's recording."""
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
    recording = newest(folder) / "session.csv"
    check_fall("page closed", watcher.events, "hand_let_go", recording, 25)
    return recording


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


def test_pause(console):
    watcher = start(console, "live")
    page = Page(console)
    check(page.wait(lambda live: live.hands[-1:] == ["yours"]) and page.push_to(15), "15 N are not reached")
    console.post("/api/command", {"command": "pause"})
    check(watcher.until(lambda live: live.state() == "paused"), "no pause")
    check(watcher.until(lambda live: live.value("paused") == 1), "no snapshot of the pause")
    deepest_m = watcher.value("tool_m", 2)
    console.post("/api/command", {"command": "resume"})
    check(watcher.until(lambda live: "recovered" in live.kinds() or "not_recovered" in live.kinds()), f"no resume: {watcher.kinds()}")
    page.target[2] = START_M[2]  # out of the bone, which recovery needs
    check(watcher.until(lambda live: "recovered" in live.kinds()), f"no recovery: {watcher.kinds()}")
    check(watcher.value("tool_m", 2) > deepest_m, "the tip went deeper")
    page.close()
    stop(console, watcher)


def test_two_holders(console):
    watcher = start(console, "live")
    pages = [Page(console)]
    check(pages[0].wait(lambda live: live.hands[-1:] == ["yours"]), "the first does not get the hand")
    pages.append(Page(console, (0.02, 0, 0.162)))
    check(pages[1].wait(lambda live: live.hands[-1:] == ["other"]), "the second gets the hand")
    time.sleep(0.5)
    check(watcher.until(lambda live: abs(live.value("tool_m")) < 1e-4), f"the second moves the tip: {watcher.array('tool_m')}")
    pages[0].sends = False
    pages[0].live.web.send('{"hand": null}')
    check(pages[1].wait(lambda live: live.hands[-1] == "yours"), "the second does not get the hand that was let go")
    check(watcher.until(lambda live: abs(live.value("tool_m") - 0.02) < 1e-3), "the second does not move the tip")
    view = console.live(console.view)
    check(view.until(lambda live: live.hands == ["other"]), f"the audience is told {view.hands}")
    check(close_code(view.web, json.dumps({"hand": [0, 0, 0.162, 0, 0, 0], "n": 1})) in CLOSED, "a hand from the audience")
    for page in pages:
        page.close()
    stop(console, watcher)


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


def test_hostile(console, messages):
    rng = random.Random(20261125)
    for scene in ("sheet", "live"):
        watcher = start(console, scene)
        for _ in range(min(300, messages // 20)):
            message = malformed(rng)
            code = close_code(operator(console), message)
            check(code in CLOSED, f"{message[:80]}: {code}")
        check(close_code(operator(console), b"\1", BINARY) in CLOSED, "binary")
        check(watcher.hands[-1:] in ([], ["free"]), "a malformed message takes the hand")
        watcher.close()
        watcher, flooder = (Page(console, sends=False) for _ in range(2))  # they read meanwhile
        check(watcher.wait(lambda live: live.values) and flooder.wait(lambda live: live.values), f"{scene}: no snapshots")
        before_kB, number = console.rss_kB(), 0
        while number < messages:
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


def test_replay(programs, folder, recording, *options):
    again = folder / "again.csv"
    done = subprocess.run([programs / "trocar-run", "replay", folder / "scenes/live.json", recording, "--record", again, *options],
                          capture_output=True, text=True, check=False)
    check(done.returncode == 0 and "identical" in done.stdout + done.stderr, f"replay: {done.returncode}: {done.stdout}{done.stderr}")
    check(again.read_bytes() == recording.read_bytes(), "a replay has other bytes")


ARM = {"schema": "trocar.pose_device/1", "name": "arm", "force_max_N": 8, "mass_kg": 0.3, "damping_N_s_per_m": 1, "stiffness_max_N_per_m": 2000,
       "position_resolution_m": 2e-5, "workspace_min_m": [-0.08, -0.08, -0.08], "workspace_max_m": [0.08, 0.08, 0.08]}


def test_pose_device(programs, folder, work):
    """A live hand on a simulated device of another maker, which renders 8 N at most."""
    arm = work / "arm.json"
    arm.write_text(json.dumps(ARM))
    console = Console(programs / "trocar-console", folder, "--device", f"inproc,device-description={arm}")
    try:
        watcher = start(console, "live")
        page = Page(console)
        check(page.wait(lambda live: live.hands[-1:] == ["yours"]) and page.push_to(2), "2 N are not reached on the arm")
        page.close()
        check(watcher.until(lambda live: "hand_let_go" in live.kinds() and force_of(live) < 0.2), f"the force stays: {watcher.kinds()}")
        check("fault" not in watcher.kinds(), f"{watcher.kinds()}")
        stop(console, watcher)
        recording = newest(folder) / "session.csv"
        # The console kills a session whose forces are not zero within 100 ms of an emergency stop. This one's are.
        watcher = start(console, "live")
        page = Page(console)
        check(page.wait(lambda live: live.hands[-1:] == ["yours"]) and page.push_to(2), "2 N are not reached again")
        console.post("/api/emergency_stop")
        check(watcher.until(lambda live: "fault" in live.kinds() and force_of(live) == 0), f"the force stays: {watcher.kinds()}")
        check(not watcher.until(lambda live: live.state() == "lost", 0.5), "a session with zero force was killed")
        page.close()
        stop(console, watcher)
    finally:
        check(console.stop() == 0, "the console's exit code")
    rows = rows_of(recording)
    check("fz_device_N" in rows[0] and max(float(row["fz_device_N"]) for row in rows) <= 8 * (1 + 1e-9), "forces of the arm")
    test_replay(programs, folder, recording, "--device-description", arm)


def test_killed_console_and_path(programs, folder, work):
    """A session that a console watches: the console is killed while it pushes."""
    link, path, record = work / "link", work / "path.json", work / "live.csv"
    run = subprocess.Popen([programs / "trocar-run", folder / "scenes/live.json", "--live", link, "--hand-path", path, "--record", record,
                            "--recover", "signal", "--quiet"])
    while not link.is_symlink() and run.poll() is None:
        time.sleep(0.01)
    consoles = [Console(programs / "trocar-console", folder, "--attach", link) for _ in range(2)]
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

    # The path as the hand of another scene.
    hand = json.loads(path.read_text())
    scene = json.loads((folder / "scenes/live.json").read_text())
    rows = rows_of(record)
    repeated = work / "folder/scenes/repeated.json"
    repeated.write_text(json.dumps({**scene, "hand": hand, "duration_s": len(rows) / 1000}))
    again = work / "again.csv"
    done = subprocess.run([programs / "trocar-run", repeated, "--clock", "virtual", "--record", again, "--quiet"], check=False)
    check(done.returncode == 0, f"the repeated session ended with {done.returncode}")

    def course(file):
        return [float(row["fz_delivered_N"]) for row in rows_of(file)]
    first, second = course(record), course(again)
    most_N = max(abs(x) for x in first)
    off_N = math.sqrt(sum((a - b)**2 for a, b in zip(first, second)) / len(first))
    print(f"repeated by {len(hand['trajectory'])} keyframes: at most {most_N:.1f} N, {off_N:.3f} N apart (root mean square)")
    check(len(first) == len(second) and off_N < 0.05 * most_N, f"the force differs by {off_N:.2f} of {most_N:.1f} N")


def main():
    parser = argparse.ArgumentParser()
    for name in ("source", "programs", "asset", "work"):
        parser.add_argument(name, type=pathlib.Path)
    parser.add_argument("--messages", type=int, default=20_000)
    arguments = parser.parse_args()
    folder = make_live_folder(arguments.source, arguments.asset, arguments.work)
    console = Console(arguments.programs / "trocar-console", folder)
    try:
        recording = test_push(console, folder)
        test_replay(arguments.programs, folder, recording)
        test_silence(console, folder)
        test_pause(console)
        test_two_holders(console)
        test_taken_again_untold(console)
        test_hostile(console, arguments.messages)
    finally:
        check(console.stop() == 0, "the console's exit code")
    test_pose_device(arguments.programs, folder, arguments.work)
    test_killed_console_and_path(arguments.programs, folder, arguments.work)
    return outcome()


if __name__ == "__main__":
    sys.exit(main())
