# SPDX-License-Identifier: Apache-2.0
"""What the end-to-end tests share: running a program, and collecting what did not hold."""
import os
import subprocess
import sys

failures = []
# What a session's summary says of allocations: nothing, where a sanitizer's allocator stands in the counter's place.
NO_ALLOCATIONS = None if os.environ.get("TROCAR_SANITIZE") else 0


def check(condition, message):
    if not condition:
        failures.append(message)


def outcome():
    """Says what did not hold, and gives the exit code."""
    for failure in failures:
        print("FAILED", failure)
    return 1 if failures else 0


def run(*command, expect=0, **keys):
    """The finished process; ends the test if its exit code is not the expected one. `keys`: subprocess's."""
    done = subprocess.run([str(word) for word in command], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True, check=False, **keys)
    if done.returncode != expect:
        print(" ".join(map(str, command)), "ended with", done.returncode, "not", expect)
        print(done.stdout[-2000:], done.stderr[-2000:])
        sys.exit(1)
    return done
