# SPDX-License-Identifier: Apache-2.0
"""The time of a vertex hardly depends on how large the slice is."""
import json

from programs import SANITIZED
from sweeps import sweep


def rows_of(sizes, textures, repetitions):
    done = sweep("noise_sweep", {"repetitions": repetitions, "sizes": sizes, "textures": textures})
    assert done.returncode == 0, done.returncode
    rows = json.loads(done.stdout)["rows"]
    assert [(r["texture"], r["size"]) for r in rows] == [(t, s) for t in textures for s in sizes]
    return rows


def test_noise_sweep():
    for row in rows_of([64], ["noise", "struts", "grains"], 1):
        assert row["vertices"] > 100 and row["bytes"] > 100, row
        assert row["cpu_ms"] > 0 and set(row["ms"]) > {"check", "contour", "encode", "refine", "simplify"}, row
    assert sweep("noise_sweep", {"repetitions": 1}).returncode == 2
    assert sweep("noise_sweep", {"repetitions": 1, "sizes": [64], "textures": ["wood"]}).returncode == 2
    if SANITIZED:
        return 0
    # Six times as wide. The smaller slice fits into the caches, the larger one does not: 1.9 on a busy machine.
    small, large = rows_of([160, 960], ["noise"], 3)
    ratio = large["us_per_vertex"] / small["us_per_vertex"]
    print(f"{small['us_per_vertex']:.2f} us a vertex, {ratio:.2f} times that in the larger slice")
    assert ratio < 2.5, (small, large)
