# SPDX-License-Identifier: Apache-2.0
"""Solid bone from real scans: the vertebra of the folder TROCAR_REAL_CT against an expert's labels,
and the head CT of the file TROCAR_HEAD_CT, whose brain, sinuses and canal must stay open."""
import subprocess

import nibabel
import numpy
import pytest
from exported import read_obj
from programs import HEAD_CT, L3_SCAN, REAL_CT, PROGRAMS, WORK, run

MESH = PROGRAMS / "trocar-mesh"
VERTEBRA = ("--preset", "vertebra")
SLICES = range(18, 32)  # transverse, from the feet up: the third lumbar vertebra and the discs beside it


def canonical(file):
    image = nibabel.as_closest_canonical(nibabel.load(file))
    return numpy.asarray(image.dataobj), image.affine


def covered(file, affine, shape):
    """Which voxels' centres of a transverse slice (right, front) lie in a triangle."""
    vertices, corners = read_obj(file)
    i = (-vertices[:, 0] - affine[0, 3]) / affine[0, 0]
    j = (-vertices[:, 1] - affine[1, 3]) / affine[1, 1]
    out = numpy.zeros(shape, bool)
    for triangle in corners:
        a, b = i[triangle], j[triangle]
        columns = numpy.arange(int(numpy.ceil(a.min() - 1e-9)), int(numpy.floor(a.max() + 1e-9)) + 1)
        rows = numpy.arange(int(numpy.ceil(b.min() - 1e-9)), int(numpy.floor(b.max() + 1e-9)) + 1)
        x, y = numpy.meshgrid(columns, rows, indexing="ij")
        sides = [(a[k - 2] - a[k]) * (y - b[k]) - (b[k - 2] - b[k]) * (x - a[k]) for k in range(3)]
        inside = numpy.all([s >= 0 for s in sides], 0) | numpy.all([s <= 0 for s in sides], 0)
        out[x[inside], y[inside]] = True
    return out


def meshed(scan, *options):
    """The exported slices of a scan, by index."""
    asset, folder = WORK / "solid.glb", WORK / "slices"
    subprocess.run(["rm", "-rf", str(folder)], check=True)
    run(MESH, scan, "-o", asset, "--quiet", *options)
    run(MESH, "export", asset, "-o", folder)
    return {int("".join(c for c in file.stem if c.isdigit())): file for file in folder.glob("*.obj")}


def dice(scan, bone, affine, *options, step=1):
    """Dice coefficients of the material and the labels in SLICES."""
    files = meshed(scan, *options)
    out = []
    for k in SLICES:
        if k % step:
            continue
        material = covered(files[k // step], affine, bone.shape[:2])
        out.append(2 * (material & bone[:, :, k]).sum() / (material.sum() + bone[:, :, k].sum()))
    return numpy.array(out)


def expect_dice(what, values, mean, least=0.0):
    print(f"{what}: Dice mean {values.mean():.3f}, least {values.min():.3f}")
    assert values.mean() >= mean, f"{what}: mean {values.mean():.3f} below {mean}"
    assert values.min() >= least, f"{what}: least {values.min():.3f} below {least}"


def changed(values, affine, step=1):
    """A scan with other values, of every `step`-th slice."""
    file = WORK / "changed.nii.gz"
    other = affine.copy()
    other[:, 2] *= step
    nibabel.save(nibabel.Nifti1Image(values[:, :, ::step].astype(numpy.int16), other), file)
    return file


def body_seed(labels, affine, label):
    """The middle of the front of a vertebra: its body, as a user would click it."""
    voxels = numpy.argwhere(labels == label)
    front = voxels[voxels[:, 1] > voxels[:, 1].max() - 18]
    right, forward, up, _ = affine @ [*front.mean(0), 1]
    return f"--seed={-right:g},{-forward:g},{up:g}"


def test_vertebra():
    scan, label_file = L3_SCAN, REAL_CT / "sub-ct_seg-vert_label-22_msk.nii.gz"
    if not scan.is_file():
        pytest.skip("no clinical CT")
    values, affine = canonical(scan)
    labels = canonical(label_file)[0].astype(int)
    bone = numpy.isin(labels, (21, 22, 23))
    expect_dice("vertebra", dice(scan, bone, affine, *VERTEBRA), 0.92, 0.90)
    noise = numpy.random.default_rng(1).normal(0, 50, values.shape)
    for what, other, step in (("noise of 50 HU", values + noise, 1), ("HU x 0.9", values * 0.9, 1), ("every second slice", values, 2)):
        expect_dice(what, dice(changed(other, affine, step), bone, affine, *VERTEBRA, step=step), 0.90)
    assert dice(scan, bone, affine).mean() < 0.5, "the threshold alone is no solid bone: this test would see nothing"

    third = labels == 22
    seeds = [body_seed(labels, affine, label) for label in (22, 21, 23)]
    expect_dice("the third of three seeds", dice(scan, third, affine, *VERTEBRA, *seeds), 0.91)
    expect_dice("within the mask of its label", dice(scan, third, affine, *VERTEBRA, "--mask", f"{label_file}:22"), 0.90)


def test_head():
    """Points inside of cavities and soft tissue, which must stay open, and of marrow, each with the range of its HU."""
    if not HEAD_CT.is_file():
        pytest.skip("no head CT")
    values, affine = canonical(HEAD_CT)
    files = meshed(HEAD_CT, *VERTEBRA)
    places = (("brain", (125, 100, 56), (0, 100), False), ("brain stem", (125, 100, 28), (-20, 100), False),
              ("canal", (125, 95, 4), (-20, 120), False), ("frontal sinus", (125, 203, 56), (-1100, -700), False),
              ("ethmoid cells", (124, 163, 40), (-1100, -700), False),
              ("mastoid cells", (68, 118, 20), (-1100, -400), False), ("skull", (125, 28, 56), (226, 3000), True))
    for what, (i, j, k), (low, high), solid in places:
        assert low <= values[i, j, k] <= high, f"{what}: {values[i, j, k]} HU is not {low} to {high}: another place"
        is_material = bool(covered(files[k], affine, values.shape[:2])[i, j])
        assert is_material == solid, f"{what} at {i}, {j}, {k} is {'filled' if is_material else 'open'}"
    brain = values[60:190, 40:190, 60]
    open_share = 1 - covered(files[60], affine, values.shape[:2])[60:190, 40:190][brain < 100].mean()
    assert open_share > 0.999, f"{open_share:.4f} of the soft tissue in slice 60 is open"
