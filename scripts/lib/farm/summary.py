# SPDX-License-Identifier: Apache-2.0
"""The summary of a run of scripts/farm: throughput, the slowest scans, failures, and the farm's own cost."""
import dataclasses

import program

SLOWEST = 5
ROWS_MAX = 50


@dataclasses.dataclass
class Summary:
    """The states of the scans before and after a run put each scan into one class. The journal, which may lack lines of killed tasks, only
    says how long the work took."""
    before: program.State
    after: program.State
    unfinished: dict  # scan: reason, of the scans that no task has finished
    entries: list  # the journal's entries of this run
    seconds: float  # duration of the run
    slots: int
    rounds: list
    repairs: int
    resubmitted: int
    stopped_early: bool = False  # by --max-failures, or by an exception

    def classes(self):
        """The names of the scans in each class but `unchanged`, with the reasons of those that are not done."""
        done, failed, not_finished = [], {}, {}
        tried = {entry.scan: entry.reason for entry in self.entries if entry.outcome == "failed"}
        for name in self.before.stale:
            if name in self.after.known:
                failed[name] = self.after.known[name]
            elif name not in self.after.stale:
                done.append(name)
            elif name not in self.unfinished and self.after.stale[name]:
                failed[name] = self.after.stale[name]
            elif name in tried and self.stopped_early:  # it failed before the run ended, and the store may not have recorded it
                failed[name] = tried[name]
            else:
                not_finished[name] = self.unfinished.get(name, "became stale during the run")
        return done, failed, not_finished

    def numbers(self):
        done, failed, not_finished = self.classes()
        finished = [entry for entry in self.entries if entry.outcome != "failed"]
        work = sum(entry.seconds for entry in self.entries)
        slowest = sorted(finished, key=lambda entry: (-entry.seconds, entry.scan))[:SLOWEST]
        return {
            "scans": self.before.scans, "stale_at_start": len(self.before.stale),
            "unchanged": self.before.scans - len(self.before.stale) - len(self.before.known), "done": len(done),
            "failed": rows(failed), "known_failures": rows(self.before.known), "not_finished": rows(not_finished),
            "seconds": round(self.seconds, 3), "slots": self.slots, "work_s": round(work, 3),
            "scans_per_s": round(len(self.entries) / self.seconds, 3) if self.seconds else 0,
            "bytes": sum(entry.bytes for entry in finished), "asset_bytes": self.after.asset_bytes,
            "memory_bytes": max((entry.memory_bytes for entry in self.entries), default=0),
            "busy_share": round(work / (self.slots * self.seconds), 4) if self.slots else 0,
            "slowest": [{"scan": entry.scan, "seconds": entry.seconds} for entry in slowest],
            "rounds": self.rounds, "repairs": self.repairs, "resubmitted": self.resubmitted,
        }


def rows(reasons):
    return [{"scan": name, "reason": reasons[name]} for name in sorted(reasons)]


def text(numbers):
    known = len(numbers["known_failures"])
    lines = [f"{numbers['scans']} scan{'' if numbers['scans'] == 1 else 's'}: {numbers['unchanged']} unchanged, {numbers['done']} made, {len(numbers['failed'])} failed, "
             f"{known} known failure{'' if known == 1 else 's'}{' (trocar-mesh batch --dry-run lists them)' if known else ''}, "
             f"{len(numbers['not_finished'])} not finished"]
    if numbers["stale_at_start"]:
        lines.append(f"{numbers['seconds']:.1f} s on {numbers['slots']} slots, {numbers['scans_per_s']:.2f} scans/s, "
                     f"{numbers['bytes'] / 1e6:.1f} MB; slots busy {100 * numbers['busy_share']:.0f} % of the time")
    if numbers["memory_bytes"]:
        lines.append(f"memory of a scan: at most {numbers['memory_bytes'] / 1e6:.0f} MB")
    if numbers["resubmitted"] or numbers["repairs"]:
        lines.append(f"{numbers['resubmitted']} chunks submitted again, {numbers['repairs']} nodes and tasks repaired")
    if numbers["slowest"]:
        lines.append("slowest: " + ", ".join(f"{row['scan']} {row['seconds']:.1f} s" for row in numbers["slowest"]))
    for title in ("failed", "not_finished"):
        rows = numbers[title]
        for row in rows[:ROWS_MAX]:
            lines.append(f"{title.replace('_', ' '):13} {row['scan']}: {row['reason'] or 'see the store'}")
        if len(rows) > ROWS_MAX:
            lines.append(f"{title.replace('_', ' '):13} and {len(rows) - ROWS_MAX} more")
    return "\n".join(lines)
