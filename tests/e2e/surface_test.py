# SPDX-License-Identifier: Apache-2.0
"""The surface for display of a small sample scan and of the vertebra of the folder TROCAR_REAL_CT: exported files read by a reader of our own, by
admesh and by three.js, and closed. (Near the exact surface: display_surface_test, isosurface_test.)"""
import json
import re
import shutil
import subprocess

import nibabel
import numpy
from programs import L3_SCAN, PROGRAMS, SOURCE, WORK, run

MESH = PROGRAMS / "trocar-mesh"
THREE = SOURCE / "tests" / "e2e" / "three"
HAS_THREE = (THREE / "node_modules" / "three").is_dir() and shutil.which("node")
THRESHOLD = 226


def read_stl(file):
    """Corners of a binary STL's triangles, n x 3 x 3, and its stated normals."""
    data = file.read_bytes()
    count = int.from_bytes(data[80:84], "little")
    assert len(data) == 84 + 50 * count, f"{file}: {len(data)} bytes for {count} triangles"
    rows = numpy.frombuffer(data[84:], numpy.dtype([("xyz", "<f4", 12), ("attribute", "<u2")]), count)["xyz"]
    return rows[:, 3:].reshape(-1, 3, 3).astype(float), rows[:, :3]


def triangle_set(file):
    """The triangles of a binary STL, each from its least corner on."""
    out = set()
    for corners in read_stl(file)[0]:
        points = [tuple(p) for p in corners]
        k = points.index(min(points))
        out.add((*points[k:], *points[:k]))
    return out


def check_closed(name, corners, normals):
    """Each edge is passed once in each direction. Returns the volume."""
    vertices, index = numpy.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3)
    edges = numpy.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    codes = edges[:, 0] * len(vertices) + edges[:, 1]
    back = edges[:, 1] * len(vertices) + edges[:, 0]
    assert len(numpy.unique(codes)) == len(codes), f"{name}: an edge is passed twice in one direction"
    assert set(codes.tolist()) == set(back.tolist()), f"{name}: the surface is not closed"
    cross = numpy.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (numpy.einsum("ij,ij->i", cross, normals) > 0).all(), f"{name}: a normal of the STL points the other way"
    return numpy.einsum("ij,ij->i", corners[:, 0] - corners[0, 0], cross).sum() / 6


def check_admesh(name, file, triangles, parts, volume_mm3):
    """Debian's admesh reads the STL and finds nothing to mend."""
    text = run("admesh", file).stdout

    def values(words):
        return [float(word) for word in re.search(rf"{words}\s*:\s*(-?[\d.]+)(?:[ \t]+(\d+))?", text).groups() if word]

    assert values("Number of facets") == [triangles, triangles], f"{name}: admesh reads {text}"
    assert values("Number of parts") == [parts] and abs(values("Volume")[0] / volume_mm3 - 1) < 1e-4, f"{name}: admesh reads {text}"
    for words in ("Total disconnected facets", "Degenerate facets", "Edges fixed", "Facets removed", "Facets added", "Facets reversed",
                  "Backwards edges", "Normals fixed"):
        assert set(values(words)) == {0}, f"{name}: admesh finds {words}: {text}"


def check_three(name, asset, files, info):
    if not HAS_THREE:
        return
    seen = json.loads(run("node", THREE / "load.mjs", asset).stdout)
    assert [s["triangles"] for s in seen["surfaces"]] == [s["triangles"] for s in info["surfaces"]], f"{name}: three.js sees other surfaces than info"
    for file, one in zip(files, json.loads(run("node", THREE / "load_files.mjs", *files).stdout)):
        assert one["triangles"] == info["surfaces"][0]["triangles"], f"{file}: three.js reads {one['triangles']} triangles"
        assert one["normals"], f"{file}: without normals"


def check_scan(name, scan, triangles):
    asset, report = WORK / f"{name}.glb", WORK / f"{name}.json"
    run(MESH, scan, "-o", asset, "--surface", "--surface-triangles", triangles, "--report", report, "--quiet")
    again = WORK / "again.glb"
    run(MESH, scan, "-o", again, "--surface", "--surface-triangles", triangles, "--jobs", 1, "--quiet")
    assert asset.read_bytes() == again.read_bytes(), f"{name}: other bytes with one thread"
    run(MESH, "verify", "--independent", asset)
    info = json.loads(run(MESH, "info", asset, "--json").stdout)
    stated = json.loads(report.read_text())["surface"][0]
    print(f"{name}: {stated}")
    assert stated["triangles"] <= triangles, f"{name}: {stated['triangles']} triangles, wanted {triangles}"
    assert stated["distance_mm"]["p99"] <= stated["bound_mm"], f"{name}: states {stated['distance_mm']}"
    folder = WORK / f"{name}_files"
    subprocess.run(["rm", "-rf", str(folder)], check=True)
    run(MESH, "export", asset, "-o", folder, "--surface")
    files = [folder / f"surface{ending}" for ending in (".stl", ".ply", ".obj")]
    assert sorted(folder.iterdir()) == sorted(files), f"{name}: exported {sorted(folder.iterdir())}"
    corners, normals = read_stl(files[0])
    assert len(corners) == stated["triangles"], f"{name}: the STL has {len(corners)} triangles"
    assert re.search(rb"element face (\d+)", files[1].read_bytes())[1] == str(len(corners)).encode(), f"{name}: the PLY differs"
    assert files[2].read_text().count("\nf ") == len(corners), f"{name}: the OBJ differs"
    volume = check_closed(name, corners, normals)
    assert abs(volume / info["surfaces"][0]["volume_mm3"] - 1) < 1e-4, f"{name}: volume {volume}, info {info['surfaces']}"

    check_admesh(name, files[0], len(corners), stated["parts"], volume)
    check_three(name, asset, files, info)


