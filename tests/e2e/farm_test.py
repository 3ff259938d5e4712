# SPDX-License-Identifier: Apache-2.0
"""farm_test.py SOURCE PROGRAMS SCAN WORK [--scans N] [--kills N] [--seed N] [PART...]: a store that a Slurm cluster of three nodes makes is that of one machine, byte
by byte, however often tasks, slurmctld and slurmd are killed meanwhile. The parts: array (scripts/slurm/array.sh), snakemake (scripts/snakemake and
its profile), gives_up (array.sh names a scan that fails in each round). Each of the first two parts gets N kills. Skipped without Slurm (scripts/setup farm)."""
import argparse
import contextlib
import os
import pathlib
import random
import re
import shutil
import signal
import subprocess
import sys
import time

from batch_collection import collection_of_samples, difference, made_again, snapshot, strays
from e2e import check
from local_slurm import LocalSlurm, is_installed
from programs import run

NODES = 3
KINDS = ("task", "slurmctld", "slurmd")
KILLS_A_RUN = 5  # each can cost one of the five repetitions
RUN_MAX_S = 500
NO_ADDRESSES = ("getaddrinfo", "Address family not supported")  # a machine with no network but lo


def command_of(part, collection, store):
    if part == "snakemake":
        return ["snakemake", "-s", GIVEN.source / "scripts/snakemake/Snakefile", "--profile", GIVEN.source / "scripts/snakemake/slurm", "--config",
                f"collection={collection}", f"store={store}", f"program={MESH}", "scans_per_job=10"]
    return [GIVEN.source / "scripts/slurm/array.sh", collection, store, 8]


class Runs:
    """The runs of one part, and the kills that are left for them."""

    def __init__(self, cluster, part, collection, broken):
        self.cluster, self.part, self.collection, self.broken = cluster, part, collection, broken
        self.environment = {**cluster.environment, "TROCAR_MESH": str(MESH), "PAUSE_S": "1"}
        self.random, self.killed = random.Random(f"{GIVEN.seed} {part}"), 0

    def start(self, store, kills):
        """Returns exit code and output of a run with at most so many kills."""
        log, end = WORK / f"{store.name}.out", time.monotonic() + RUN_MAX_S
        with open(log, "w", encoding="utf-8") as out:
            process = subprocess.Popen([str(word) for word in command_of(self.part, self.collection, store)], cwd=WORK, env=self.environment,
                                       stdout=out, stderr=subprocess.STDOUT, start_new_session=True)
            while process.poll() is None:
                time.sleep(self.random.uniform(0.05, 0.4))
                victims = self.cluster.victims(KINDS[self.killed % len(KINDS)]) if kills > 0 and (store / "journal").exists() else []
                if victims and self.cluster.victims("task"):
                    with contextlib.suppress(ProcessLookupError):
                        # The youngest process of a task makes a scan: its batch goes on, and records that it was killed.
                        os.kill(max(victims) if self.killed == 0 else self.random.choice(sorted(victims)), signal.SIGKILL)
                        self.killed, kills = self.killed + 1, kills - 1
                if time.monotonic() > end:
                    os.killpg(process.pid, signal.SIGKILL)
                    check(False, f"{store.name}: not done after {RUN_MAX_S} s")
        return process.wait(), log.read_text(errors="replace")

    def check_store(self, store, wanted):
        different = difference(snapshot(store), wanted)
        check(not different, f"{store.name}: not as that of one machine: {different}")
        check(not strays(store), f"{store.name}: left behind: {strays(store)[:5]}")
        check(not made_again(store), f"{store.name}: finished keys were computed again: {made_again(store)[:3]}")


def same(cluster, part, collection, broken, wanted):
    runs, number = Runs(cluster, part, collection, broken), 0
    while runs.killed < GIVEN.kills:
        number += 1
        began, store, before = time.monotonic(), WORK / f"{part}{number}", runs.killed
        code, said = runs.start(store, min(KILLS_A_RUN, GIVEN.kills - runs.killed))
        # New failures are exit code 3 of array.sh. Snakemake's jobs are done with them.
        check(code == (3 if part == "array" else 0), f"{store.name}: ended with {code}: {said[-2000:]}")
        check(all(f"{name}: known failure: " in said for name in broken), f"{store.name}: does not name what failed: {said[-1000:]}")
        run(MESH, "batch", collection, "-o", store, "--only", "-", "--quiet", input="")  # removes what killed processes have left
        runs.check_store(store, wanted)
        print(f"{store.name}: {runs.killed - before} kills, {said.count('round ') or said.count('Trying to restart')} rounds or repeated jobs, "
              f"{time.monotonic() - began:.0f} s", flush=True)
        if runs.killed == before:
            check(False, f"{store.name}: too fast to be killed")
            break
    before = snapshot(store)
    code, said = runs.start(store, 0)
    check(code == 0 and snapshot(store) == before and "round " not in said and "rule scans" not in said, f"{part}: a second run ended with {code}: {said[-500:]}")


def gives_up(cluster, folder):
    """A scan that was done and has no input now fails in each round."""
    scan, collection, store = folder / "gone.nii.gz", folder / "gone.json", WORK / "gives_up"
    shutil.copy(GIVEN.scan / "sample.nii.gz", scan)
    collection.write_text('{"schema": "trocar.collection/1", "scans": [{"name": "gone", "input": "gone.nii.gz", "parameters": {"slices": "5:6"}}]}')
    runs = Runs(cluster, "array", collection, [])
    code, said = runs.start(store, 0)
    check(code == 0 and said.count("round ") == 1, f"gives_up: first run: {code} {said}")
    scan.unlink()
    code, said = runs.start(store, 0)
    check(code == 3 and re.findall(r"^round (\d)", said, re.M) == list("123456"), f"gives_up: {code} {said}")
    check("\ngone: it failed: gone.nii.gz: " in said, f"gives_up: does not name the scan: {said}")


def main():
    if not is_installed() or shutil.which("snakemake") is None:
        print("skipped: Slurm or Snakemake is not installed (scripts/setup farm)")
        return 77
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    collection, broken = collection_of_samples(WORK / "collection's", GIVEN.scan.resolve(), GIVEN.scans, max(3, GIVEN.scans // 20))
    time.sleep(3)  # an input younger than its index entry by less than 2 s is read again
    run(MESH, "batch", collection, "-o", WORK / "one machine", "--quiet", expect=3)
    wanted = snapshot(WORK / "one machine")
    try:
        with LocalSlurm(NODES) as cluster:
            for part in GIVEN.parts or ("gives_up", "array", "snakemake"):
                began = time.monotonic()
                if part == "gives_up":
                    gives_up(cluster, collection.parent)
                else:
                    same(cluster, part, collection, broken, wanted)
                print(f"{part}: {time.monotonic() - began:.0f} s", flush=True)
    except RuntimeError as reason:
        if not any(sign in str(reason) for sign in NO_ADDRESSES):
            raise
        print(f"skipped: Slurm finds no addresses here: {reason}")
        return 77
    return 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for name in ("source", "programs", "scan", "work"):
        parser.add_argument(name, type=pathlib.Path)
    parser.add_argument("--scans", type=int, default=24)
    parser.add_argument("--kills", type=int, default=3, help="for each of the parts array and snakemake")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("parts", nargs="*")
    GIVEN = parser.parse_args()
    GIVEN.source, WORK, MESH = GIVEN.source.resolve(), GIVEN.work.resolve(), GIVEN.programs.resolve() / "trocar-mesh"
    sys.exit(main())
