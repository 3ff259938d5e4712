# SPDX-License-Identifier: Apache-2.0
"""A CT beside a label map (--hu) gives the labels a mean HU, and a DICOM segmentation its slices;
a CT on another grid is refused. Names of labels (--names) are in the report and the warnings."""
import math
import subprocess

import numpy as np

from dicom_segmentation_test import (HEIGHT, NAMES, ORIGIN, SLICES, SPACING_U, SPACING_V, STEP, DryRun, WIDTH, codes, conforms, hounsfield, label_map, make_seg)

import pytest


def asset_means(asset):
    """mean_hu of each slice of an asset without HU at vertices."""
    out = []
    for node in asset.json["nodes"][3:]:
        slices = len(asset.json["meshes"][node["mesh"]]["primitives"]) if "mesh" in node else 1
        out += node.get("extras", {}).get("trocar", {}).get("mean_hu", [None] * slices)
    return out


def means(labels, hu, wanted):
    """Of the pixels of the wanted labels, by slice; None where there are none."""
    return [float(h[m].mean()) if (m := np.isin(l, wanted)).any() else None for l, h in zip(labels, hu)]


def same(got, want, within=0.0):
    return len(got) == len(want) and all((a is None) == (b is None) and (a is None or math.isclose(a, b, rel_tol=1e-12, abs_tol=within))
                                         for a, b in zip(got, want))


@pytest.fixture(name="t", scope="module")
def dry_run(programs, work):
    return DryRun(programs, work)


def test_mean_hu(t):
    """The mean of the CT over the labels' pixels, whatever the two files are and along every axis."""
    labels, hu = label_map(), hounsfield()
    nifti, seg, ct_nifti, ct_dicom = t.nifti(labels), t.save(make_seg(labels)), t.nifti(hu, "ct.nii.gz"), t.ct(hu)
    # Transverse, from above; NIfTI's coronal slices go from front to back, rows from left to right, columns down.
    coronal = [np.flip(volume, 0).transpose(1, 0, 2) for volume in (labels, hu)]
    every = "+".join(map(str, NAMES))
    for words, wanted, (l, h) in ((("--labels", every), list(NAMES), (labels, hu)), (("--labels", "1+300"), [1, 300], (labels, hu)),
                                  (("--labels", "2"), [2], (labels, hu)),
                                  (("--labels", every, "--crop", "5:25,6:22"), list(NAMES), (labels[:, 6:23, 5:26], hu[:, 6:23, 5:26])),
                                  (("--labels", "1+2", "--axis", "coronal"), [1, 2], coronal)):
        words = (*words, "--names", t.same_names)
        expected, assets = means(l, h, wanted), []
        assert len({e for e in expected if e is not None}) > 3, f"{words}: too few different values to tell slices apart"
        for scan in (nifti, seg):
            for ct in (ct_nifti, ct_dicom):
                code, lines, report, asset = t.run(scan, *words, "--hu", ct)
                assert code == 0, f"{scan.name} {ct.name} {words}: exit {code} {lines}"
                conforms(report, "report")
                got = [s.get("mean_hu") for s in report["slices"]]
                assert same(got, expected), f"{scan.name} {ct.name} {words}: {got}, not {expected}"
                _, _, _, bare = t.run(scan, *words, "--hu", ct, "--no-hu")
                assert same(asset_means(bare), expected, within=0.0500001), f"{scan.name} {words}: {asset_means(bare)} in the asset"
                assert report["input"]["hu"] == ("input" if ct.is_dir() else ct.name), f"{report['input']}"
                assets.append(asset)
                left_out = [w for w in report["warnings"] if w["code"] == "frames_left_out"]
                assert len(left_out) == (scan == seg), f"{scan.name} {ct.name}: {report['warnings']}"
                assert all("slices 0-1, 5, 10," in w["sentence"] and "the CT of --hu" in w["sentence"] for w in left_out), f"{left_out}"
        assert len(assets) == 4 and all(asset == assets[0] for asset in assets), f"{words}: the same labels and CT give different assets"
        code, _, report, asset = t.run(nifti, *words)
        assert code == 0 and not any("mean_hu" in s for s in report["slices"]) and "hu" not in report["input"], f"{words}: a mean without a CT"
    # Two programs may have rounded the positions of two segments' frames differently.
    apart = make_seg(labels)
    for frame in apart.PerFrameFunctionalGroupsSequence:
        if frame.SegmentIdentificationSequence[0].ReferencedSegmentNumber == 2:
            frame.PlanePositionSequence[0].ImagePositionPatient[2] += 0.0011
    made = [t.run(scan, "--labels", every, "--hu", ct_dicom) for scan in (seg, t.save(apart))]
    assert made[0][0] == made[1][0] == 0 and made[0][3] == made[1][3], f"frames apart by rounding: {made[1][1]}"
    # Each material has its own.
    code, lines, report, _ = t.run(nifti, "--labels", "all", "--hu", ct_nifti, "--min-region", "0")
    for n in NAMES:
        got = {s["index"]: s["mean_hu"] for s in report["slices"] if s.get("material") == f"label {n}"}
        assert got and same(list(got.values()), [m for m in means(labels, hu, [n]) if m is not None]), f"label {n}: {got}"
    # Filled pixels are material, too.
    ring = labels.copy()
    ring[[3, 7, 8], 12:16, 10:14] = 0
    code, lines, report, _ = t.run(t.nifti(ring), "--labels", "1", "--fill", "all", "--hu", ct_nifti)
    assert code == 0 and same([s.get("mean_hu") for s in report["slices"]], means(labels, hu, [1])), f"filled: {code} {lines}"


