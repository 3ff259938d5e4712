# SPDX-License-Identifier: Apache-2.0
"""Files that trocar-mesh and trocar-run write, read without code of the project; and scans that are made here."""
import csv
import json
import struct

import jsonschema
import numpy as np
from programs import SOURCE


def rows_of(file):
    """The rows of a recording or another CSV, by column."""
    with open(file, encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def read_poly(file):
    """(points, n x 2, mm; indices of the segments' ends, m x 2) of a slice's .poly."""
    lines = [words for words in (line.split("#")[0].split() for line in file.read_text().splitlines()) if words]
    count = int(lines[0][0])
    points = np.array([line[1:3] for line in lines[1:1 + count]], float).reshape(-1, 2)
    place = {line[0]: i for i, line in enumerate(lines[1:1 + count])}
    segments = lines[2 + count:2 + count + int(lines[1 + count][0])]
    return points, np.array([[place[line[1]], place[line[2]]] for line in segments], int).reshape(-1, 2)


def read_rings(file):
    """The closed outlines of a slice's .poly, arrays n x 2, mm."""
    points, segments = read_poly(file)
    after, out = dict(segments.tolist()), []
    while after:
        ring = [next(iter(after))]
        while (at := after.pop(ring[-1])) != ring[0]:
            ring.append(at)
        out.append(points[ring])
    return out


def read_obj(file):
    """(vertices in patient coordinates, n x 3; triangles, m x 3) of an .obj."""
    lines = file.read_text().splitlines()
    vertices = [line.split()[1:4] for line in lines if line.startswith("v ")]
    triangles = [[word.split("/")[0] for word in line.split()[1:4]] for line in lines if line.startswith("f ")]
    return np.array(vertices, float).reshape(-1, 3), np.array(triangles, int).reshape(-1, 3) - 1


def schema_of(name):
    """The validator of formats/session/NAME.schema.json."""
    tree = json.loads((SOURCE / "formats/session" / f"{name}.schema.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(tree)
    del tree["$id"]  # python3-jsonschema 4.10 joins a relative one to itself
    return jsonschema.Draft202012Validator(tree)


def conforms(name, document, where=""):
    """Asserts that the document conforms to the schema of this name."""
    errors = [f"{error.json_path}: {error.message[:300]}" for error in schema_of(name).iter_errors(document)]
    assert not errors, f"{where or name}: {errors[:3]}"


def nifti(file, voxels, spacing):
    """Writes int16 voxels [z, y, x]."""
    z, y, x = voxels.shape
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, x, y, z, 1, 1, 1, 1)
    struct.pack_into("<2h", header, 70, 4, 16)
    struct.pack_into("<8f", header, 76, 1, *spacing, 0, 0, 0, 0)
    struct.pack_into("<3f", header, 108, 352, 1, 0)
    header[123] = 2
    struct.pack_into("<2h", header, 252, 0, 1)
    struct.pack_into("<12f", header, 280, spacing[0], 0, 0, 0, 0, spacing[1], 0, 0, 0, 0, spacing[2], 0)
    header[344:348] = b"n+1\0"
    file.write_bytes(bytes(header) + voxels.astype("<i2").tobytes())
    return file
