# SPDX-License-Identifier: Apache-2.0
"""However a NIfTI file stores its voxels (type, shift, byte order, direction of the
axes), the meshes are the same."""
import shutil

import nibabel
import numpy

from programs import run


def write(path, values, affine, kind, intercept=0.0, slope=1.0):
    # (The file's bytes by hand: nibabel would choose the scale on its own.)
    kind = numpy.dtype(kind)
    header = nibabel.Nifti1Header(endianness=">" if kind.byteorder == ">" else "<")
    header.set_data_dtype(kind)
    header.set_data_shape(values.shape)
    header.set_sform(affine, code=1)
    header.set_xyzt_units("mm")
    header["magic"], header["vox_offset"] = b"n+1", 352
    header["scl_slope"], header["scl_inter"] = slope, intercept
    path.write_bytes(header.binaryblock + bytes(4) + ((values - intercept) / slope).astype(kind).tobytes(order="F"))


def flipped(values, affine, axis):
    turn = numpy.eye(4)
    turn[axis, axis], turn[axis, 3] = -1, values.shape[axis] - 1
    return numpy.flip(values, axis), affine @ turn


def test_nifti_storage(programs, scan, work):
    scan = nibabel.load(scan / "sample.nii.gz")
    values, affine = numpy.rint(scan.get_fdata())[:, :, 15:18], scan.affine.copy()
    right, back = flipped(values, affine, 0), flipped(values, affine, 1)
    files = {"int16": (values, affine, "<i2"), "shifted": (values, affine, "<i2", 7), "uint16": (values, affine, "<u2", -2000),
             "shifted far": (values, affine, "<i4", 3e6), "scaled": (values, affine, "<f4", 1, 0.5),
             "big-endian": (values, affine, ">i2", -100), "float": (values, affine, "<f4"), "flipped": (*right, "<i2"),
             "flipped, shifted": (*right, "<i2", -1024), "flipped, scaled": (*right, "<f4", 0, 2), "other rows": (*back, "<i2")}
    meshes = {}
    for name, content in files.items():
        write(work / "scan.nii", *content)
        run(programs / "trocar-mesh", work / "scan.nii", "-o", work / "asset.glb", "--quiet")
        run(programs / "trocar-mesh", "export", work / "asset.glb", "-o", work / "obj")
        objects = sorted((work / "obj").glob("*.obj"))
        assert len(objects) == 3, f"{name}: {len(objects)} slices"
        meshes[name] = [o.read_bytes() for o in objects]
        assert meshes[name] == meshes["int16"], f"{name}: other meshes"
        shutil.rmtree(work / "obj")