def test_grids(t):
    """The same grid within a thousandth of a voxel, or refused with what differs."""
    labels, hu = label_map(), hounsfield()
    ct, flat = t.nifti(hu, "ct.nii.gz"), t.nifti(hu[0:1], "flat.nii.gz")
    turn = 0.0009 * SPACING_V / (WIDTH * SPACING_U)
    near = (t.nifti(labels, origin=(ORIGIN[0] + 0.0009 * SPACING_U, ORIGIN[1], ORIGIN[2])),
            t.nifti(labels, origin=(ORIGIN[0], ORIGIN[1], ORIGIN[2] - 0.0009 * STEP)),
            t.nifti(labels, step=STEP * (1 + 0.0009 / SLICES)), t.nifti(labels, spacing=(SPACING_U * (1 + 0.0009 / WIDTH), SPACING_V)))
    for file in near:
        code, lines, _, _ = t.run(file, "--labels", "all", "--hu", ct)
        assert code == 0, f"within a thousandth of a voxel: {code} {lines}"
    far = (("origin is", t.nifti(labels, origin=(ORIGIN[0] + 0.0012 * SPACING_U, ORIGIN[1], ORIGIN[2]))),
           ("origin is", t.nifti(labels, origin=(ORIGIN[0], ORIGIN[1], ORIGIN[2] + 0.0012 * STEP))),
           ("mm apart", t.nifti(labels, step=STEP * 1.01)),
           ("origin is", t.nifti(labels, origin=(-ORIGIN[0], ORIGIN[1], ORIGIN[2]))),
           ("spacing is 0.75075 x 0.5 mm, not 0.75 x 0.5", t.nifti(labels, spacing=(SPACING_U * 1.001, SPACING_V))),
           ("orientation differs", t.nifti(labels, turn=20 * turn)),
           ("size is 36 x 29 x 11 voxels, not 37 x 29 x 11", t.nifti(labels[:, :, 1:])),
           ("size is 37 x 29 x 10 voxels", t.nifti(labels[1:])))
    for why, file in far:
        t.refused(file, "labels.nii.gz: is not on the grid of the CT ", why, "resampled", words=("--labels", "all", "--hu", ct))
    t.refused(t.nifti(labels), "size is", words=("--labels", "all", "--hu", flat))
    # A segmentation's frames lie on slices of the CT.
    seg = t.save(make_seg(labels))
    t.refused(seg, "seg.dcm frame ", "on no slice", "origin is", words=("--labels", "all", "--hu", t.ct(hu, slices=[k for k in range(SLICES) if k != 6])))
    t.refused(seg, "seg.dcm frame ", "on no slice", "origin is", words=("--labels", "all", "--hu", t.nifti(hu, origin=(0, 0, 5))))
    t.refused(seg, "37 x 29 pixels", "36 x 29", words=("--labels", "all", "--hu", t.nifti(hu[:, :, 1:])))
    code, lines, report, _ = t.run(seg, "--labels", "all", "--hu", t.ct(hu, slices=range(1, 10)))
    assert code == 0 and len({s["index"] for s in report["slices"]}) == 9, f"a shorter CT that has all frames: {code} {lines}"
    # Uneven slices: the CT's.
    uneven = [k for k in range(SLICES) if k != 5]
    code, lines, report, _ = t.run(seg, "--labels", "+".join(map(str, NAMES)), "--hu", t.ct(hu, slices=uneven))
    assert code == 0 and len(report["slices"]) == SLICES - 1 and "missing_slice" in codes(report), f"an uneven CT: {code} {lines}"
    expected = means(labels[uneven], hu[uneven], list(NAMES))
    assert same([s.get("mean_hu") for s in report["slices"]], expected), "an uneven CT: other means"


