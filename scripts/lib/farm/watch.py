# SPDX-License-Identifier: Apache-2.0
"""Runs the chunks of one round as Slurm job arrays until each has a result or is given up.

Completion is determined from the result in the run's folder, never from Slurm's count of tasks, because a killed slurmctld forgets its
last seconds: both acknowledged submissions and ended tasks. A chunk that neither waits nor runs and has no result is submitted again.
The name of an array gives its chunks, so that an array is recognised even if its acknowledgement was lost."""
import dataclasses
import re
import tempfile
import time

import chunk_script
import chunks
import slurm
from errors import USAGE, WRITE, FarmError

ATTEMPTS = 4  # tries of a chunk whose task ends without a result, in one round
GRACE_POLLS = 3  # a result may become visible after the end of its task
SUBMIT_FAILURES = 5
# Reasons that do not go away by waiting.
NEVER = re.compile(r"invalid partition|invalid account|invalid qos|configuration is not available|unrecognized option|invalid option", re.I)
DONE, TIMEOUT = "done", "time limit"


@dataclasses.dataclass
class Options:
    partition: str
    throttle: int
    jobs: int
    poll_s: float
    patience_s: float
    sbatch: list
    batch: list  # further options of trocar-mesh batch, of its dry run too
    max_failures: int = 0  # new failures, after which a task starts no further scan; 0: no limit

    def of_a_task(self):
        """The options of the `trocar-mesh batch` that a task runs."""
        return [*self.batch, *(["--max-failures", str(self.max_failures)] if self.max_failures else [])]


@dataclasses.dataclass
class Chunk:
    names: list
    attempts: int = 0
    missing: int = 0  # polls in a row in which it neither waited nor ran
    end: str = ""  # DONE, TIMEOUT, or the reason for giving up
    said: str = ""  # what the program said last, if the chunk was given up


