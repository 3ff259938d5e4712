# SPDX-License-Identifier: Apache-2.0
"""For tests that are not run by pytest yet: check() collects failures, and outcome() ends the test with them."""
import pathlib
import sys

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from programs import COUNTED_RUN, NO_ALLOCATIONS, SANITIZED, run  # noqa: E402, F401

failures = []


def check(condition, message):
    if not condition:
        failures.append(message)


def outcome():
    """Prints the failures and returns the exit code."""
    for failure in failures:
        print("FAILED", failure)
    return 1 if failures else 0
