# SPDX-License-Identifier: Apache-2.0
"""Shared by the end-to-end tests: running a program, and collecting failures."""
import os
import subprocess
import sys

failures = []
SANITIZED = bool(os.environ.get("TROCAR_SANITIZE"))
# trocar-run with counted allocations (tests/reference/hooks), and what its summary says of them if there were none: sanitizers
# replace the allocator themselves, and nothing is counted then. The shipped trocar-run never counts: null.
COUNTED_RUN = "trocar-run-counted"
NO_ALLOCATIONS = None if SANITIZED else 0


def check(condition, message):
    if not condition:
        failures.append(message)


def outcome():
    """Prints the failures and returns the exit code."""
    for failure in failures:
        print("FAILED", failure)
    return 1 if failures else 0


def run(*command, expect=0, **keys):
    """Returns the finished process; ends the test if its exit code is not `expect`. `keys` go to subprocess.run."""
    done = subprocess.run([str(word) for word in command], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True, check=False, **keys)
    if done.returncode != expect:
        print(" ".join(map(str, command)), "ended with", done.returncode, "not", expect)
        print(done.stdout[-2000:], done.stderr[-2000:])
        sys.exit(1)
    return done
