# SPDX-License-Identifier: Apache-2.0
"""Scenes of 1, 3 and 35 slices of assets of 35 and 350, made of the
sample's slices (and of the real scans', if available): what is read, decoded, factored and kept depends on the scene and not on the
asset, and so does the processor time of one slice. The report makes a page of the results."""
import json
import pathlib
import tempfile

import pytest
from programs import ASSETS
from sweeps import sweep

BOUND = 1.3


def test_scene_sweep():
    assets = [{"name": path.stem, "path": str(path)} for path in sorted(ASSETS.glob("*.glb"))]
    if not assets:
        pytest.skip("no asset")
    with tempfile.TemporaryDirectory() as scratch:
        plan = {"assets": assets, "asset_slices": [35, 350], "scene_slices": [1, 3, 35], "repetitions": 21, "folder": scratch}
        done = sweep("scene_sweep", plan)
        assert done.returncode == 0, done.returncode
        assert list(pathlib.Path(scratch).iterdir()) == []
        data = json.loads(done.stdout)
        for asset in assets:
            rows = {(row["scene_slices"], row["asset_slices"]): row for row in data["rows"] if row["scan"] == asset["name"]}
            assert sorted(rows) == [(1, 1), (1, 35), (1, 350), (3, 3), (3, 35), (3, 350), (35, 35), (35, 350)]
            for (scene, of), row in rows.items():
                alone = rows[scene, scene]
                for what in ("read_bytes", "read_peak_bytes", "load_peak_bytes", "kept_bytes"):
                    assert row[what] <= BOUND * alone[what], (row["id"], what, row[what], alone[what])
                assert row["read_bytes"] <= row["file_bytes"], row
                for what in ("decoded_triangles", "factored_nodes"):
                    assert row[what] == alone[what], (row["id"], what)
            assert rows[1, 350]["factored_nodes"] > 0
            assert rows[1, 350]["load_time_ratio"] <= BOUND, rows[1, 350]
            # The share of the file that is read is about that of its slices in the scene.
            assert rows[1, 350]["read_bytes"] < rows[1, 350]["file_bytes"] / 100
            whole = {row["asset_slices"]: row for row in data["whole"] if row["scan"] == asset["name"]}
            assert whole[350]["read_peak_bytes"] > 20 * rows[1, 350]["read_peak_bytes"]

        import page as html
        import scenes  # brings matplotlib
        page = html.Page("t")
        scenes.show(data, page)
        assert "<svg" in page.text() and "One slice of 350" in page.text()
        assert len(scenes.results(data)) == 2 + 3 * len(assets) + 2

        assert sweep("scene_sweep", {**plan, "repetitions": 0}).returncode == 2
        assert sweep("scene_sweep", {**plan, "scene_slices": [40]}).returncode == 2  # of an asset of 35
        assert sweep("scene_sweep", {"assets": []}).returncode == 2
        assert sweep("scene_sweep", {**plan, "assets": [{"name": "x", "path": "/no/such.glb"}]}).returncode == 3
