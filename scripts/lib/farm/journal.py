# SPDX-License-Identifier: Apache-2.0
"""A store's journal: one NDJSON file for each process that wrote to it. It serves people and estimates; the store itself shows what is
finished. Lines that cannot be read are skipped, because a killed process may have ended within one."""
import dataclasses
import json
import pathlib

LINE_MAX = 1 << 16


@dataclasses.dataclass(frozen=True)
class Entry:
    scan: str
    outcome: str  # "made", "found" (computed before), "failed"
    seconds: float
    bytes: int
    input_bytes: int
    memory_bytes: int
    reason: str


def entry_of(line):
    """The entry in a line, or None if the line is not a scan's."""
    try:
        row = json.loads(line)
        scan, outcome, seconds = row["scan"], row["outcome"], float(row["seconds"])
    except (ValueError, KeyError, TypeError):
        return None
    if not isinstance(scan, str) or outcome not in ("made", "found", "failed") or not 0 <= seconds < 1e7:
        return None

    def number(name):
        value = row.get(name)
        return value if isinstance(value, int) and not isinstance(value, bool) and value >= 0 else 0

    return Entry(scan, outcome, seconds, number("bytes"), number("input_bytes"), number("memory_bytes"), str(row.get("reason") or ""))


class Journal:
    """Reads incrementally: new_entries() returns the entries written since its last call."""

    def __init__(self, store):
        self.folder = pathlib.Path(store) / "journal"
        self.read = {}  # file: offset of the first line not read

    def new_entries(self):
        out = []
        for file in sorted(self.folder.glob("*.ndjson")):
            try:
                at = self.read.get(file.name, 0)
                if file.stat().st_size == at:
                    continue
                with open(file, "rb") as stream:
                    stream.seek(at)
                    for line in stream:
                        if not line.endswith(b"\n"):
                            break
                        at += len(line)
                        entry = entry_of(line) if len(line) <= LINE_MAX else None
                        if entry:
                            out.append(entry)
                self.read[file.name] = at
            except OSError:
                continue  # the file is gone, or not visible yet
        return out


def full_work(entries):
    """For each scan, the entry that tells best how long all of its work takes: the longest in which it was made, because a later one may
    have made a product only, or may have failed because the input was out of reach. For a scan that was never made, the last failure."""
    out = {}
    for entry in entries:
        best = out.get(entry.scan)
        if entry.outcome == "found" or (best and best.outcome == "made" and (entry.outcome == "failed" or entry.seconds < best.seconds)):
            continue
        out[entry.scan] = entry
    return out


def estimates(entries, names, guess_s):
    """Estimated seconds of each named scan: those of full_work(), or the mean of all scans."""
    work = full_work(entries)
    mean = sum(entry.seconds for entry in work.values()) / len(work) if work else guess_s
    return {name: work[name].seconds if name in work else mean for name in names}
