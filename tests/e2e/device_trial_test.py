# SPDX-License-Identifier: Apache-2.0
"""trocar-run test finds planted trouble of a drive: 2 % loss, 100 states a second, noisy encoders. (Silence, and a test that is stopped:
runtime/check/device_trial_test.cpp, console_device_test.py.)

A machine with other work adds troubles of its own, so only the planted ones are asserted.
"""
import subprocess

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
