# SPDX-License-Identifier: Apache-2.0
"""Real scans through trocar-mesh; each asset is verified by `trocar-mesh verify` and opened by three.js, and both must agree. It has few bytes a
triangle, and the same bytes with 1, 2 and 16 threads and from the programs of the folder TROCAR_OTHER_BIN, if there is one. The scans are
trocar-sample-ct's PNG, DICOM and NIfTI, the clinical CT of the folder TROCAR_REAL_CT and the head CT of the file TROCAR_HEAD_CT. A test is skipped
if its scan is not there, or three.js is not installed and TROCAR_REQUIRE_THREE is not set."""
import hashlib
import json
import os
import pathlib
import shutil

import pytest

from programs import HEAD_CT, L3_SCAN, REAL_CT, run

# Bytes a triangle of the complete file with and without HU; kB of the file with HU.
MOST = {"dicom": (13.0, 6.7, 70), "l3": (7.0, 5.2, 140), "head": (8.9, 4.5, 695)}


class Case:
    def __init__(self, source, programs, scan, work):
        self.mesh = programs / "trocar-mesh"
        self.scan, self.work = scan, work
        self.load = source / "tests" / "e2e" / "three" / "load.mjs"
        self.three = (source / "tests" / "e2e" / "three" / "node_modules" / "three").is_dir() and shutil.which("node")

    def skip_without_three(self):
        """At the end of a test, which has then been done in part."""
        if not self.three:
            assert not os.environ.get("TROCAR_REQUIRE_THREE"), "three.js is not installed"
            pytest.skip("three.js is not installed: `npm ci` in tests/e2e/three, or scripts/test, installs it")

    def build(self, name, *arguments):
        """Makes an asset from a scan; its report, `info` and three.js must agree. Returns the report and the asset."""
        asset, report = self.work / f"{name}.glb", self.work / f"{name}.json"
        run(self.mesh, *arguments, "-o", asset, "--report", report, "--quiet")
        run(self.mesh, "verify", "--independent", asset)
        info = json.loads(run(self.mesh, "info", asset, "--json").stdout)
        report = json.loads(report.read_text())
        assert report["asset"]["bytes"] == asset.stat().st_size, f"{name}: report's bytes"
        assert len(report["slices"]) == len(info["slices"]), f"{name}: slices of report and info"
        for told, held in zip(report["slices"], info["slices"]):
            for field in ("index", "vertices", "triangles"):
                assert told[field] == held[field], f"{name}: slice {held['index']}: {field}"
        if self.three:
            self.open_with_three(name, asset, info)
        triangles = sum(piece["triangles"] for piece in info["slices"])
        assert abs(report["asset"]["bytes_per_triangle"] - asset.stat().st_size / triangles) < 1e-9, f"{name}: {report['asset']}"
        if name in MOST:
            self.check_bytes(name, report["asset"], triangles, *arguments)
        self.check_same_bytes(asset, *arguments)
        return report, asset

    def check_bytes(self, name, told, triangles, *arguments):
        with_hu, without_hu, most_kb = MOST[name]
        bare = self.work / "bare.glb"
        run(self.mesh, *arguments, "--no-hu", "-o", bare, "--quiet")
        figures = told["bytes_per_triangle"], bare.stat().st_size / triangles, told["bytes"] / 1000
        print(f"{name}: {figures[0]:.2f} bytes a triangle, {figures[1]:.2f} without HU, {figures[2]:.1f} kB")
        assert all(figure <= most for figure, most in zip(figures, (with_hu, without_hu, most_kb))), f"{name}: {figures}"

    def check_same_bytes(self, asset, *arguments):
        makers = [(self.mesh, jobs) for jobs in (1, 2, 16)]
        if other := os.environ.get("TROCAR_OTHER_BIN"):
            makers.append((pathlib.Path(other) / "trocar-mesh", 2))
        again = self.work / "again.glb"
        for program, jobs in makers:
            run(program, *arguments, "-o", again, "--quiet", "--jobs", jobs)
            assert hashlib.sha256(again.read_bytes()).digest() == hashlib.sha256(asset.read_bytes()).digest(), f"{asset.name}: {program}, {jobs} threads"

    def open_with_three(self, name, asset, info):
        seen = json.loads(run("node", self.load, asset).stdout)
        drawn = {piece["index"]: piece for piece in seen["slices"]}
        for held in info["slices"]:
            piece = drawn.pop(held["index"], None)
            if piece is None:
                assert held["triangles"] == 0, f"{name}: three.js lacks slice {held['index']}"
                continue
            lines = piece["line_segments"] > 0
            for ours, theirs in (("vertices", "vertices"), ("triangles", "triangles"),
                                 ("outline_segments", "line_segments"))[:3 if lines else 2]:
                assert held[ours] == piece[theirs], f"{name}: slice {held['index']}: {ours} {held[ours]}, three.js sees {piece[theirs]}"
            if lines:
                assert piece["bounds"] == piece["lines_bounds"], f"{name}: slice {held['index']}: triangles and outline have different bounds"
        assert not drawn, f"{name}: three.js shows slices {sorted(drawn)} that info does not"
        low, high = seen["world_bounds_m"]["min"], seen["world_bounds_m"]["max"]
        assert all(0 < b - a < 1 for a, b in zip(low, high) if b != a), f"{name}: not in metres"


