# SPDX-License-Identifier: Apache-2.0
"""The positions and HU that `trocar-mesh info` reports for each slice.

Box and centroid are computed again from the outlines that `trocar-mesh export` writes, by Green's theorem; the mean HU from the voxels
of a scan of two materials that is made here. The JSON conforms to its schema, and the text says what the JSON says.
"""
import json
import re

import numpy as np

import pytest
from exported import nifti, read_rings, schema_of
from programs import run


def moments(rings):
    """Area and centroid; material on the left."""
    area, first = 0.0, np.zeros(2)
    for ring in rings:
        a, b = ring, np.roll(ring, -1, axis=0)
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        area += cross.sum() / 2
        first += ((a + b) * cross[:, None]).sum(axis=0) / 6
    return area, first / area


def test_info(source, programs, scan, work):
    mesh = programs / "trocar-mesh"
    validator = schema_of("info")

    def info(asset):
        document = json.loads(run(mesh, "info", asset, "--json").stdout)
        for error in validator.iter_errors(document):
            pytest.fail(f"{asset.name}: {error.json_path}: {error.message[:200]}")
        for key in ("box_mm", "slices"):
            assert not validator.is_valid({k: v for k, v in document.items() if k != key}), f"schema: takes a document without {key}"
        return document

    sample = work / "sample.glb"
    run(mesh, scan / "dicom", "-o", sample, "--quiet")
    run(mesh, "export", sample, "-o", work / "exported")
    document, seen = info(sample), 0
    text = run(mesh, "info", sample).stdout
    corners = []
    for each in document["slices"]:
        rings = read_rings(work / "exported" / f"slice_{each['index']:04}.poly")
        area, centroid = moments(rings)
        points = np.concatenate(rings)
        name = f"slice {each['index']}"
        assert abs(area - each["area_mm2"]) < 1e-9 * area, f"{name}: area {each['area_mm2']}, not {area}"
        assert np.allclose(each["centroid_mm"], centroid, rtol=0, atol=1e-9), f"{name}: centroid {each['centroid_mm']}, not {centroid}"
        assert np.allclose(each["box_mm"], [points.min(axis=0), points.max(axis=0)], rtol=0, atol=1e-12), f"{name}: box {each['box_mm']}"
        corners += each["box_mm"]
        line = next(line for line in text.splitlines() if re.match(rf" +{each['index']} +-?\d+\.\d", line)).split()
        assert line[-1] == f"{each['mean_hu']:.0f}" and line[-2] == f"{centroid[1]:.1f}", f"{name}: the text says {line}"
        seen += 1
    assert seen == 35, f"{seen} slices"
    assert np.allclose(document["box_mm"], [np.min(corners, axis=0), np.max(corners, axis=0)]), f"box {document['box_mm']}"

    y, x = np.mgrid[0:40, 0:40]
    disc = np.hypot(x - 20, y - 20) < 12
    voxels = np.stack([np.where(disc, hu, -500) for hu in (400, 800, -500, 1000)])
    run(mesh, nifti(work / "discs.nii", voxels, (1, 1, 1)), "-o", work / "discs.glb", "--quiet")
    for each, hu in zip(info(work / "discs.glb")["slices"], (400, 800, None, 1000)):
        if hu is None:
            assert each["mean_hu"] is None and each["box_mm"] is None and each["centroid_mm"] is None, f"an empty slice: {each}"
        else:  # 20 of 40 pixels, counted from the other side: a NIfTI's x and y point to right and anterior
            assert abs(each["mean_hu"] - hu) <= 8 and np.hypot(*(np.array(each["centroid_mm"]) - 19)) < 0.05, f"disc of {hu} HU: {each}"
    run(mesh, scan / "dicom", "-o", work / "no_hu.glb", "--no-hu", "--slices", "3:5", "--quiet")
    report = info(work / "no_hu.glb")["slices"]
    assert len(report) == 3, f"{report}"
    assert "no material" in run(mesh, "info", work / "discs.glb").stdout, "the text of an empty slice"