def test_no_ct(t):
    """What has no HU is refused, and what needs no CT."""
    labels = t.nifti(label_map())
    t.refused(labels, "nowhere.nii: no such file", words=("--labels", "all", "--hu", "nowhere.nii"))
    folder = t.ct()
    for file in folder.iterdir():
        file.write_bytes(file.read_bytes().replace(b"CS\x02\x00CT", b"CS\x02\x00MR"))
    t.refused(labels, "not HU (MR)", words=("--labels", "all", "--hu", folder))
    t.refused(labels, "not HU (MR)", words=("--labels", "all", "--hu", folder, "--any-modality"))
    picture = t.folder() / "ct.png"
    from PIL import Image
    Image.fromarray(np.zeros((HEIGHT, WIDTH), np.uint8)).save(picture)
    t.refused(labels, "ct.png: ", "not HU (images)", words=("--labels", "all", "--hu", picture))
    seg = t.save(make_seg(label_map()))
    t.refused(labels, "seg.dcm: ", "SEG", words=("--labels", "all", "--hu", seg))
    t.refused(labels, "--hu", "--labels", words=("--hu", labels), code=2)
    t.refused(labels, "--names", "--labels", words=("--names", "verse"), code=2)
    # Nothing that is read is written over.
    given = t.folder() / "names.json"
    given.write_text('{"1": "upper"}')
    done = subprocess.run([t.mesh, labels, "-o", t.work / "x.glb", "--labels", "1", "--names", given, "--report", given],
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False, timeout=60)
    assert done.returncode == 2 and given.read_text() == '{"1": "upper"}', f"over the names: {done}"


def test_names(t):
    """Names are in the report and in warnings: those of --names, else the segmentation's, else the label's number."""
    labels = label_map()
    nifti, seg = t.nifti(labels), t.save(make_seg(labels))
    file = t.folder() / "names.json"
    file.write_text('{"1": "upper", "9": "missing", "7": "Sacrum, künstlich"}', encoding="utf-8")
    numbers = {n: f"label {n}" for n in NAMES}
    for scan, words, expected, absent in ((nifti, (), numbers, "label 9"), (seg, (), NAMES, "label 9"),
                                          (nifti, ("--names", "verse"), {**numbers, 1: "C1", 2: "C2"}, "label 9 (T2)"),
                                          (nifti, ("--names", "totalsegmentator"), {**numbers, 1: "spleen", 2: "kidney_right"}, "label 9 (adrenal_gland_left)"),
                                          (seg, ("--names", file), {**NAMES, 1: "upper", 300: "label 300"}, "label 9 (missing)"),
                                          (nifti, ("--names", file), {**numbers, 1: "upper"}, "label 9 (missing)")):
        code, lines, report, _ = t.run(scan, "--labels", "1,2,9,300", *words)
        assert code == 0, f"{scan.name} {words}: exit {code} {lines}"
        assert report["labels"] == [{"label": n, "name": expected[n]} for n in sorted(NAMES)], f"{scan.name} {words}: {report['labels']}"
        where = [w["where"] for w in report["warnings"] if w["code"] == "label_absent"]
        assert where == [absent] and any(f"{absent}: not in" in line for line in lines), f"{scan.name} {words}: {where}"
    code, _, report, _ = t.run(nifti, "--labels", "2")
    assert code == 0 and report["labels"] == [{"label": 2, "name": "label 2"}], "only the labels that were wanted and found"
    t.refused(nifti, "the label 9 (missing) is not there", "the labels 1 (upper), 2, 300", words=("--labels", "9", "--names", file))
    t.refused(nifti, "nowhere.json: No such file", "verse", words=("--labels", "9", "--names", "nowhere.json"))
    bad = file.with_name("bad.json")
    bad.write_text('{"L1": 20}')
    t.refused(nifti, "bad.json: \"L1\": is no label", words=("--labels", "1", "--names", bad))
    code, lines, report, _ = t.run(t.nifti(hounsfield()), "--threshold", "300")
    assert code == 0 and "labels" not in report, f"a CT: {code} {lines}"
