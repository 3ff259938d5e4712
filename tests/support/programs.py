# SPDX-License-Identifier: Apache-2.0
"""The folders that a Python test works with, and running a program. ctest sets TROCAR_BUILD and TROCAR_WORK (functions.cmake)."""
import os
import pathlib
import subprocess

SOURCE = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(os.environ.get("TROCAR_BUILD") or SOURCE / "build/release").resolve()
PROGRAMS = BUILD / "bin"
SCAN = BUILD / "e2e/scan"  # output of trocar-sample-ct; the fixture `scan` of ctest makes it
ASSETS = BUILD / "assets"  # assets of the scans; the fixture `scan_assets` of ctest makes them
# Files that the test writes. The folder is empty at the start and remains afterwards.
WORK = pathlib.Path(os.environ.get("TROCAR_WORK") or BUILD / "e2e/by_hand").resolve()
REAL_CT = pathlib.Path(os.environ.get("TROCAR_REAL_CT") or SOURCE.parent / "shared/ct") / "l3"  # folder of a clinical scan
L3_SCAN = REAL_CT / "sub-ct_label-22_ct.nii.gz"
HEAD_CT = pathlib.Path(os.environ.get("TROCAR_HEAD_CT") or "/no/head_ct").resolve()  # a file; scripts/head-ct fetches it
SANITIZED = bool(os.environ.get("TROCAR_SANITIZE"))
# trocar-run with counted allocations (tests/reference/hooks), and the number in its summary if there were none. Sanitizers
# replace the allocator, so that nothing is counted under them. The shipped trocar-run never counts: null.
COUNTED_RUN = "trocar-run-counted"
NO_ALLOCATIONS = None if SANITIZED else 0


def run(*command, expect=0, **keys):
    """Returns the finished process; its exit code must be `expect`, unless that is None. `keys` go to subprocess.run."""
    done = subprocess.run([str(word) for word in command], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True, check=False, **keys)
    assert expect in (None, done.returncode), (f"{' '.join(map(str, command))} ended with {done.returncode}, not {expect}\n"
                                       f"{done.stdout[-2000:]} {done.stderr[-2000:]}")
    return done
