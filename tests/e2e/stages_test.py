# SPDX-License-Identifier: Apache-2.0
"""stages_test.py PROGRAMS SCAN WORK: the stages of a report add up to its total within 3 %, for every kind of input and several
threads, and a stage is there where its work is done.

A machine that stands still between two stages lengthens the total alone, so the best of three runs counts.
"""
import json
import pathlib
import shutil
import sys

from e2e import check, outcome, run

PROGRAM, SCAN, WORK = pathlib.Path(sys.argv[1]) / "trocar-mesh", *map(pathlib.Path, sys.argv[2:4])
TOLERANCE = 0.03
SLICES = {"read", "segment", "contour", "simplify", "triangulate", "refine", "check", "hu", "encode"}
ALWAYS = SLICES | {"open", "idle", "collect", "assemble", "unpack"}


def report_of(*words):
    file = WORK / "report.json"
    run(PROGRAM, *words, "-o", WORK / "out.glb", "--report", file, "--quiet")
    return json.loads(file.read_text())


def main():
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    key = WORK / "key"
    key.write_bytes(bytes(range(32)))
    runs = {
        "dicom": ([SCAN / "dicom", "--jobs", 1], set()),
        "dicom, two threads": ([SCAN / "dicom", "--jobs", 2], set()),
        "dicom, eight threads": ([SCAN / "dicom", "--jobs", 8, "--input-key", key], {"digest"}),
        "gzip": ([SCAN / "sample.nii.gz", "--jobs", 2, "--input-key", key], {"digest"}),
        "gzip, one slice": ([SCAN / "sample.nii.gz", "--jobs", 2, "--slices", "20:20"], set()),
        "surface, solid": ([SCAN / "dicom", "--jobs", 2, "--surface", "--fill", "all"], {"surface", "solid"}),
    }
    for name, (words, more) in runs.items():
        shares = []
        for _ in range(3):
            report = report_of(*words)
            stages, total = report["stages_ms"], report["total_ms"]
            check(set(stages) == ALWAYS | more, f"{name}: stages {sorted(set(stages) ^ (ALWAYS | more))}")
            check(all(ms >= 0 for ms in stages.values()), f"{name}: {stages}")
            for stage in SLICES - {"read"}:  # whose waiting for gzip is `unpack`
                of_slices = sum(piece["ms"][stage] for piece in report["slices"] if "ms" in piece) / report["threads"]
                check(abs(stages[stage] - of_slices) <= 1e-9 * max(1, of_slices), f"{name}: {stage}: {stages[stage]}, of the slices {of_slices}")
            shares.append(sum(stages.values()) / total)
            if abs(shares[-1] - 1) <= TOLERANCE:
                break
        best = min(shares, key=lambda share: abs(share - 1))
        print(f"{name}: the stages are {100 * best:.2f} % of {total:.0f} ms:", ", ".join(f"{k} {v:.1f}" for k, v in stages.items() if v > 0.01 * total))
        check(abs(best - 1) <= TOLERANCE, f"{name}: the stages add up to {shares} of the total")
        if "digest" in more:
            check(stages["digest"] > 0, f"{name}: no time for the digest")
        if name == "gzip, one slice":
            check(stages["unpack"] > 0, f"{name}: nobody waited for gzip")
    return outcome()


sys.exit(main())
