# SPDX-License-Identifier: Apache-2.0
"""The stages of the sample's path and their bounds, and the report's page of
them. Figures of bytes are checked; times only as far as they hold on any machine."""
import gzip
import json
import types

from programs import SCAN
from sweeps import sweep


def test_path_bounds():
    import page as html
    import path as section
    plan = section.plan(types.SimpleNamespace(sample=SCAN, head_ct=None, full=False))
    plan["repetitions"] = 2
    done = sweep("path_bounds", plan)
    assert done.returncode == 0, done.returncode
    data = json.loads(done.stdout)
    assert data["copied_GB_per_s"] > 0
    rows = {row["id"]: row for row in data["rows"]}
    with gzip.open(SCAN / "sample.nii.gz") as volume:
        unpacked = len(volume.read())
    # Every row of a PNG has one byte before its pixels, which are red, green and blue.
    inflated = {"sample, DICOM": 0, "sample, .nii.gz": unpacked, "sample, PNG": 35 * 512 * (3 * 512 + 1)}
    for name, row in rows.items():
        assert row["slices"] == 35 and row["pixels"] == 35 * 512 * 512, row
        assert row["inflated_bytes"] == inflated[name], (name, row["inflated_bytes"], inflated[name])
        # Draco alone, on the meshes in their stored order, makes payloads of nearly the same size, so it does the same work.
        assert abs(row["draco_alone_bytes"] / row["payload_bytes"] - 1) < 0.005, row
        stages = {stage["id"]: stage for stage in row["stages"]}
        with_bound = {id for id, stage in stages.items() if "bound_ms" in stage}
        expected = {"read", "contour", "simplify", "triangulate", "refine", "check", "encode", "digest", "assemble"}
        expected |= {"unpack"} if name == "sample, .nii.gz" else set()
        expected |= {"segment", "hu"} if name != "sample, PNG" else set()
        assert with_bound == expected, (name, with_bound)
        assert all(stage["bound_ms"] > 0 for stage in stages.values() if "bound_ms" in stage), row
    assert sweep("path_bounds", {"repetitions": 0, "inputs": []}).returncode == 2
    assert sweep("path_bounds", {"repetitions": 1, "inputs": [{"id": "x", "path": "/no/such", "threshold": 1}]}).returncode in (2, 3)

    page = html.Page("t")
    section.show(data, page)
    assert "<svg" in page.text() and "over the bound" in page.text()
    assert len(section.results(data)) == 2 + 3 + 2
