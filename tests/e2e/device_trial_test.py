# SPDX-License-Identifier: Apache-2.0
"""trocar-run test finds planted trouble of a drive: stalls of 3 ms, 2 % loss, 100 states a second, noisy encoders.

A machine with other work adds troubles of its own, so only the planted ones are asserted.
"""
import signal
import subprocess
import threading
import time

import pytest
from device_link_e2e_test import Simulator

SECONDS = "2"


def verdict(programs, simulator, *options):
    """(exit code, stdout) of a test of the simulator."""
    command = [programs / "trocar-run", "test", *simulator.link(),
               "--duration", SECONDS, *options]
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    assert done.stderr == "", done.stderr
    return done.returncode, done.stdout


@pytest.mark.parametrize("simulated, options, words", [
    ((), (), "round trip       median"),
    (("--rate", "100"), (), "states its pose only"),
    (("--rate", "100"), ("--rate", "100"), "a new state in"),
    (("--faults", "state-loss:0.02"), (), "of the device's states were lost"),
    (("--model", "full", "--encoder-noise", "0.0005"), (), "the pose trembles by"),
    (("--faults", "kill@1"), (), "the link was lost"),
])
def test_planted(programs, work, simulated, options, words):
    with Simulator(programs, work, *simulated) as simulator:
        code, text = verdict(programs, simulator, *options)
    print(text)
    assert text.startswith(f"The device gets no force for {SECONDS} s."), text
    assert words in text, text
    assert code == (5 if "trouble: " in text else 0)
    assert text.endswith("will not hold well.\n" if code else "should hold.\n")
    if "trouble" in words or words.startswith(("states", "of the", "the")):
        assert code == 5 and any(words in line for line in text.splitlines() if line.startswith("trouble: ")), text


def test_stalls_of_3_ms(programs, work):
    with Simulator(programs, work) as simulator:
        over = threading.Event()

        def stall():
            while not over.wait(0.1):
                simulator.process.send_signal(signal.SIGSTOP)
                time.sleep(0.003)
                simulator.process.send_signal(signal.SIGCONT)

        thread = threading.Thread(target=stall)
        thread.start()
        code, text = verdict(programs, simulator)
        over.set()
        thread.join()
    print(text)
    assert code == 5 and "the device was silent for up to" in text, text


def test_an_interrupted_test_has_no_verdict(programs, work):
    result = work / "interrupted.json"
    with Simulator(programs, work) as simulator:
        command = (programs / "trocar-run", "test", *simulator.link(),
                   "--duration", "60", "--summary", result)
        process = subprocess.Popen([str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        begun = process.stdout.readline()
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        text, errors = process.communicate(timeout=30)
    assert begun.startswith("The device gets no force for 60 s."), begun
    said = "trocar-run: interrupted: the device was not tested to the end\n"
    assert (process.returncode, text, errors) == (5, "", said), (process.returncode, text, errors)
    assert not result.exists()
