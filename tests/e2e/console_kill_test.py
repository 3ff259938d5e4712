# SPDX-License-Identifier: Apache-2.0
"""Consoles with a page are killed, stopped and started again a hundred times during sessions. With the virtual clock a recording is byte for byte the
same as one without a console. In real time, a window with a console misses no more deadlines than one without, in pairs of windows of one session
(sign test)."""
import json
import math
import os
import random
import signal
import subprocess
import time

from chromium_page import PAGE
from console_client import Closed, Console
from console_server_test import CONSOLE, make_folder
from e2e import check
from live_reader import Live
from programs import PROGRAMS

TIMES = 100
WINDOW_S, PAIRS = 0.5, 40
SIGNIFICANT = 1e-3  # of a sign test: at least 30 of 40 pairs worse


def disturb(folder, link, goes_on, most, counts):
    """Starts consoles on the session's link, each with a page, and kills them in turn, some after they were stopped for a while."""
    while goes_on() and sum(counts.values()) < most:
        console = Console(CONSOLE, folder, "--attach", link, page=PAGE, stderr=subprocess.DEVNULL)
        try:
            live = console.live()
            live.until(lambda l: l.values is not None, 0.3)
            kind = len(counts) and sum(counts.values()) % 3
            if kind == 1:
                console.process.send_signal(signal.SIGSTOP)
                time.sleep(0.05)
                console.process.send_signal(signal.SIGCONT)
                live.until(lambda l: False, 0.02)
            elif kind == 2:
                console.process.send_signal(signal.SIGSTOP)
                time.sleep(0.02)
            live.close()
        except (AssertionError, OSError, Closed):
            pass
        name = ("killed", "stopped and went on", "killed while stopped")[kind]
        counts[name] = counts.get(name, 0) + 1
        console.stop(signal.SIGKILL)


def session(folder, name, link, *options):
    words = [PROGRAMS / "trocar-run", folder / "scenes/three_slices.json", "--record", folder / f"{name}.csv", "--summary",
             folder / f"{name}.summary.json", "--quiet", "--recover", "signal", *options]
    return subprocess.Popen([str(w) for w in words + (["--live", link] if link else [])], stderr=subprocess.DEVNULL)


def test_consoles_do_not_disturb_a_session():
    folder = make_folder()
    link = folder / "link"
    virtual = ("--clock", "virtual", "--duration", "60")
    check(session(folder, "alone", None, *virtual).wait() == 0, "the session without a console")
    expected = (folder / "alone.csv").read_bytes()
    counts, sessions = {}, 0
    while sum(counts.values()) < TIMES * 3 // 5:
        process = session(folder, "beside", link, *virtual)
        while not link.is_symlink() and process.poll() is None:
            time.sleep(0.001)
        disturb(folder, link, lambda: process.poll() is None, TIMES * 3 // 5, counts)
        check(process.wait() == 0, "the session beside consoles")
        sessions += 1
        check((folder / "beside.csv").read_bytes() == expected, "a recording beside consoles differs")
    print(f"virtual clock: {counts} in {sessions} sessions of {len(expected.splitlines()) - 1} ticks, recordings identical")

    # In each pair of windows a console is started, disturbed and killed in the one and not in the other, in random order: what else
    # the machine does hits both alike. The loop has a processor, this script and its consoles have the others.
    processors = sorted(os.sched_getaffinity(0))
    alone_on = ("--cpu", str(processors[-1])) if len(processors) > 1 else ()
    process = session(folder, "real", link, "--duration", "600", *alone_on)
    if alone_on:
        os.sched_setaffinity(0, processors[:-1])
    while not link.is_symlink() and process.poll() is None:
        time.sleep(0.001)
    live, chance, missed = Live(link), random.Random(1), {False: [], True: []}

    def deadlines_missed():
        while (snapshot := live.snapshot()) is None and process.poll() is None:
            time.sleep(0.001)
        return int(snapshot["missed_deadlines"][0])

    for _ in range(PAIRS):
        for with_console in chance.sample((False, True), 2):
            before, end = deadlines_missed(), time.monotonic() + WINDOW_S
            if with_console:
                disturb(folder, link, lambda: process.poll() is None, sum(counts.values()) + 1, counts)
            time.sleep(max(0, end - time.monotonic()))
            missed[with_console].append(deadlines_missed() - before)
            time.sleep(0.1)
    live.command("stop")
    check(process.wait() == 0, "the session in real time")
    os.sched_setaffinity(0, processors)
    summary = json.loads((folder / "real.summary.json").read_text())
    worse = sum(b > a for a, b in zip(missed[False], missed[True]))
    better = sum(b < a for a, b in zip(missed[False], missed[True]))
    by_chance = sum(math.comb(worse + better, k) for k in range(worse, worse + better + 1)) / 2 ** (worse + better)
    print(f"consoles in all: {counts}")
    print(f"real time, {PAIRS} pairs of windows of {WINDOW_S} s: missed deadlines without {missed[False]}, with {missed[True]}; "
          f"sums {sum(missed[False])}, {sum(missed[True])}")
    print(f"more were missed with a console in {worse} pairs, fewer in {better}; by chance alone with probability {by_chance:.3g}")
    check(sum(counts.values()) >= TIMES, f"only {counts}")
    if summary["realtime"]["realtime_priority"]:
        check(by_chance > SIGNIFICANT, f"consoles make the loop miss deadlines: {missed}")
    else:
        print("not judged: this machine grants the loop no realtime priority, so any program may hold it up")
