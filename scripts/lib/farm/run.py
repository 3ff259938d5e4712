# SPDX-License-Identifier: Apache-2.0
"""Brings a store up to date with its collection by rounds of job arrays.

A first round of small chunks measures how long scans take, if the journal does not say. After each round the scans that are
still stale are tried again in smaller chunks and with a longer time limit, so that one bad scan does not delay others."""
import contextlib
import math
import sys
import time

import chunks
import journal
import slurm
import summary
import watch
from errors import USAGE, WRITE, FarmError
from repair import Repair
from run_folder import RunFolder

TRIES = 3
MEASURING_SCANS = 3  # scans for each slot, if the journal is empty
SMALLER = 10  # factor by which chunks of a further try are smaller
JOURNAL_S = 3  # interval of reading it; it has a file for each task
LINE_S = 60  # interval of lines about the progress, if they do not go to a terminal
LAST_S = 10  # time for tasks that Slurm has started twice to end by themselves
STOP_S = 60  # time for the state of the store when a run is stopped
LIMIT_MIN_MINUTES = 5
LIMIT_TIMES = 10  # factor over the estimate of the longest chunk


def limit_minutes(chunk_s):
    """The time limit of a chunk. Slurm counts whole minutes."""
    return max(LIMIT_MIN_MINUTES, math.ceil(LIMIT_TIMES * chunk_s / 60))


class Progress:
    """Collects the journal's entries of this run, and shows how many scans have one, the rate and the time left: on a terminal in one
    line that changes, elsewhere in a line each minute."""

    def __init__(self, log, total, say):
        self.log, self.total, self.say, self.entries = log, total, say, []
        self.start = self.last_line = time.monotonic()
        self.last = 0.0
        self.shown = sys.stderr.isatty()

    def __call__(self):
        now = time.monotonic()
        if now - self.last < JOURNAL_S:
            return
        self.last = now
        self.collect()
        made, spent = len({entry.scan for entry in self.entries}), max(now - self.start, 1e-3)
        left = f", {spent / made * (self.total - made):.0f} s left" if made else ""
        line = f"{made} of {self.total} scans, {made / spent:.2f} scans/s{left}"
        if self.shown:
            print(f"\r  {line}   ", end="", file=sys.stderr)
        elif now - self.last_line >= LINE_S:
            self.last_line = now
            self.say(line)

    def until_now(self):
        """A sentence for a run that ends before all scans have an entry."""
        self.collect()
        last = {entry.scan: entry.outcome for entry in self.entries}
        failed = sum(outcome == "failed" for outcome in last.values())
        return f"{len(last) - failed} of {self.total} scans were made, {failed} failed"

    def collect(self):
        self.entries += self.log.new_entries()

    def end(self):
        if self.shown:
            print(file=sys.stderr)


