# SPDX-License-Identifier: Apache-2.0
"""Sessions over the device link on a machine that stalls both programs for 30 ms once a second.

 1. With a simulated drive (trocar-run --simulated, trocar-device-sim --watchdog 0.25) every session ends well, and
    its late ticks are counted, by their causes.
 2. With a drive that is taken to have motors a stall ends the session, as a rule with deadline_missed.

TROCAR_STALLED_SESSIONS: number of sessions of item 1 (default: 3).
"""
import json
import os
import signal
import subprocess
import threading
import time

from device_link_e2e_test import STALLS, Simulator
from exported import rows_of
from programs import run

SESSIONS = int(os.environ.get("TROCAR_STALLED_SESSIONS", "3"))
STALL_S, EVERY_S = 0.030, 1.0


def stalled_session(programs, work, scene, asset, simulator_options, *options, stalls=("run", "drive")):
    """(exit code, stderr, summary) of a session during which the programs named by `stalls`, trocar-run and its drive, are stopped for
    STALL_S once in EVERY_S."""
    summary = work / "stalled.json"
    with Simulator(programs, work, scene, *simulator_options) as simulator:
        command = [programs / "trocar-run", scene, "--asset", asset, *simulator.link(), "--quiet", "--summary", summary, "--record", work / "stalled.csv",
                   "--black-box", work, *options]
        with subprocess.Popen([str(word) for word in command], stderr=subprocess.PIPE, text=True) as process:
            over = threading.Event()

            def stall():
                while not over.wait(EVERY_S):
                    for how, pause_s in ((signal.SIGSTOP, STALL_S), (signal.SIGCONT, 0)):
                        for name, one in (("run", process), ("drive", simulator.process)):
                            if name in stalls:
                                one.send_signal(how)
                        time.sleep(pause_s)

            thread = threading.Thread(target=stall)
            thread.start()
            _, stderr = process.communicate()
            over.set()
            thread.join()
    return process.returncode, stderr, json.loads(summary.read_text())


def test_a_simulated_drive_rides_it_out(source, programs, asset, work):
    scene = source / "runtime" / "scenes" / "three_slices.json"
    for session in range(SESSIONS):
        code, stderr, summary = stalled_session(programs, work, scene, asset, ("--watchdog", "0.25"), "--simulated")
        assert code == 0, f"session {session + 1} of {SESSIONS} ended with {code}: {stderr}"
        by = summary["missed_deadlines_by"]
        print(f"session {session + 1}: {summary['missed_deadlines']} missed deadlines: {by}")
        assert summary["missed_deadlines_in_row_max"] >= 25, "the stalls came too late"
        assert len(summary["punctures"]) == 3
        run(programs / "trocar-run", "replay", scene, "--asset", asset, work / "stalled.csv", "--quiet")
        # The count in the summary also has what was missed after the last tick began.
        assert 0 <= summary["missed_deadlines"] - sum(by.values()) <= summary["missed_deadlines_in_row_max"]


def test_a_simulated_drive_that_stalls_alone_ends_no_session(source, programs, asset, work):
    """With motors, 10 ms without a state are a fault; the replay must know that here they were none."""
    scene = source / "runtime" / "scenes" / "three_slices.json"
    code, stderr, _ = stalled_session(programs, work, scene, asset, ("--watchdog", "0.25"), "--simulated", stalls=("drive",))
    assert code == 0, f"ended with {code}: {stderr}"
    rows = rows_of(work / "stalled.csv")
    assert "no-data-limit=0.25" in rows[0]["origin"]
    silent = "".join(row["device_read"] == "no_data" and "x" or " " for row in rows)
    assert "x" * 15 in silent, "no stall came"
    run(programs / "trocar-run", "replay", scene, "--asset", asset, work / "stalled.csv", "--quiet")


def test_a_drive_with_motors_ends_the_session(source, programs, asset, work):
    scene = source / "runtime" / "scenes" / "three_slices.json"
    for options in ((), ("--late-ticks-in-row", "3")):
        code, stderr, summary = stalled_session(programs, work, scene, asset, ("--watchdog", "0.25"), *options)
        assert code == 5, f"ended with {code}: {stderr}"
        named = [fault["fault"] for fault in summary["faults"]]
        print(f"ended with {named}")
        # A machine with other work may stall the drive before the test does.
        assert len(named) == 1 and named[0] in STALLS, stderr
