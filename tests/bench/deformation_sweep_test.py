# SPDX-License-Identifier: Apache-2.0
"""A small sweep over the assets of the scans, whose results must have known properties; and the report makes a page of them."""
import json

import pytest
from programs import ASSETS
from sweeps import sweep


def test_deformation_sweep():
    asset = ASSETS / "sample.glb"
    if not asset.is_file():
        pytest.skip("no asset")
    plan = {"assets": [{"name": "phantom", "path": str(asset)}], "places": 12, "repetitions": 1, "reach_m": 0.008, "tool_radius_m": 0.003}
    done = sweep("deformation_sweep", plan)
    assert done.returncode == 0, done.returncode
    data = json.loads(done.stdout)
    rows = {method: [row for row in data["rows"] if row["method"] == method] for method in ("propagation", "local", "auto", "global")}
    assert [len(rows[method]) for method in rows] == [12, 12, 3, 1]
    assert len({row["id"] for row in data["rows"]}) == 28
    # The error does not grow with radius or depth, and errors are within the bounds.
    for method in ("propagation", "local"):
        for error in ("force_error_max", "displacement_error_max"):
            values = [row[error] for row in rows[method]]
            assert all(b <= a + 1e-9 for a, b in zip(values, values[1:])), (method, error, values)
    for row in rows["auto"]:
        assert row["force_error_max"] <= row["parameter"] and row["displacement_error_max"] <= row["parameter"], row
    assert rows["local"][0]["force_error"] > 0.05 and rows["local"][-1]["force_error"] < 1e-3

    import deformation  # brings matplotlib
    import page as html
    page = html.Page("t")
    deformation.show(data, page)
    assert "kept all of its bounds" in page.text() and "<svg" in page.text()
    assert len(deformation.results(data)) == 2 + 7 + 2

    assert sweep("deformation_sweep", {**plan, "places": 0}).returncode == 2
    assert sweep("deformation_sweep", {"assets": []}).returncode == 2
    assert sweep("deformation_sweep", {**plan, "assets": [{"name": "x", "path": "/no/such.glb"}]}).returncode == 3
