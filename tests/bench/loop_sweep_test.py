# SPDX-License-Identifier: Apache-2.0
"""A small sweep whose results must have known properties."""
import json
import math

from sweeps import sweep


def test_loop_sweep():
    plan = {
        "rates_Hz": [500, 1000], "traces": True,
        "walls": [{"rate_Hz": 500, "stiffness_N_per_m": 5000, "pressed_N": 35}],
        "region": {"damping_N_s_per_m": [0, 5], "bisections": 6},
    }
    done = sweep("loop_sweep", plan)
    assert done.returncode == 0, done.returncode
    answer = json.loads(done.stdout)
    plain, controlled = answer["walls"]
    assert plain["residual_oscillation_mm"] > 1 and controlled["residual_oscillation_mm"] < 0.1
    assert plain["damping_added_max_N_s_per_m"] == 0 < controlled["damping_added_max_N_s_per_m"] <= 100
    assert math.isclose(controlled["needed_damping_K_T_over_2_N_s_per_m"], 5)
    assert 1 < controlled["device_damping_N_s_per_m"] < 5
    assert len(controlled["depth_mm_at_s"]) == 400 and math.isclose(controlled["depth_mm_at_s"][-1][1], 7, rel_tol=0.02)
    for row in answer["releases"]:
        assert abs(row["given_after_puncture_mJ"]) < 1e-9, row
        assert 100 < row["taken_before_puncture_mJ"] < 140, row  # 35 N over 7 mm: 122.5 mJ
        if row["passivity_controller"]:
            assert row["given_by_press_and_lift_mJ"] < 1, row
    assert len(answer["region"]) == 8
    of = {(r["rate_Hz"], r["wall_damping_N_s_per_m"], r["passivity_controller"]): r for r in answer["region"]}
    for row in answer["region"]:
        # The bound is sufficient for any hand; 20 % for the bisection.
        assert row["largest_stable_stiffness_N_per_m"] > 0.8 * row["bound_stiffness_N_per_m"], row
    for rate in (500, 1000):
        assert of[rate, 0, True]["largest_stable_stiffness_N_per_m"] > 3 * of[rate, 0, False]["largest_stable_stiffness_N_per_m"]
    assert sweep("loop_sweep", "{}").returncode == 2 and sweep("loop_sweep", "x").returncode == 2