@pytest.fixture(name="case", scope="module")
def new_case(source, programs, scan, work):
    return Case(source, programs, scan, work)


def check_quality(name, report, min_angle_deg=30.0, unless_warned=False, springs=True):
    """Small angles occur only at small input angles; on a clinical scan also elsewhere, with a warning. Edges have positive
    stiffness, except where pixel chains leave an input angle of a few degrees and rounding to the lattice decides the sign."""
    warned = {k for w in report["warnings"] if w["code"] == "angle_not_reached" for k in w["slices"]}
    for piece in report["slices"]:
        excused = piece["triangles_below_min_angle_at_small_input_angle"]
        assert piece["triangles_below_min_angle_unexplained"] == 0, (f"{name}: slice {piece['index']}: {piece['triangles_below_min_angle_unexplained']} triangles "
              f"below {min_angle_deg} degrees where the input has no smaller angle")
        assert piece["negative_stiffness_edges"] == 0 or not springs, f"{name}: slice {piece['index']}: {piece['negative_stiffness_edges']} edges of negative stiffness"
        if unless_warned and piece["index"] in warned:
            continue
        assert piece["triangles_below_min_angle"] == excused, (f"{name}: slice {piece['index']}: {piece['triangles_below_min_angle']} triangles below "
              f"{min_angle_deg} degrees, {excused} of them at a small input angle")


def test_sample(case):
    scan = case.scan
    about = json.loads((scan / "sample.json").read_text())
    low, high = about["png_window_HU"]
    grey = (226 - low) / (high - low) * 255
    spacing = "0.3125,0.3125,1"
    reports = {}
    reports["dicom"], _ = case.build("dicom", scan / "dicom")
    reports["nifti"], _ = case.build("nifti", scan / "sample.nii.gz", "--lines")
    reports["png"], _ = case.build("png", scan / "png", "--spacing", spacing, "--threshold", f"{grey:.4f}")
    worst = 0.0
    for name, report in reports.items():
        assert len(report["slices"]) == 35, f"{name}: {len(report['slices'])} slices"
        check_quality(name, report)
        for ours, reference in zip(report["slices"], reports["dicom"]["slices"]):
            difference = abs(ours["area_mm2"] / reference["area_mm2"] - 1)
            worst = max(worst, difference)
            assert difference <= 0.005, f"{name}: slice {ours['index']}: area differs by {100 * difference:.2f} %"
    print(f"areas of PNG, DICOM and NIfTI differ by at most {100 * worst:.3f} %")

    paper, _ = case.build("paper", scan / "png", "--spacing", spacing, "--preset", "paper")
    assert len(paper["slices"]) == 35, f"paper: {len(paper['slices'])} slices"
    check_quality("paper", paper, springs=False)
    for piece in paper["slices"]:
        pixels = piece["max_area_mm2"] / 0.3125**2
        assert piece["triangles"] > 0, f"paper: slice {piece['index']} is empty"
        assert pixels <= 200 * (1 + 1e-9), f"paper: slice {piece['index']}: a triangle of {pixels:.1f} px^2"

    case.build("dicom_dp", scan / "dicom", "--simplify", "dp")
    case.skip_without_three()


def test_l3(case):
    if not L3_SCAN.is_file():
        pytest.skip("no clinical CT")
    report, _ = case.build("l3", L3_SCAN)
    check_quality("l3", report, unless_warned=True)
    labels, _ = case.build("l3_labels", REAL_CT / "sub-ct_seg-vert_label-22_msk.nii.gz", "--labels", "22")
    check_quality("l3_labels", labels, unless_warned=True)
    assert any(piece["triangles"] for piece in labels["slices"]), "l3_labels: no triangles"
    case.skip_without_three()


def test_head(case):
    if not HEAD_CT.is_file():
        pytest.skip("no head CT")
    report, _ = case.build("head", HEAD_CT)
    assert len(report["slices"]) == 108, f"head: {len(report['slices'])} slices, expected 108"
    case.build("head_dp", HEAD_CT, "--simplify", "dp")
    check_quality("head", report, unless_warned=True)
    case.skip_without_three()
