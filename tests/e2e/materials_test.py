# SPDX-License-Identifier: Apache-2.0
"""The labels of a label map as materials of one asset, as a user makes, reads and meets them. (No gap, no overlap, areas: materials_test.cpp,
label_borders_test, regions_test.)"""
import json

import nibabel
import numpy

from programs import PROGRAMS, WORK, run

MESH = PROGRAMS / "trocar-mesh"
PIXEL_MM = 0.75


def label_map(name, slices):
    """Slices [y][x], from the right to the left and from front to back of the patient: a NIfTI's axes point the other way."""
    volume = numpy.stack(slices).astype(numpy.int16)
    affine = numpy.diag([-PIXEL_MM, -PIXEL_MM, 2, 1])
    file = WORK / name
    nibabel.save(nibabel.Nifti1Image(volume.transpose(2, 1, 0), affine), file)
    return file


def info(asset):
    return json.loads(run(MESH, "info", asset, "--json").stdout)


def test_groups_labels():
    """Each label a material, unless + joins it with others."""
    square = numpy.zeros((20, 40), int)
    for k in range(4):
        square[4:16, 4 + 8 * k:12 + 8 * k] = 20 + k
    file, asset = label_map("four.nii.gz", [square, numpy.zeros_like(square)]), WORK / "four.glb"
    names = WORK / "names.json"
    names.write_text(json.dumps({"20": "L1", "21": "L2"}))
    for words, materials, labels, joined in (
            (("20,21",), ["L1", "L2"], [20, 21], None), (("20", "21"), ["L1", "L2"], [20, 21], None), (("20-22",), ["L1", "L2", "label 22"], [20, 21, 22], None),
            (("all",), ["L1", "L2", "label 22", "label 23"], [20, 21, 22, 23], None), (("20+21",), ["L1 + L2"], [20, 21], [[20, 21]]),
            (("20+22,21",), ["L1 + label 22", "L2"], [20, 21, 22], [[20, 22]]), (("22", "23+20"), ["L1 + label 23", "label 22"], [20, 22, 23], [[20, 23]]),
            (("20-21+23", "22"), ["L1 + L2 + label 23", "label 22"], [20, 21, 22, 23], [[20, 21, 23]]), (("20,20",), ["L1"], [20], None),
            (("20,99",), ["L1"], [20, 99], None)):
        run(MESH, file, *(f"--labels={word}" for word in words), "--names", names, "-o", asset, "--quiet")
        told = info(asset)
        assert [m["name"] for m in told["materials"]] == materials, f"{words}: {told['materials']}"
        assert told["parameters"]["labels"] == labels and told["parameters"].get("joined_labels") == joined, f"{words}: {told['parameters']}"
        assert [s["index"] for s in told["slices"]] == [0] * len(materials) + [1], f"{words}: entries {told['slices']}"
        run(MESH, "verify", "--private", "--independent", asset)
    for option, because in (("--contour=pixel", "join the labels"), ("--fill=all", "--fill fills one material")):
        said = run(MESH, file, "--labels", "all", option, "-o", WORK / "none.glb", expect=2).stderr
        assert because in said and len(said.splitlines()) == 1, f"{option}: {said}"
    run(MESH, file, "--labels", "20+21", "--contour", "pixel", "-o", asset, "--quiet")
    text = run(MESH, file, "--labels", "20-22", "--names", names, "-o", asset).stdout
    assert ": 2 slices, " in text, text
    text = run(MESH, "info", asset).stdout
    assert "material" in text and '"L1"' in text and '"label 22"' in text, text
    # Three squares of 12 x 8 pixels that share borders: rounded corners only.
    told = info(asset)["materials"]
    assert all(abs(m["area_mm2"] / (96 * PIXEL_MM ** 2) - 1) < 0.02 for m in told), f"{told}"


def test_all_labels_of_a_map_with_one_are_filled_like_this_one():
    """Also in a slice that lost its labels, which only the filling closes."""
    slices = [numpy.zeros((30, 30), int) for _ in range(14)]
    for k in (2, 3, 4, 5, 7, 8, 9, 10):
        slices[k][10:20, 10:20] = 7
    file, told = label_map("gap.nii.gz", slices), {}
    for words in ("7", "all"):
        asset = WORK / f"gap_{words}.glb"
        run(MESH, file, "--labels", words, "--fill", "all", "--close", "2", "-o", asset, "--quiet")
        told[words] = info(asset)
        assert [s["index"] for s in told[words]["slices"] if s["area_mm2"]] == list(range(2, 11)), told[words]["slices"]
    assert [m["name"] for m in told["all"]["materials"]] == ["label 7"], told["all"]["materials"]
    areas = [[m["area_mm2"] for m in one["materials"]] for one in told.values()]
    assert areas[0] == areas[1], areas


def test_is_met_as_one_sheet():
    """A needle at the border of two materials, and at that of their union: one puncture, and nearly the same force."""
    square = numpy.zeros((60, 60), int)
    square[10:50, 10:50] = 20
    square[10:50, 30:50] = 21
    file, forces = label_map("halves.nii.gz", [square]), {}
    for words in ("20,21", "20+21"):
        asset, summary, scene = WORK / "halves.glb", WORK / "halves_summary.json", WORK / "halves.json"
        run(MESH, file, "--labels", words, "-o", asset, "--quiet")
        scene.write_text(json.dumps({
            "schema": "trocar.scene/1", "name": "two halves", "asset": asset.name, "duration_s": 1.5,
            "placement": {"anchor_mm": [29.5 * PIXEL_MM, 30 * PIXEL_MM]}, "slices": [{"index": 0, "z_m": 0.15}],
            "tissue": {"stiffness_N_per_m": 2000, "threshold_N": 4}, "tool": {"sides": 6, "radius_m": 0.001},
            "hand": {"stiffness_N_per_m": 8000, "damping_N_s_per_m": 140,
                     "trajectory": [{"t_s": 0, "tip_m": [0, 0, 0.155]}, {"t_s": 0.2, "tip_m": [0, 0, 0.155]}, {"t_s": 1.3, "tip_m": [0, 0, 0.14]}]}}))
        run(PROGRAMS / "trocar-run", scene, "--clock", "virtual", "--summary", summary, "--quiet")
        told = json.loads(summary.read_text())
        assert len(told["punctures"]) == 1, f"{words}: punctures {told['punctures']}"
        forces[words] = told["punctures"][0]
    print("punctures", json.dumps(forces))
    several, joined = forces["20,21"], forces["20+21"]
    assert abs(several["tip_N"] / joined["tip_N"] - 1) < 0.05, f"{forces}"
    assert abs(several["t_s"] - joined["t_s"]) < 0.02, f"{forces}"