class Round:
    """`cut`: the names of each chunk. `minutes`: the time limit of a task."""

    def __init__(self, program, run, options, repair, say, number, cut, minutes):
        self.program, self.run, self.options, self.repair, self.say = program, run, options, repair, say
        self.number, self.minutes = number, minutes
        self.job_name = f"{run.own_prefix}{number}-"
        self.chunks = {k: Chunk(names) for k, names in enumerate(cut, 1)}
        self.waiting = list(self.chunks)
        self.limits = None
        self.submit_failures = 0
        self.resubmitted = 0
        run.write_chunks(number, cut)

    def run_all(self, show, is_enough):
        """`show` is called after each poll, and the round ends if `is_enough` returns true. Fails (4) if the cluster did not answer, or took no tasks, for `patience_s`."""
        stuck_since, silent = None, False
        while True:
            try:
                can_run, reason = self.poll(), "no node takes tasks"
                if silent:
                    self.say("slurmctld answers again")
                silent = False
            except slurm.NoAnswer as why:
                can_run, reason = False, f"slurmctld does not answer ({why})"
                if not silent:
                    self.say(f"{reason}; waiting for it")
                silent = True
            show()
            if all(chunk.end for chunk in self.chunks.values()) or is_enough():
                return
            now = time.monotonic()
            stuck_since = None if can_run else (stuck_since or now)
            if stuck_since and now - stuck_since > self.options.patience_s:
                raise FarmError(WRITE, f"{reason} for {self.options.patience_s:.0f} s; give the same command again when this is mended")
            time.sleep(self.options.poll_s)

    def poll(self):
        """Returns whether tasks run or can run. Raises NoAnswer if slurmctld does not answer."""
        self.take_results()
        tasks = slurm.tasks(self.job_name)
        has_nodes = self.repair.nodes()
        lost = self.repair.tasks([task for task in tasks if not self.chunks[self.chunk_of(task)].end])
        active = [task for task in tasks if task.state in slurm.ACTIVE and task not in lost]
        self.repair.ended_unnoticed([task for task in active if task.state == "RUNNING" and self.chunks[self.chunk_of(task)].end == DONE])
        self.find_lost({self.chunk_of(task) for task in active}, {self.chunk_of(task): task.state for task in tasks})
        self.submit(active)
        return has_nodes or any(task.state == "RUNNING" for task in active)

    def chunk_of(self, task):
        return int(task.name.rpartition("-")[2]) + task.index

    def take_results(self):
        missing = {number for number, chunk in self.chunks.items() if chunk.end != DONE}
        for number, code in self.run.results(self.number, missing).items():
            if code == USAGE:
                raise FarmError(USAGE, self.run.last_line(self.number, number).removeprefix("trocar-mesh: ") or "wrong usage of the program")
            self.chunks[number].end = DONE

    def find_lost(self, active, states):
        waiting = set(self.waiting)
        for number, chunk in self.chunks.items():
            if chunk.end or number in waiting:
                continue
            chunk.missing = 0 if number in active else chunk.missing + 1
            if chunk.missing == 0:
                continue
            if states.get(number) == "TIMEOUT":
                chunk.end = TIMEOUT
            elif chunk.missing > GRACE_POLLS:
                chunk.missing = 0
                if chunk.attempts >= ATTEMPTS:
                    chunk.said = self.run.last_line(self.number, number).removeprefix("trocar-mesh: ")
                    chunk.end = f"its task ended {chunk.attempts} times without a result: {chunk.said or states.get(number, 'unknown to Slurm')}"
                else:
                    self.resubmitted += 1
                    self.waiting.append(number)
        self.waiting.sort()

    def submit(self, active):
        if not self.waiting or (self.options.throttle and active):
            return
        if self.limits is None:
            self.limits = slurm.limits()
        # Half of the cluster's jobs are left to others.
        room = self.limits["MaxJobCount"] // 2 - len(active)
        throttle = f"%{self.options.throttle}" if self.options.throttle else ""
        for offset, indices in chunks.arrays(self.waiting, self.limits["MaxArraySize"], room):
            script = chunk_script.text(self.program.command(*self.options.of_a_task()), self.run.path, self.number, offset, self.options.jobs)
            try:
                slurm.submit(script, f"--job-name={self.job_name}{offset}", f"--array={chunks.index_text(indices)}{throttle}",
                             f"--time={self.minutes}", f"--cpus-per-task={self.options.jobs}", "--nodes=1", "--ntasks=1", "--requeue",
                             "--output=/dev/null", *self.options.sbatch)
            except slurm.NoAnswer as reason:
                self.submit_failures += 1
                if not active and (self.submit_failures >= SUBMIT_FAILURES or NEVER.search(str(reason))):
                    raise refused(str(reason), self.options.partition) from None
                return
            self.submit_failures = 0
            for index in indices:
                self.chunks[offset + index].attempts += 1
            sent = {offset + index for index in indices}
            self.waiting = [number for number in self.waiting if number not in sent]
            if self.options.throttle:
                return


def refused(reason, partition):
    """The error of a run whose tasks Slurm does not take."""
    if "artition" in reason:
        return FarmError(USAGE, f"--partition {partition or '(none given)'}: Slurm says: {reason}; sinfo lists the partitions")
    if "writing" in reason:
        return FarmError(WRITE, f"Slurm cannot write its files: {reason}; is the disk full? (with --local-cluster they are in {tempfile.gettempdir()})")
    return FarmError(USAGE, f"sbatch refuses the tasks: {reason}")


def cancel_all(prefix, patience_s=0):
    """Cancels the tasks of this or an earlier run on the store and returns their number. Running tasks have `patience_s` to end by themselves."""
    end = time.monotonic() + patience_s
    try:
        active = [task for task in slurm.tasks(prefix) if task.state in slurm.ACTIVE]
        for job in sorted({task.job for task in active}):
            slurm.ask("scancel", "--state=PENDING", job)
        running = [task for task in active if task.state == "RUNNING"]
        while running and time.monotonic() < end:
            time.sleep(0.3)
            running = [task for task in slurm.tasks(prefix) if task.state == "RUNNING"]
        for job in sorted({task.job for task in active if task.is_held or running}):
            slurm.ask("scancel", job)
        return len(active)
    except slurm.NoAnswer:
        return 0