def test_materials():
    """Each label has its surface: two halves of a ball, and a speck that is too small for one."""
    x, y, z = numpy.mgrid[:30, :30, :30]
    labels = numpy.where(numpy.sqrt((x - 14.5) ** 2 + (y - 14.5) ** 2 + (z - 14.5) ** 2) < 10, numpy.where(x < 15, 4, 7), 0)
    labels[1, 1:4, 1] = 9
    file, asset, report = WORK / "labels.nii.gz", WORK / "labels.glb", WORK / "labels.json"
    nibabel.save(nibabel.Nifti1Image(labels.astype(numpy.int16), numpy.eye(4)), file)
    run(MESH, file, "--labels", "4,7,9", "-o", asset, "--surface", "--report", report, "--quiet")
    run(MESH, "verify", "--independent", asset)
    told = json.loads(report.read_text())
    assert ([(s["material"], "triangles" in s, s["dropped"]["specks"]) for s in told["surface"]] ==
          [(0, True, 0), (1, True, 0), (2, False, 1)]), f"labels: {told['surface']}"
    absent = [w["where"] for w in told["warnings"] if w["code"] == "surface_absent"]
    assert len(absent) == 1 and "9" in absent[0], f"labels: {told['warnings']}"
    run(MESH, "export", asset, "-o", WORK / "labels_files", "--surface")
    several = run(MESH, file, "--labels", "4,7", "-o", WORK / "several.stl", "--quiet", expect=2).stderr
    assert "has 2 surfaces" in several and not (WORK / "several.stl").exists(), f"one file for two materials: {several}"
    files = sorted((WORK / "labels_files").glob("*.stl"))
    assert len(files) == 2, f"labels: exported {files}"
    for file, low, high in zip(files, (-15, -25), (-4, -14)):  # x of LPS, across the plane between the halves
        corners, normals = read_stl(file)
        volume = check_closed(file.name, corners, normals)
        assert abs(volume / (2 / 3 * numpy.pi * 1000) - 1) < 0.05, f"{file.name}: {volume} mm^3 of half a ball"
        assert low < corners[..., 0].min() < corners[..., 0].max() < high, f"{file.name}: x from {corners[..., 0].min()} to {corners[..., 0].max()}"


def test_surface():
    run(PROGRAMS / "trocar-sample-ct", WORK / "scan", "--size", "128", "--slices", "35")
    scan = WORK / "scan" / "sample.nii.gz"
    check_scan("sample", scan, 20000)
    if L3_SCAN.exists():
        check_scan("l3", L3_SCAN, 50000)
    else:
        print("no real scan: the vertebra is skipped")

    plain = WORK / "plain.glb"
    for words, most, wanted in (((), 50000, []), (("--surface-triangles", 200), 200, ["surface_distance", "surface_triangles"])):
        report = WORK / "limit.json"
        run(MESH, scan, "-o", plain, "--surface", *words, "--report", report, "--quiet")
        told = json.loads(report.read_text())
        warned = {w["code"]: w["sentence"] for w in told["warnings"] if w["code"].startswith("surface")}
        more = told["surface"][0]["triangles"] > most
        assert more == ("surface_triangles" in warned), f"{words}: {told['surface']}, warned {warned}"
        assert set(warned) <= set(wanted) and ("surface_distance" in warned) == ("surface_distance" in wanted), f"{words}: {warned}"
        assert not wanted or warned["surface_distance"].endswith("give more --surface-triangles"), f"{words}: warned {warned}"

    # The surface straight away is the asset's own.
    run(MESH, scan, "-o", plain, "--surface", "--quiet")
    run(MESH, "export", plain, "-o", WORK / "straight", "--surface")
    for ending in ("stl", "ply", "obj"):
        part, report = WORK / f"part.{ending}", WORK / "part.json"
        said = run(MESH, scan, "-o", part, "--report", report).stdout
        exported = WORK / "straight" / f"surface.{ending}"
        if ending == "stl":  # Draco has changed the order of the asset's triangles
            assert triangle_set(part) == triangle_set(exported), f"{part} differs from the export"
        elif ending == "ply":
            assert part.stat().st_size == exported.stat().st_size, f"{part} differs from the export"
        else:
            assert part.read_text().count("\nf ") == exported.read_text().count("\nf "), f"{part} differs from the export"
        told = json.loads(report.read_text())["surface"][0]
        assert told["file"] == part.name and f"{part}: a surface of {told['triangles']} triangles" in said, f"{part}: {told}, {said}"
