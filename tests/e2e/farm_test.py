# SPDX-License-Identifier: Apache-2.0
"""farm_test.py SOURCE PROGRAMS SCAN WORK [--scans N] [--bad N] [--kills N] [--seed N] [PART...]: scripts/farm on a real slurmctld with three slurmd,
which it starts itself. Skipped without Slurm (scripts/setup farm).

The parts: same (the store of a local run, byte by byte; a second run does nothing), kills (kill -9 of daemons, workers and tasks at
random moments), foreign (a cluster that is not its own is not repaired), stops (interrupted or killed, it leaves no process), wrong; and only if it is named: plan (the time that --plan predicts for clusters
of 1, 3 and 6 nodes here, beside the measured one)."""
import argparse
import json
import os
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import time

from e2e import check, outcome, run
from farm_collection import content_of, made_again, make_collection, strays

PARTS = ("wrong", "same", "stops", "foreign", "kills")
NODES = 3
RECOVERY_MAX_S = 60  # from a kill to the next task that starts, or to the end of the run
RUN_MAX_S = 300
KINDS = ("slurmctld", "slurmd", "slurmstepd", "task", "worker")


def processes():
    """pid: (parent, command line), of all that run."""
    out = {}
    for folder in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            state, parent = (folder / "stat").read_text().rpartition(")")[2].split()[:2]
            command = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if state != "Z":
            out[int(folder.name)] = (int(parent), command)
    return out


def below(root):
    """Processes that `root` started, and those that these started."""
    known = processes()
    found, todo = {}, [root]
    while todo:
        parent = todo.pop()
        for pid, (its_parent, command) in known.items():
            if its_parent == parent:
                found[pid] = command
                todo.append(pid)
    return found


def kind_of(command):
    if command.startswith("slurmctld"):
        return "slurmctld"
    if command.startswith("slurmd "):
        return "slurmd"
    if command.startswith("slurmstepd: ["):
        return "slurmstepd"
    if "slurm_script" in command:
        return "task"
    return "worker" if "trocar-mesh batch" in command and "--only" in command else ""


def tasks_of(found):
    return {pid for pid, command in found.items() if kind_of(command) == "task"}


