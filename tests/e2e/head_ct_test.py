# SPDX-License-Identifier: Apache-2.0
"""Scripts/lib/head_ct.py on synthetic InVesalius projects: all voxels of a valid
one are at their places, and each kind of invalid one is refused."""
import io
import plistlib
import subprocess
import sys
import tarfile

import nibabel
import numpy

SHAPE = (3, 4, 5)  # z, y, x
VOXELS = numpy.arange(60, dtype="<i2").reshape(SHAPE) - 30
VALID = {"matrix": {"dtype": "int16", "filename": "matrix.dat", "shape": list(SHAPE)},
         "spacing": [0.5, 0.75, 2.0], "orientation": 1}


def archive(path, plist, matrix, extra=()):
    with tarfile.open(path, "w:gz") as tar:
        for name, data in [("p/main.plist", plist), ("p/matrix.dat", matrix), *extra]:
            info = tarfile.TarInfo(name)
            info.size = len(data)
            tar.addfile(info, io.BytesIO(data))


def changed(**keys):
    return plistlib.dumps({**VALID, **keys})


def test_head_ct(source, tmp_path):
    convert = source / "scripts" / "lib" / "head_ct.py"

    def run(project, output):
        return subprocess.run([sys.executable, "-B", str(convert), str(project), str(output)],
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False)

    project, output = tmp_path / "x.inv3", tmp_path / "x.nii.gz"
    valid = plistlib.dumps(VALID)
    data = VOXELS.tobytes()

    archive(project, valid, data)
    done = run(project, output)
    assert done.returncode == 0, done.stderr
    first = output.read_bytes()
    assert run(project, output).returncode == 0 and output.read_bytes() == first, "bytes differ"
    image = nibabel.load(output)
    array = numpy.asarray(image.dataobj)
    assert array.dtype == numpy.int16 and nibabel.aff2axcodes(image.affine) == ("L", "P", "S")
    assert numpy.allclose(image.header.get_zooms(), VALID["spacing"])
    assert numpy.allclose(image.affine @ [2, 1.5, 1, 1], [0, 0, 0, 1]), "centre is not the origin"
    for z, y, x in numpy.ndindex(SHAPE):  # InVesalius's y runs from posterior to anterior
        assert array[x, SHAPE[1] - 1 - y, z] == VOXELS[z, y, x]
    assert run(project, tmp_path / "no" / "x.nii.gz").returncode == 4

    broken = {
        "no matrix": (valid, None, ()),
        "short matrix": (valid, data[:-2], ()),
        "long matrix": (valid, data + b"\0\0", ()),
        "two matrices": (valid, data, [("q/matrix.dat", data)]),
        "not a plist": (b"<plist>", data, ()),
        "a plist that is a list": (plistlib.dumps([1]), data, ()),
        "another type": (changed(matrix={**VALID["matrix"], "dtype": "uint8"}), data, ()),
        "negative shape": (changed(matrix={**VALID["matrix"], "shape": [-3, -4, 5]}), data, ()),
        "huge shape": (changed(matrix={**VALID["matrix"], "shape": [65535] * 3}), data, ()),
        "shape of words": (changed(matrix={**VALID["matrix"], "shape": ["3", "4", "5"]}), data, ()),
        "zero spacing": (changed(spacing=[0.0, 1.0, 1.0]), data, ()),
        "nan spacing": (changed(spacing=[float("nan"), 1.0, 1.0]), data, ()),
        "another orientation": (changed(orientation=2), data, ()),
    }
    output.unlink()
    for name, (plist, matrix, extra) in broken.items():
        if matrix is None:
            with tarfile.open(project, "w:gz") as tar:
                info = tarfile.TarInfo("p/main.plist")
                info.size = len(plist)
                tar.addfile(info, io.BytesIO(plist))
        else:
            archive(project, plist, matrix, extra)
        done = run(project, output)
        assert done.returncode == 3 and len(done.stderr.strip().splitlines()) == 1, f"{name}: exit {done.returncode}, stderr {done.stderr!r}"
        assert not output.exists(), name
    archive(project, valid, data)
    whole = project.read_bytes()
    for name, content in (("cut gzip", whole[: len(whole) // 2]), ("no gzip", b"no archive"), ("empty", b"")):
        project.write_bytes(content)
        assert run(project, output).returncode == 3 and not output.exists(), name
