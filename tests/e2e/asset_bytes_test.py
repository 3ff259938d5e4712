# SPDX-License-Identifier: Apache-2.0
"""How large the whole files of three scans are at the defaults, with and without HU, and that
the report gives the file's own figure. SCAN is trocar-sample-ct's folder; the vertebra of the folder TROCAR_REAL_CT and the head CT
of the file TROCAR_HEAD_CT are taken where they are."""
import json
import struct

from programs import HEAD_CT, L3_SCAN, PROGRAMS, SCAN, WORK, run

# Bytes a triangle of the complete file with and without HU; kB of the file with HU.
MOST = {"sample": (13.0, 6.7, 70), "l3": (7.0, 5.2, 140), "head": (8.9, 4.5, 695)}


def triangles_of(glb):
    """Of all slices, from the JSON."""
    document = json.loads(glb[20:20 + struct.unpack_from("<I", glb, 12)[0]])
    corners = [document["accessors"][primitive["indices"]]["count"]
               for mesh in document["meshes"] for primitive in mesh["primitives"]]
    return sum(corners) // 3


def bytes_per_triangle(name, scan, *options):
    asset, report = WORK / f"{name}.glb", WORK / f"{name}.json"
    run(PROGRAMS / "trocar-mesh", scan, "-o", asset, "--report", report, "--quiet", *options)
    glb = asset.read_bytes()
    figure = len(glb) / triangles_of(glb)
    told = json.loads(report.read_text())["asset"]
    assert told["bytes"] == len(glb) and abs(told["bytes_per_triangle"] - figure) < 1e-9, f"{name}: the report says {told}"
    return figure, len(glb)


def test_asset_bytes():
    scans = {"sample": SCAN / "dicom",
             "l3": L3_SCAN,
             "head": HEAD_CT}
    for name, scan in scans.items():
        if not scan.exists():
            print(f"skipped: no {name}")
            continue
        with_hu, without_hu, most_kb = MOST[name]
        figure, size = bytes_per_triangle(name, scan)
        bare, _ = bytes_per_triangle(f"{name}_no_hu", scan, "--no-hu")
        print(f"{name}: {figure:.2f} bytes a triangle, {bare:.2f} without HU, {size} bytes")
        assert figure <= with_hu, f"{name}: {figure:.3f} bytes a triangle, wanted {with_hu}"
        assert bare <= without_hu, f"{name}: {bare:.3f} bytes a triangle without HU, wanted {without_hu}"
        assert size <= 1000 * most_kb, f"{name}: {size} bytes, wanted {most_kb} kB"