class Farm:
    """scripts/farm in the background; whatever happens, nothing of it is left at the end of the `with`."""

    def __init__(self, *options, environment=None):
        self.seen = {}
        self.process = subprocess.Popen([str(word) for word in (FARM, *options)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                        env=environment)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(30)
            except subprocess.TimeoutExpired:
                for pid in below(self.process.pid):
                    os.kill(pid, signal.SIGKILL)
                self.process.kill()
        self.process.stdout.close()
        self.process.stderr.close()

    def below(self):
        found = below(self.process.pid)
        self.seen.update({pid: command for pid, command in found.items() if command})
        return found

    def left(self, wait_s=10):
        """Processes that it started and that still run."""
        end = time.monotonic() + wait_s
        while True:
            known = processes()
            found = {pid: command for pid, command in self.seen.items() if known.get(pid, (0, ""))[1] == command}
            if not found or time.monotonic() > end:
                return found
            time.sleep(0.1)

    def result(self):
        out, errors = self.process.communicate(timeout=RUN_MAX_S)
        return self.process.returncode, out, errors


def farm(store, *options, expect=3, nodes=NODES):
    """The summary of a finished run on a cluster of its own."""
    done = run(FARM, COLLECTION, "-o", store, "--local-cluster", nodes, "--program", MESH, "--json", *options, expect=expect, timeout=RUN_MAX_S)
    numbers = json.loads(done.stdout)
    check_classes(numbers, f"farm {store.name}")
    return numbers


def check_classes(numbers, what):
    of_classes = [numbers["unchanged"], numbers["done"], *(len(numbers[name]) for name in ("failed", "known_failures", "not_finished"))]
    check(sum(of_classes) == numbers["scans"], f"{what}: {of_classes} of {numbers['scans']} scans")


def check_known(store, what):
    """A second run knows all failures, tries none of them again, and ends well."""
    again = farm(store, expect=0)
    check(sorted(row["scan"] for row in again["known_failures"]) == BROKEN, f"{what}: known failures {again['known_failures'][:3]}")
    check(again["unchanged"] == SCANS - len(BROKEN) and not again["stale_at_start"], f"{what}: a second run found {again['stale_at_start']} stale")
    return again


def check_same(store, what):
    mine, wanted = content_of(store), content_of(LOCAL)
    different = [name for name in mine.keys() | wanted.keys() if mine.get(name) != wanted.get(name)]
    check(not different, f"{what}: not as the local run's: {sorted(different)[:5]} ({len(different)} of {len(wanted)})")
    check(not strays(store), f"{what}: left behind: {strays(store)[:5]}")


def same():
    store = WORK / "same"
    first = farm(store, "--chunk", 1, expect=3)
    check(sorted(row["scan"] for row in first["failed"]) == BROKEN, f"same: failed: {first['failed']}")
    check(first["done"] == SCANS - len(BROKEN) and not first["not_finished"], f"same: done {first['done']}, not finished {first['not_finished'][:3]}")
    check(all(row["reason"] for row in first["failed"]), "same: a failure has no reason")
    check(any(one["measuring"] for one in first["rounds"]), "same: the first run did not measure")
    check(sum(one["chunks"] for one in first["rounds"]) > 2 * NODES, f"same: only the chunks {first['rounds']}")
    check_same(store, "same")
    before = content_of(store)
    check_known(store, "same")
    said = run(FARM, COLLECTION, "-o", store, "--local-cluster", NODES, "--program", MESH, "--strict", expect=3).stdout
    check(f"{len(BROKEN)} known failures" in said, f"same: --strict says {said}")
    retried = farm(store, "--retry", "--metrics", WORK / "farm.prom")
    check(sorted(row["scan"] for row in retried["failed"]) == BROKEN and not retried["done"], f"same: --retry: {retried['failed']}")
    check(f'trocar_batch_scans{{store="{store}",class="failed"}} {len(BROKEN)}' in (WORK / "farm.prom").read_text(), "same: --metrics")
    check(content_of(store) == before, "same: a second run changed the store")
    few = farm(WORK / "few", "--max-failures", 1, "--chunk", 1)
    check(0 < len(few["failed"]) < len(BROKEN) and few["not_finished"], f"same: --max-failures: {len(few['failed'])} failed")
    check(all("--max-failures" in row["reason"] for row in few["not_finished"]), f"same: --max-failures: {few['not_finished'][:2]}")
    check(not made_again(store), "same: a finished key was computed again")


def kills():
    numbers = random.Random(GIVEN.seed)
    spent, killed, run_number, slowest = {kind: [] for kind in KINDS}, 0, 0, 0.0
    while killed < GIVEN.kills:
        run_number += 1
        store = WORK / "kills"
        shutil.rmtree(store, ignore_errors=True)
        with Farm(COLLECTION, "-o", store, "--local-cluster", NODES, "--program", MESH, "--chunk", 2, "--json") as one:
            while one.process.poll() is None:
                time.sleep(numbers.uniform(0.05, 1.5))
                found = one.below()
                kind = KINDS[killed % len(KINDS)]
                victims = sorted(pid for pid, command in found.items() if kind_of(command) == kind)
                if killed >= GIVEN.kills or not victims or not (store / "journal").exists():
                    continue
                try:
                    os.kill(numbers.choice(victims), signal.SIGKILL)
                except ProcessLookupError:
                    continue
                killed += 1
                start, before = time.monotonic(), tasks_of(found)
                while one.process.poll() is None and not tasks_of(one.below()) - before and time.monotonic() - start < 2 * RECOVERY_MAX_S:
                    time.sleep(0.05)
                spent[kind].append(time.monotonic() - start)
            code, out, errors = one.result()
            check(code == 3, f"kills, run {run_number}: ended with {code}: {errors[-300:]}")
            check(not one.left(), f"kills, run {run_number}: still running: {list(one.left(0).items())[:3]}")
        numbers_of = json.loads(out) if out.startswith("{") else {"not_finished": [out]}
        check(not numbers_of["not_finished"], f"kills, run {run_number}: not finished: {numbers_of['not_finished'][:3]}")
        if code == 4 or numbers_of["not_finished"]:
            farm(store, expect=None)  # a rerun finishes
        else:
            check_classes(numbers_of, f"kills, run {run_number}")
            failed = sorted(row["scan"] for row in numbers_of["failed"])
            check(failed == BROKEN and numbers_of["done"] == SCANS - len(BROKEN), f"kills, run {run_number}: {numbers_of['done']} done, failed {failed[:5]}")
        check_same(store, f"kills, run {run_number}")
        check_known(store, f"kills, run {run_number}")
        check(not made_again(store), f"kills, run {run_number}: finished keys were computed again: {made_again(store)[:3]}")
        print(f"run {run_number}: {killed} kills so far, {numbers_of.get('seconds')} s, {numbers_of.get('resubmitted')} chunks submitted again, "
              f"{numbers_of.get('repairs')} repairs", flush=True)
    for kind, times in spent.items():
        slowest = max([slowest, *times])
        if times:
            print(f"kill -9 of {kind}: {len(times)}, until the next task {sum(times) / len(times):.1f} s in the mean, {max(times):.1f} s at most")
    check(slowest <= RECOVERY_MAX_S, f"kills: a recovery took {slowest:.0f} s")


def wait_for(what, condition, most_s=60):
    end = time.monotonic() + most_s
    while not condition():
        if time.monotonic() > end:
            check(False, f"{what}: not within {most_s} s")
            return False
        time.sleep(0.1)
    return True


def stops():
    for sign in (signal.SIGINT, signal.SIGKILL):
        store = WORK / f"stops{sign}"
        with Farm(COLLECTION, "-o", store, "--local-cluster", NODES, "--program", MESH, "--metrics", WORK / f"stops{sign}.prom") as one:
            wait_for("stops: tasks run", lambda one=one: any(kind_of(command) == "worker" for command in one.below().values()))
            cluster = next(command.split()[-2] for command in one.below().values() if "keeper.py" in command)
            os.kill(one.process.pid, sign)
            code, _, errors = one.result()
            check(code == (4 if sign != signal.SIGKILL else -9), f"stops: after signal {sign} it ended with {code}: {errors}")
            check(sign == signal.SIGKILL or f" of {SCANS} scans were made, " in errors, f"stops: it does not say how far it came: {errors}")
            left = f'trocar_batch_scans{{store="{store}",class="left"}} '
            check(sign == signal.SIGKILL or left in (WORK / f"stops{sign}.prom").read_text(), "stops: --metrics")
            check(not one.left(), f"stops: after signal {sign} still running: {one.left(0)}")
            check(wait_for(f"stops: {cluster} removed", lambda cluster=cluster: not os.path.exists(cluster), 10), "stops: the cluster's folder stays")
        if sign == signal.SIGKILL:
            farm(store, expect=None)
            check_same(store, "stops: rerun")


def foreign():
    """On a cluster that is not its own it names drained nodes and what to do, repairs nothing, and still finishes."""
    store = WORK / "foreign"
    with Farm("--local-cluster", NODES) as cluster:
        line = cluster.process.stdout.readline()
        cluster.below()
        environment = {**os.environ, "SLURM_CONF": line.strip().partition("=")[2], "PATH": os.environ["PATH"] + ":/usr/sbin"}
        run("scontrol", "update", "nodename=n2", "state=drain", "reason=Duplicate jobid", env=environment)
        done = run(FARM, COLLECTION, "-o", store, "--program", MESH, "--chunk", 5, expect=3, env=environment, timeout=RUN_MAX_S)
        check("node n2 is drain" in done.stderr and "Duplicate jobid" in done.stderr and "state=resume" in done.stderr,
              f"foreign: does not name the drained node: {done.stderr}")
        check(done.stderr.count("node n2") == 1, f"foreign: named more than once: {done.stderr}")
        check("drain" in run("sinfo", "-h", "-n", "n2", "-o", "%T", env=environment).stdout, "foreign: the node was returned")
        check(not run("squeue", "-h", env=environment).stdout, "foreign: tasks are left")
        run("scontrol", "update", "nodename=n[1-3]", "state=drain", "reason=test", env=environment)
        (WORK / "none").mkdir(exist_ok=True)
        none = run(FARM, COLLECTION, "-o", WORK / "none" / "store", "--program", MESH, "--patience", 2, expect=4, env=environment, timeout=RUN_MAX_S)
        check("no node takes tasks" in none.stderr and none.stderr.count("is drained") == 3, f"foreign: without a node: {none.stderr}")
        cluster.process.send_signal(signal.SIGINT)
        code, _, errors = cluster.result()
        check(code == 0 and not cluster.left(), f"foreign: the cluster ended with {code}, {errors}, left {cluster.left(0)}")
    check_same(store, "foreign")


def plans():
    for nodes in (1, 3, 6):
        planned = json.loads(run(FARM, "--plan", COLLECTION, "--local-cluster", nodes, "--program", MESH, "--json", timeout=RUN_MAX_S).stdout)["plans"][0]
        measured = farm(WORK / f"plan{nodes}", nodes=nodes)
        ratio = measured["seconds"] / planned["seconds"]
        print(f"plan: {SCANS} scans on {nodes} nodes: planned {planned['seconds']:.1f} s, measured {measured['seconds']:.1f} s, ratio {ratio:.2f}; "
              f"at most {planned['useful_slots']} slots are of use, because of {planned['limits'][0]['what']}", flush=True)
        check(1 / 1.5 <= ratio <= 1.5, f"plan: on {nodes} nodes the run took {ratio:.2f} of the planned time")


def wrong():
    for words, said in ((["x.json"], "-o STORE"), (["--local-cluster", "0"], "1 to"), (["--plan", "x.json"], "--nodes"), ([], "COLLECTION.json"),
                        ([WORK / "no.json", "-o", WORK / "no", "--program", MESH], "no.json"), (["x.json", "-o", "y", "--program", "/no/where"], "/no/where")):
        done = run(FARM, *words, expect=2)
        check(said in done.stderr and len(done.stderr.strip().splitlines()) == 1, f"wrong: {words}: {done.stderr}")


def main():
    if shutil.which("slurmctld", path=os.environ.get("PATH", "") + ":/usr/sbin") is None:
        print("skipped: Slurm is not installed (scripts/setup farm)")
        return 77
    with Farm("--local-cluster", 1) as one:
        if not one.process.stdout.readline() and "give lo a second address" in (said := one.process.stderr.read()):
            print(f"skipped: Slurm finds no addresses here: {said}")
            return 77
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    global COLLECTION, BROKEN  # pylint: disable=global-statement
    COLLECTION, BROKEN = make_collection(WORK / "collection", GIVEN.scan.resolve(), SCANS, GIVEN.bad or max(3, SCANS // 20))
    time.sleep(3)  # an input younger than its index entry by less than 2 s is read again
    run(MESH, "batch", COLLECTION, "-o", LOCAL, "--quiet", expect=3)
    for part in GIVEN.parts or PARTS:
        start = time.monotonic()
        {"wrong": wrong, "same": same, "stops": stops, "foreign": foreign, "kills": kills, "plan": plans}[part]()
        print(f"{part}: {time.monotonic() - start:.1f} s", flush=True)
    return outcome()


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for name in ("source", "programs", "scan", "work"):
        parser.add_argument(name, type=pathlib.Path)
    parser.add_argument("--scans", type=int, default=80)
    parser.add_argument("--bad", type=int, help="number of scans that cannot be meshed")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("parts", nargs="*", choices=[*PARTS, "plan", []])
    GIVEN = parser.parse_args()
    WORK, MESH, SCANS = GIVEN.work.resolve(), GIVEN.programs.resolve() / "trocar-mesh", GIVEN.scans
    FARM, LOCAL = GIVEN.source.resolve() / "scripts" / "farm", WORK / "local"
    COLLECTION, BROKEN = None, []
    sys.exit(main())
