# SPDX-License-Identifier: Apache-2.0
"""The scanner's table beside a body with bone: left out by a run, its surface and its preview, unless --keep-table."""
import json

import nibabel
import numpy
from programs import PROGRAMS, WORK, run

MESH = PROGRAMS / "trocar-mesh"
BONE_MM2 = numpy.pi * 20 * 15


def scan():
    """An ellipse of soft tissue with a bone, on a plate 320 mm wide; right, front, up."""
    x, y = numpy.meshgrid(numpy.arange(-180, 180, 2.0), numpy.arange(-130, 130, 2.0), indexing="ij")
    slice_ = numpy.full(x.shape, -1000.0)
    slice_[numpy.hypot(x / 130, y / 90) < 1] = 40
    slice_[numpy.hypot(x / 20, (y + 50) / 15) < 1] = 700
    slice_[(abs(x) < 160) & (y < -106) & (y > -112)] = 400
    values = numpy.repeat(slice_[:, :, None], 16, axis=2).astype(numpy.int16)
    file = WORK / "table.nii.gz"
    place = numpy.diag([2, 2, 4, 1.0])
    place[:2, 3] = -180, -130
    nibabel.save(nibabel.Nifti1Image(values, place), file)
    return file


def meshed(file, *options):
    """The report of a run, and the largest y of its surface in LPS (the rearmost point), in mm."""
    asset, report = WORK / "table.glb", WORK / "table.json"
    run(MESH, file, "-o", asset, "--report", report, "--quiet", "--surface", *options)
    run(MESH, "export", asset, "--surface", "-o", WORK / "surface")
    lines = next((WORK / "surface").glob("*.obj")).read_text().splitlines()
    back = max(float(line.split()[2]) for line in lines if line.startswith("v "))
    return json.loads(report.read_text()), back


def test_the_table_is_left_out_by_default():
    file = scan()
    report, back = meshed(file)
    assert [w["code"] for w in report["warnings"]] == ["table_removed"]
    assert "keep_table" not in report["parameters"]
    for one in report["slices"]:
        assert abs(one["area_mm2"] - BONE_MM2) < 0.05 * BONE_MM2
    assert 60 < back < 70
    filled, back = meshed(file, "--preset", "vertebra")
    assert "table_removed" in [w["code"] for w in filled["warnings"]]
    assert 60 < back < 70


def test_keep_table_keeps_it():
    report, back = meshed(scan(), "--keep-table")
    assert report["parameters"]["keep_table"] is True
    assert "table_removed" not in [w["code"] for w in report["warnings"]]
    assert all(one["area_mm2"] > BONE_MM2 + 800 for one in report["slices"])
    assert back > 100


def test_the_preview_agrees_and_says_so():
    page = WORK / "table.html"
    run(MESH, "preview", scan(), "-o", page, "--quiet")
    text = page.read_text()
    assert "table_removed" in text and "with the scanner's table" in text.replace("&#39;", "'")
    run(MESH, "preview", scan(), "-o", page, "--quiet", "--keep-table")
    assert "table_removed" not in page.read_text()
