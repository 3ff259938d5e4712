# SPDX-License-Identifier: Apache-2.0
"""A small sweep whose results must have known properties."""
import json

from sweeps import sweep


def test_device_sweep():
    plan = {"poses": 500, "tilts_deg": [0, 40], "forces_N": [10, 60, 140], "wrenches": 400, "timed": 300, "kinematics_poses": 200,
            "maps": [{"extent_m": 0.02, "heights_m": [0.1, 0.2], "points": 5, "tilt_deg": 10, "tilts": 6}]}
    done = sweep("device_sweep", plan)
    assert done.returncode == 0, done.returncode
    answer = json.loads(done.stdout)
    four, three = answer["rings"]
    assert four["id"].startswith("4 legs") and three["id"].startswith("3 legs")
    for ring in (four, three):
        row = {r["id"]: r for r in ring["rows"]}
        stated = row["stated workspace"]
        assert stated["reachable_poses"] == 500 and stated["unreachable_poses"] == 0
        assert 0 <= stated["inverse_condition_min"] <= stated["inverse_condition_p1"] <= stated["inverse_condition_median"] <= 1
        assert stated["share_below_0.02_percent"] <= stated["share_below_0.1_percent"]
        assert len(ring["maps"]) == 2
        for each in ring["maps"]:
            assert len(each["upright"]) == len(each["tilted"]) == 5
            for upright, tilted in zip(sum(each["upright"], []), sum(each["tilted"], [])):
                assert 0 <= tilted <= upright <= 1
    # Upright, four legs are symmetric under a rotation by 90 degrees, and so is the map.
    grid = four["maps"][0]["upright"]
    turned = [list(row) for row in zip(*grid[::-1])]
    assert all(abs(a - b) < 1e-9 for x, y in zip(grid, turned) for a, b in zip(x, y))
    # As tests/runtime/mechanism/jacobian_test.cpp asserts for similar poses.
    assert four["rows"][0]["inverse_condition_min"] > 0.15 and four["rows"][0]["torque_for_35N_max_Nm"] < 4.5

    inverse, forward, motors, compact, influence = answer["kinematics"]
    assert all(row["failures"] == 0 and row["median_us"] > 0 for row in answer["kinematics"])
    assert forward["pose_error_max_m"] < 1e-12 and motors["pose_error_max_m"] < 1e-10 and motors["iterations_max"] <= 6, (forward, motors)
    assert influence["difference_from_compact_max"] < 1e-11

    rows = answer["allocation"]
    assert [r["force_N"] for r in rows] == [10, 60, 140]
    assert rows[0]["exact_percent"] == 100 > rows[2]["exact_percent"]
    for r in rows:
        assert r["minimum_norm_fits_percent"] - 1 <= r["exact_percent"] <= r["feasible_percent"], r
        assert r["residual_max"] < 1e-9 and r["largest_torque_of_limit"] <= 1, r
        assert r["direction_error_max_deg"] < 1e-5 and r["clipping_direction_error_max_deg"] >= r["clipping_direction_error_p95_deg"], r
    assert rows[2]["clipping_direction_error_max_deg"] > 10
    times = {r["id"]: r for r in answer["times"]}
    assert times["all"]["wrenches"] == 300 == sum(times[k]["wrenches"] for k in ("minimum norm", "null space", "scaled"))
    assert all(0 < r["median_us"] <= r["max_us"] for r in times.values())

    assert sweep("device_sweep", {"poses": 1}).returncode == 2 and sweep("device_sweep", "{").returncode == 2
