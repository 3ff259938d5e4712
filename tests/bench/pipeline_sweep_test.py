# SPDX-License-Identifier: Apache-2.0
"""A small sweep whose results must have known properties."""
import json
import math

from sweeps import sweep

DEFAULT = {"contour": "subpixel", "tolerance_mm": 0.2, "min_angle_deg": 30, "max_area_mm2": 50, "lattice_bits": 8}


def test_pipeline_sweep():
    plan = {
        "repetitions": 1,
        "scans": [{"name": "phantom", "slices": [17], "noise_hu": 0}],
        "points": [{"id": "default", **DEFAULT}, {"id": "exact", **DEFAULT, "tolerance_mm": 0, "simplify": "dp"},
                   {"id": "pixel", **DEFAULT, "contour": "pixel", "tolerance_mm": 0},
                   {"id": "too_coarse", **DEFAULT, "lattice_bits": 2}],
        "simplifiers": {"tolerances_px": [1, 3]},
        "discs": {"radii_px": [5.3, 20.3], "blur_sigma_px": [0, 0.5], "offsets": 4},
    }
    done = sweep("pipeline_sweep", plan)
    assert done.returncode == 0, done.returncode
    answer = json.loads(done.stdout)
    row = {r["point"]: r for r in answer["rows"]}
    assert len(row) == 4 and "refused" in row["too_coarse"] and "refused" not in row["default"]

    # Simplification adds at most its tolerance to the error of the exact contour.
    exact, default, pixel = row["exact"], row["default"], row["pixel"]
    assert exact["simplification_error_mm"] == 0 < default["simplification_error_mm"] <= 0.2
    assert 0 < exact["mean_distance_mm"] < 0.005 < default["mean_distance_mm"] < 0.2
    # (Steiner points may lie three lattice steps off; distances are sampled every eighth of a pixel.)
    allowance = 3 / 256 + exact["pixel_mm"] / 16
    assert exact["hausdorff_mm"] < 0.15
    assert default["hausdorff_mm"] <= exact["hausdorff_mm"] + 0.2 + allowance
    assert exact["hausdorff_mm"] >= exact["p99_distance_mm"] >= exact["mean_distance_mm"]
    # Chains through pixel centres lie half a pixel inside on average: the area is too small.
    assert pixel["mean_distance_mm"] > 10 * exact["mean_distance_mm"]
    assert pixel["area_error_percent"] < -2 and abs(exact["area_error_percent"]) < 0.2
    assert default["triangles"] < exact["triangles"] and default["asset_bytes"] < exact["asset_bytes"]
    assert default["triangles_below_min_angle_unexplained"] == 0
    parts = sum(default[f"{part}_bytes"] for part in ("triangle", "outline", "json"))
    assert 0 <= default["asset_bytes"] - parts < 200, (default["asset_bytes"], parts)

    assert {r["contour"] for r in answer["simplifiers"]} == {"subpixel", "pixel"}
    for r in answer["simplifiers"]:
        assert r["trocar"]["collapsed_rings"] == r["trocar"]["crossing_rings"] == 0, r["id"]
        assert r["trocar"]["vertices"] < r["contour_vertices"]
    for r in answer["discs"]:
        # A chain through the centres of a disc's border pixels is a disc with a radius smaller by half a pixel.
        expected = 100 * ((1 - 0.5 / r["radius_px"]) ** 2 - 1)
        assert math.isclose(r["pixel_area_error_percent"], expected, rel_tol=0.15), r
        assert r["subpixel_worst_area_error_percent"] < (1 if r["radius_px"] < 20 else 0.1), r

    # Wrong plans are refused.
    assert sweep("pipeline_sweep", {"repetitions": 0, "scans": [], "points": []}).returncode == 2
    assert sweep("pipeline_sweep", {"points": []}).returncode == 2
    missing = {**plan, "scans": [{"name": "x", "path": "/no/such.nii", "first": 0, "stride": 1}]}
    assert sweep("pipeline_sweep", missing).returncode in (2, 3)
