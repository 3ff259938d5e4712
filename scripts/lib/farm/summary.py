# SPDX-License-Identifier: Apache-2.0
"""The summary of a run of scripts/farm: throughput, the slowest scans, failures, and the farm's own cost."""
import dataclasses

SLOWEST = 5
ROWS_MAX = 50


@dataclasses.dataclass
class Summary:
    scans: int
    stale_at_start: int
    entries: list  # the journal's entries of this run
    seconds: float  # duration of the run
    slots: int
    rounds: list
    repairs: int
    resubmitted: int
    not_finished: dict  # scan: reason

    def numbers(self):
        done = [entry for entry in self.entries if entry.outcome != "failed"]
        failed = {entry.scan: entry for entry in self.entries if entry.outcome == "failed"}
        for entry in done:
            failed.pop(entry.scan, None)
        work = sum(entry.seconds for entry in self.entries)
        slowest = sorted(done, key=lambda entry: (-entry.seconds, entry.scan))[:SLOWEST]
        return {
            "scans": self.scans, "stale_at_start": self.stale_at_start, "done": len({entry.scan for entry in done}),
            "failed": [{"scan": name, "reason": failed[name].reason} for name in sorted(failed)],
            "not_finished": [{"scan": name, "reason": reason} for name, reason in sorted(self.not_finished.items())],
            "seconds": round(self.seconds, 3), "slots": self.slots, "work_s": round(work, 3),
            "scans_per_s": round(len(self.entries) / self.seconds, 3) if self.seconds else 0,
            "bytes": sum(entry.bytes for entry in done),
            "busy_share": round(work / (self.slots * self.seconds), 4) if self.slots else 0,
            "slowest": [{"scan": entry.scan, "seconds": entry.seconds} for entry in slowest],
            "rounds": self.rounds, "repairs": self.repairs, "resubmitted": self.resubmitted,
        }


def text(numbers):
    lines = [f"{numbers['scans']} scans, {numbers['stale_at_start']} of them to be made: {numbers['done']} made, "
             f"{len(numbers['failed'])} failed, {len(numbers['not_finished'])} not finished"]
    if numbers["stale_at_start"]:
        lines.append(f"{numbers['seconds']:.1f} s on {numbers['slots']} slots, {numbers['scans_per_s']:.2f} scans/s, "
                     f"{numbers['bytes'] / 1e6:.1f} MB; slots busy {100 * numbers['busy_share']:.0f} % of the time")
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
