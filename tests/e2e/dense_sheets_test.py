# SPDX-License-Identifier: Apache-2.0
"""Scenes of dense sheets, of which a path touches a few square millimetres each: 35 slices of a block, with 160,000 vertices each and
with few. A session with the dense ones takes less than 1 GB, its start a few seconds (printed), and its needle meets the same forces."""
import csv
import json
import os
import time

import nibabel
import numpy as np
import pytest
from programs import PROGRAMS, SANITIZED, WORK, run

SLICES, SPACING_MM, SIDE_MM, PIXEL_MM = 35, 0.5, 29.5, 0.4
DENSE_MM2, COARSE_MM2 = 0.0037, 50
VERTICES, BYTES_MAX = 160_000, 1e9


def block(file):
    """A block of 500 HU in air."""
    pixels = 100
    at = (np.arange(pixels) - (pixels - 1) / 2) * PIXEL_MM
    inside = np.abs(at) < SIDE_MM / 2
    volume = np.where(inside[:, None, None] & inside[None, :, None], 500, -1000) * np.ones(SLICES)
    nibabel.save(nibabel.Nifti1Image(volume.astype(np.int16), np.diag([PIXEL_MM, PIXEL_MM, SPACING_MM, 1.0])), file)


def asset(name, scan, area_mm2):
    file = WORK / f"{name}.glb"
    run(PROGRAMS / "trocar-mesh", scan, "-o", file, "--quiet", "--max-area", area_mm2, "--report", WORK / "report.json")
    slices = json.loads((WORK / "report.json").read_text())["slices"]
    assert len(slices) == SLICES
    return file, min(one["vertices"] for one in slices)


def session(name, scene):
    """The rows of a session, and the peak of the program's memory in bytes."""
    file, recording, summary = WORK / f"{name}.json", WORK / f"{name}.csv", WORK / f"{name}_summary.json"
    file.write_text(json.dumps(scene))
    start = time.monotonic()
    pid = os.posix_spawn(PROGRAMS / "trocar-run", ["trocar-run", str(file), "--clock", "virtual", "--quiet", "--record", str(recording),
                                                   "--summary", str(summary)], os.environ)
    _, status, usage = os.wait4(pid, 0)
    assert status == 0
    print(f"{name}: {time.monotonic() - start:.1f} s for start and {scene['duration_s']} s of session, {usage.ru_maxrss / 1024:.0f} MB")
    with recording.open() as lines:
        return list(csv.DictReader(line for line in lines if not line.startswith("#"))), 1024 * usage.ru_maxrss


@pytest.mark.skipif(SANITIZED, reason="a sanitizer needs memory of its own")
def test_dense_sheets():
    WORK.mkdir(parents=True, exist_ok=True)
    scan = WORK / "block.nii"
    block(scan)
    dense, vertices = asset("dense", scan, DENSE_MM2)
    assert vertices >= VERTICES, vertices
    coarse, _ = asset("coarse", scan, COARSE_MM2)
    run(PROGRAMS / "trocar-run", "new-scene", coarse, "-o", WORK / "scene.json", "--quiet")
    scene = json.loads((WORK / "scene.json").read_text())
    assert scene["body"]["to"] - scene["body"]["from"] == SLICES - 1
    few, _ = session("coarse", {**scene, "asset": coarse.name})
    many, memory_bytes = session("dense", {**scene, "asset": dense.name})
    assert memory_bytes <= BYTES_MAX, f"{memory_bytes / 1e6:.0f} MB"
    assert len(few) == len(many)
    forces = [[abs(float(row["tip_N"])) for row in rows] for rows in (few, many)]
    difference = max(abs(a - b) for a, b in zip(*forces))
    print(f"forces up to {max(forces[0]):.1f} N differ by at most {difference:.2g} N")
    assert max(forces[0]) > 20 and difference < 1e-6
