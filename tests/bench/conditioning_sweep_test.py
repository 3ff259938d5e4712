# SPDX-License-Identifier: Apache-2.0
"""On few inputs, every error is within its stated
bound, the hard inputs are hard, and the report makes a page of the results. Environment: TROCAR_CONDITIONING times as many inputs."""
import json
import os

from sweeps import sweep


def test_conditioning_sweep():
    many = int(os.environ.get("TROCAR_CONDITIONING", "1"))
    plan = {"predicate_inputs": 3000 * many, "network_side": 8, "poses": 40 * many, "allocations": 60 * many}
    done = sweep("conditioning_sweep", plan)
    assert done.returncode == 0, done.returncode
    data = json.loads(done.stdout)

    for row in data["predicates"]:
        assert row["wrong_signs"] == 0, row
    # The inputs are hard: doubles give wrong signs.
    assert all(sum(row["wrong_signs_of_doubles"] for row in data["predicates"] if row["predicate"] == name) > 0
               for name in ("orient2d", "in_circle"))

    for row in data["network"]:
        assert row["solved"] and row["coefficient_error"] <= row["coefficient_bound"], row
        for solver in ("local", "global"):
            assert row[f"displacement_error_{solver}"] <= row["bound"], row
            assert row[f"stiffness_error_{solver}"] <= row["stiffness_bound"], row
    usual = next(row for row in data["network"] if row["id"] == "as usual")
    assert max(usual["stiffness_error_local"], usual["displacement_error_local"]) < 1e-14, usual

    for row in data["jacobian"]:
        if row["count"] > 0:
            assert max(row["error_compact"], row["error_influence"]) <= row["bound"], row
    workspace, end = data["jacobian"][0], data["jacobian"][-1]
    assert workspace["count"] == plan["poses"] and workspace["error_compact"] < 1e-13, workspace
    assert end["count"] == 0 and end["refused_as_singular"] > 0, end  # reported as singular, not computed wrongly

    for row in data["allocation"]:
        assert row["unanswered"] == 0 and row["largest_part_of_bound"] <= row["bound"], row
    kinds = {kind: sum(row[kind] for row in data["allocation"]) for kind in ("minimum_norm", "null_space", "scaled")}
    assert min(kinds.values()) > 5, kinds
    equal = next(row for row in data["allocation"] if row["id"].startswith("20 to 200 N"))
    assert equal["torque_error"] < 1e-12 and equal["scale_error"] < 1e-14, equal

    import conditioning  # brings matplotlib
    import page as html
    page = html.Page("t")
    conditioning.show(data, page)
    assert "<svg" in page.text() and "wrong sign" in page.text()
    assert len(conditioning.results(data)) == 1

    assert sweep("conditioning_sweep", {**plan, "poses": 0}).returncode == 2 and sweep("conditioning_sweep", {**plan, "network_side": 3}).returncode == 2
    assert sweep("conditioning_sweep", {}).returncode == 2