class Run:
    """`own`: the context of a cluster that is started for this run and may be repaired; None: the cluster of SLURM_CONF."""

    def __init__(self, program, options, own, chunk_s, time_limit_minutes, say):
        self.program, self.options, self.own, self.chunk_s, self.time_limit_minutes = program, options, own, chunk_s, time_limit_minutes
        self.say = say
        self.repair = Repair(own is not None, options.partition, say)
        self.rounds = []
        self.slots = 0
        self.resubmitted = 0
        self.stopped_early = False
        self.unfinished = {}  # scan: reason, of scans that no task has finished
        self.start = time.monotonic()
        self.before = self.progress = None
        self.has_begun = False  # true: this run has the store for itself

    def all(self):
        """Runs all rounds and returns the numbers of summary.py. However the run ends, only the store remains of it."""
        if self.own is None:
            slurm.require()
        before = self.program.state(*self.options.batch)
        log = journal.Journal(self.program.store)
        known = log.new_entries()
        progress = Progress(log, len(before.stale), self.say)
        self.before, self.progress = before, progress
        if before.stale:
            with RunFolder(self.program.store) as folder:
                self.has_begun = True
                if folder.was_left and before.known:
                    self.say("an earlier run on this store was killed; the scans that failed in it count as known failures; trocar-mesh batch --dry-run lists them")
                with self.own or contextlib.nullcontext():
                    self.on_cluster(list(before.stale), folder, progress, known)
                if self.own and (self.repair.count or self.resubmitted):
                    self.program.tidy()
        return self.numbers(self.program.state() if before.stale else before)

    def numbers_at_stop(self):
        """The numbers of a run that all() has left by an exception; None if the run had not begun."""
        if not self.has_begun:
            return None
        self.progress.collect()
        self.stopped_early = True
        self.unfinished = {name: "not finished, because the run ended early" for name in self.before.stale}
        return self.numbers(self.program.state(within_s=STOP_S))

    def numbers(self, after):
        return summary.Summary(self.before, after, self.unfinished, self.progress.entries, time.monotonic() - self.start, self.slots,
                               self.rounds, self.repair.count, self.resubmitted, self.stopped_early).numbers()

    def on_cluster(self, stale, folder, progress, known):
        if earlier := watch.cancel_all(folder.prefix):
            self.say(f"{earlier} tasks of an earlier run on this store are cancelled")
        patience_s = 0
        try:
            largest = slurm.largest_node(self.options.partition)
            if 0 < largest < self.options.jobs:
                raise FarmError(USAGE, f"--jobs {self.options.jobs}: no node has more than {largest} processor{'s' if largest > 1 else ''}")
            self.slots = max(1, slurm.processors(self.options.partition) // self.options.jobs)
            if self.options.throttle:
                self.slots = min(self.slots, self.options.throttle)
            self.make(stale, folder, progress, known)
            patience_s = LAST_S
        except KeyboardInterrupt:
            self.say(progress.until_now())
            raise
        except slurm.NoAnswer as reason:
            raise slurm.not_there(reason) from None
        finally:
            watch.cancel_all(folder.prefix, patience_s)
            progress.end()

    def make(self, todo, folder, progress, known):
        tries = 0
        while todo and tries < TRIES:
            measuring = not known and not self.rounds and len(todo) > MEASURING_SCANS * self.slots
            estimates = journal.estimates(known + progress.entries, todo, self.chunk_s)
            if measuring:
                cut = [todo[k * len(todo) // self.slots:][:MEASURING_SCANS] for k in range(self.slots)]
            else:
                cut = chunks.cut(estimates, self.slots, self.options.jobs * self.chunk_s / SMALLER ** tries)
            longest = max(sum(estimates[name] for name in names) for names in cut)
            minutes = (self.time_limit_minutes or limit_minutes(longest)) * 2 ** tries
            one = watch.Round(self.program, folder, self.options, self.repair, self.say, len(self.rounds), cut, minutes)
            one.run_all(progress, lambda: self.has_enough_failures(progress))
            progress.collect()
            self.resubmitted += one.resubmitted
            self.rounds.append({"chunks": len(cut), "measuring": measuring, "estimated_s": round(sum(estimates.values()), 1),
                                "time_limit_min": minutes, "ended": ends(one.chunks)})
            # A task that was killed has said nothing; smaller chunks may help there.
            if len(self.rounds) == 1 and not progress.entries and all(chunk.said for chunk in one.chunks.values()):
                raise FarmError(WRITE, f"no task of the first round has done anything: {next(iter(one.chunks.values())).end}")
            if self.has_enough_failures(progress):
                self.stopped_early = True
                self.unfinished = {name: f"not tried, because of --max-failures {self.options.max_failures}" for name in todo}
                return
            # A scan that was refused is a known failure now.
            todo = list(self.program.state().stale)
            self.unfinished = {name: chunk.end for chunk in one.chunks.values() if chunk.end != watch.DONE for name in chunk.names}
            tries += 0 if measuring else 1

    def has_enough_failures(self, progress):
        limit = self.options.max_failures
        return limit and len({entry.scan for entry in progress.entries if entry.outcome == "failed"}) >= limit


def ends(chunks_by_number):
    out = {}
    for chunk in chunks_by_number.values():
        out[chunk.end] = out.get(chunk.end, 0) + 1
    return out
