# SPDX-License-Identifier: Apache-2.0
"""snakemake_test.py SOURCE PROGRAMS SCAN WORK [SCANS]: the example for workflow engines, scripts/snakemake/Snakefile, makes the store that
`trocar-mesh batch` makes, also if it is killed in the middle and run again. Skipped without Snakemake (scripts/setup farm)."""
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import time

from e2e import check, outcome, run
from farm_collection import content_of, made_again, make_collection, strays

SOURCE, PROGRAMS, SCAN, WORK = (pathlib.Path(word).resolve() for word in sys.argv[1:5])
SCANS = int(sys.argv[5]) if len(sys.argv) > 5 else 100
MESH = PROGRAMS / "trocar-mesh"


def command(collection, store):
    return ["snakemake", "-s", str(SOURCE / "scripts/snakemake/Snakefile"), "--cores", "2", "--nolock", "--rerun-incomplete", "--config",
            f"collection={collection}", f"store={store}", f"program={MESH}", "scans_per_job=5"]


def expect_same(store, wanted, what):
    mine = content_of(store)
    different = [name for name in mine.keys() | wanted.keys() if mine.get(name) != wanted.get(name)]
    check(not different, f"{what}: not as batch makes it: {sorted(different)[:5]} ({len(different)} of {len(wanted)})")
    check(not strays(store), f"{what}: left behind: {strays(store)[:5]}")


def killed(collection, store):
    """Kills Snakemake and all that it has started, once some scans are made. Returns the number of those that are not."""
    process = subprocess.Popen(command(collection, store), cwd=WORK, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    end = time.monotonic() + 60
    while process.poll() is None and time.monotonic() < end and len(list((store / "scans").glob("*"))) < SCANS // 4:
        time.sleep(0.02)
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    process.wait()
    return SCANS - len(list((store / "scans").glob("*")))


def main():
    if shutil.which("snakemake") is None:
        print("skipped: Snakemake is not installed (scripts/setup farm)")
        return 77
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    collection, bad = make_collection(WORK / "collection's", SCAN, SCANS, 5)
    time.sleep(2.1)  # an input younger than that is read again
    run(MESH, "batch", collection, "-o", WORK / "batch", "--quiet", expect=3)
    wanted = content_of(WORK / "batch")

    done = run(*command(collection, WORK / "store"), cwd=WORK)
    check(f"0 of {SCANS} scans are stale, {len(bad)} are known failures" in done.stdout, f"summary: {done.stdout[-300:]}")
    expect_same(WORK / "store", wanted, "one run")
    before = {path: path.lstat().st_mtime_ns for path in (WORK / "store").rglob("*")}
    again = run(*command(collection, WORK / "store"), cwd=WORK)
    check(f"0 of {SCANS} scans are stale" in again.stdout and "rule scans" not in again.stderr, f"a second run: {again.stderr[-300:]}")
    check(before == {path: path.lstat().st_mtime_ns for path in (WORK / "store").rglob("*")}, "a second run wrote something")

    missing = killed(collection, WORK / "killed")
    check(0 < missing < SCANS, f"it was not killed in the middle: {missing} of {SCANS} scans are missing")
    run(*command(collection, WORK / "killed"), cwd=WORK)
    expect_same(WORK / "killed", wanted, "killed and run again")
    check(not made_again(WORK / "killed"), "finished keys were computed again")
    print(f"{SCANS} scans, {len(bad)} of them bad; killed with {missing} scans missing")
    return outcome()


if __name__ == "__main__":
    sys.exit(main())
