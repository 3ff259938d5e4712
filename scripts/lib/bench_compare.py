# SPDX-License-Identifier: Apache-2.0
"""bench_compare.py RUN: medians, errors and ratios to our time, a table for each stage.
bench_compare.py OLD NEW: what has changed, times by more than their scatter.

A run is a JSON file of Google Benchmark or a folder of them. Names are STAGE/CASE/METHOD[/SETTING]; a method
peer-NAME is not ours (tests/bench/README.md)."""
import dataclasses
import json
import math
import pathlib
import re
import statistics
import sys

TO_US = {"ns": 1e-3, "us": 1, "ms": 1e3, "s": 1e6}
OPTIONS = re.compile(r"/(manual_time|real_time|process_time|(iterations|repeats|min_time|min_warmup_time):[^/]+)")
FIXED = {"name", "run_name", "run_type", "repetitions", "repetition_index", "threads", "iterations", "real_time", "cpu_time", "time_unit",
         "family_index", "per_family_instance_index", "label"}


@dataclasses.dataclass
class Row:
    name: str
    times_us: list
    counters: dict

    @property
    def time_us(self):
        return statistics.median(self.times_us)

    @property
    def parts(self):
        """Stage, case, method, setting."""
        stage, case, method, *setting = self.name.split("/")
        return stage, case, method, "/".join(setting)

    @property
    def is_peer(self):
        return self.parts[2].startswith("peer-")


def read(run):
    """{name: Row} of a file or folder, in its order. A benchmark that stands in several files has all of their times."""
    run = pathlib.Path(run)
    rows = {}
    for file in sorted(run.glob("*.json")) if run.is_dir() else [run]:
        for entry in json.loads(file.read_text(encoding="utf-8"))["benchmarks"]:
            if entry["run_type"] != "iteration" or entry.get("error_occurred"):
                continue
            by_clock = re.search("/(manual|real)_time", entry["run_name"])
            row = rows.setdefault(OPTIONS.sub("", entry["run_name"]), Row(OPTIONS.sub("", entry["run_name"]), [], {}))
            row.times_us.append(entry["real_time" if by_clock else "cpu_time"] * TO_US[entry["time_unit"]])
            row.counters.update({key: value for key, value in entry.items() if key not in FIXED})
    return rows


def stages(rows):
    """{stage: [Row]}."""
    out = {}
    for row in rows.values():
        out.setdefault(row.parts[0], []).append(row)
    return out


def ratio_to_ours(row, rows):
    """A peer's time over ours, in the same case and setting; None if there is none."""
    stage, case, _, setting = row.parts
    ours = [other for other in rows if not other.is_peer and other.parts[:2] == (stage, case) and other.parts[3] in (setting, "")]
    return row.time_us / ours[0].time_us if row.is_peer and ours else None


def time(us):
    return next(f"{us / factor:.3g} {unit}" for unit, factor in (("s", 1e6), ("ms", 1e3), ("us", 1), ("ns", 1e-3)) if us >= factor or unit == "ns")


def number(value):
    return "" if value is None else f"{value:.3g}"


def text_table(head, lines):
    widths = [max(len(line[k]) for line in [head, *lines]) for k in range(len(head))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip() for line in [head, *lines])


def stage_table(rows):
    keys = list(dict.fromkeys(key for row in rows for key in row.counters if not key.startswith("ms_")))
    has_stages = any(key.startswith("ms_") for row in rows for key in row.counters)
    lines = []
    for row in rows:
        largest = sorted(((value, key[3:]) for key, value in row.counters.items() if key.startswith("ms_")), reverse=True)[:5]
        lines.append([" ".join(filter(None, row.parts[1:])), time(row.time_us), number(ratio_to_ours(row, rows)), *(number(row.counters.get(key)) for key in keys),
                      *([", ".join(f"{name} {value:.3g}" for value, name in largest)] if has_stages else [])])
    return text_table(["", "time", "x ours", *keys, *(["largest parts, ms"] if has_stages else [])], lines)


def changes(old, new):
    """(times, counters) that differ: (name, before, after, ratio). Times beyond the scatter of both runs and 3 %."""
    times, counters = [], []
    for name in old.keys() & new.keys():
        a, b = old[name], new[name]
        ratio = b.time_us / a.time_us
        if abs(math.log(ratio)) > 0.03 and (max(a.times_us) < min(b.times_us) or max(b.times_us) < min(a.times_us)):
            times.append((name, time(a.time_us), time(b.time_us), ratio))
        for key in a.counters.keys() & b.counters.keys():
            x, y = a.counters[key], b.counters[key]
            if not re.match("ms_|p99_", key) and abs(x - y) > 1e-6 * max(abs(x), abs(y)):
                counters.append((f"{name} {key}", number(x), number(y), y / x if x else math.inf))
    return tuple(sorted(part, key=lambda row: -abs(math.log(max(row[3], 1e-9)))) for part in (times, counters))


def main():
    if len(sys.argv) == 2:
        for stage, rows in stages(read(sys.argv[1])).items():
            print(f"## {stage}\n\n```\n{stage_table(rows)}\n```\n")
        return 0
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    old, new = map(read, sys.argv[1:])
    for title, part in zip(("times", "errors and sizes"), changes(old, new)):
        print(text_table([f"{title}: {len(part)} changed", "before", "after", "ratio"], [[name, a, b, f"{ratio:.3f}"] for name, a, b, ratio in part]) + "\n")
    lines = [[stage, f"{statistics.geometric_mean(new[row.name].time_us / row.time_us for row in rows):.3f}", str(len(rows))]
             for stage, rows in stages({name: row for name, row in old.items() if name in new}).items()]
    print(text_table(["stage", "mean ratio", "benchmarks"], lines))
    print(f"only before: {len(old.keys() - new.keys())}, only after: {len(new.keys() - old.keys())}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
