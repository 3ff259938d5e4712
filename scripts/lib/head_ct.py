# SPDX-License-Identifier: Apache-2.0
"""head_ct.py Cranium.inv3 OUT.nii.gz: an InVesalius project's voxels as NIfTI."""
# An .inv3 is a gzipped tar of main.plist (shape, type, spacing) and matrix.dat
# (int16 little-endian HU in z, y, x order). It is read in memory, and every size is
# checked before it is used.
# Orientation. InVesalius flips the rows of transverse DICOM images, so that its y runs
# from posterior to anterior (visible in the images: the head rest is at low y, the face
# at high y, the jaw at low z); its x is that of DICOM, towards the patient's left. Rows are
# flipped back here: array axes run towards L, P, S, as in a DICOM series, and the affine
# is diag(-sx, -sy, +sz) in the RAS frame of NIfTI. The project does not store the origin;
# it is set to the volume's centre.
# The same archive gives the same bytes. Exit: 3 refused, 4 not written.
import gzip
import io
import os
import pathlib
import plistlib
import sys
import tarfile
import tempfile

import nibabel
import numpy

MAX_ARCHIVE_BYTES = 256 << 20
MAX_PLIST_BYTES = 1 << 20
MAX_VOXELS = 512 * 512 * 2048


class Refused(Exception):
    """The input is not acceptable."""


def read_member(members, base, max_bytes):
    """The bytes of the only regular file named `base`. Refused if there are more than max_bytes."""
    if len(members.get(base, [])) != 1:
        raise Refused(f"holds {len(members.get(base, []))} files named {base}, expected one")
    info, stream = members[base][0]
    if info.size > max_bytes:
        raise Refused(f"{base} has {info.size} bytes, more than {max_bytes}")
    data = stream.read(max_bytes + 1)
    if len(data) != info.size:
        raise Refused(f"{base} is truncated")
    return data


def numbers(value, kind, count, low, high, what):
    if not isinstance(value, list) or len(value) != count:
        raise Refused(f"main.plist: {what} is not a list of {count} numbers")
    for number in value:
        if isinstance(number, bool) or not isinstance(number, kind) or not low <= number <= high:
            raise Refused(f"main.plist: {what} is outside {low}..{high}")
    return value


def read_project(path):
    """Voxels (int16, z y x order) and spacing (mm, x y z order) of an .inv3 file."""
    if path.stat().st_size > MAX_ARCHIVE_BYTES:
        raise Refused("is too large")
    with tarfile.open(path, "r:gz") as archive:
        members = {}
        for info in archive:
            if info.isreg():
                base = pathlib.PurePosixPath(info.name).name
                if base in ("main.plist", "matrix.dat"):
                    members.setdefault(base, []).append((info, archive.extractfile(info)))
        project = plistlib.loads(read_member(members, "main.plist", MAX_PLIST_BYTES),
                                 fmt=plistlib.FMT_XML)
        matrix = project.get("matrix")
        if not isinstance(matrix, dict) or matrix.get("dtype") != "int16":
            raise Refused("main.plist: matrix is not of type int16")
        shape = numbers(matrix.get("shape"), int, 3, 1, 65535, "matrix shape")
        spacing = numbers(project.get("spacing"), float, 3, 0.01, 100.0, "spacing")
        if project.get("orientation") != 1:
            raise Refused("main.plist: orientation is not 1 (transverse)")
        voxels = shape[0] * shape[1] * shape[2]
        if voxels > MAX_VOXELS:
            raise Refused(f"{voxels} voxels are too many")
        data = read_member(members, "matrix.dat", 2 * voxels)
        if len(data) != 2 * voxels:
            raise Refused(f"matrix.dat has {len(data)} bytes, its shape needs {2 * voxels}")
    return numpy.frombuffer(data, "<i2").reshape(shape), spacing


def to_nifti_bytes(voxels, spacing):
    array = numpy.ascontiguousarray(voxels[:, ::-1, :].transpose(2, 1, 0))
    affine = numpy.diag([-spacing[0], -spacing[1], spacing[2], 1.0])
    centre = (numpy.array(array.shape) - 1) / 2
    affine[:3, 3] = -affine[:3, :3] @ centre
    image = nibabel.Nifti1Image(array, affine)
    image.header.set_xyzt_units("mm")
    image.header.set_slope_inter(1, 0)
    image.set_qform(affine, code="scanner")
    image.set_sform(affine, code="scanner")
    image.header["descrip"] = b"head CT of Debian's invesalius-examples"
    packed = io.BytesIO()
    with gzip.GzipFile(filename="", mode="wb", compresslevel=6, fileobj=packed, mtime=0) as stream:
        stream.write(image.to_bytes())
    return packed.getvalue()


def write_whole(path, data):
    """Writes the complete file or none."""
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fchmod(stream.fileno(), 0o644)
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def main():
    source, output = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    try:
        voxels, spacing = read_project(source)
        data = to_nifti_bytes(voxels, spacing)
    except Refused as why:
        print(f"head-ct: {source}: {why}", file=sys.stderr)
        return 3
    except (tarfile.TarError, OSError, EOFError, ValueError, plistlib.InvalidFileException) as why:
        print(f"head-ct: {source}: not a readable InVesalius project: {why}", file=sys.stderr)
        return 3
    except Exception as why:  # errors of the plist parser (expat)
        print(f"head-ct: {source}: main.plist cannot be read: {why}", file=sys.stderr)
        return 3
    try:
        write_whole(output, data)
    except OSError as why:
        print(f"head-ct: {output}: cannot be written: {why.strerror}", file=sys.stderr)
        return 4
    return 0


if __name__ == "__main__":
    sys.exit(main())
