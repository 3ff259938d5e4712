# SPDX-License-Identifier: Apache-2.0
"""assets_e2e_test.py CASE SOURCE BIN SCAN WORK: real scans through trocar-mesh; each asset is
verified by `trocar-mesh verify` and opened by three.js; both must agree.

CASE: sample (trocar-sample-ct's folder SCAN: PNG, DICOM, NIfTI; and the paper's preset),
      l3     (the clinical CT of the folder TROCAR_REAL_CT),
      head   (the head CT of the file TROCAR_HEAD_CT).
Exit 77 (skipped) if the scan is not there, or three.js is not installed and
TROCAR_REQUIRE_THREE is not set.
"""
import json
import os
import pathlib
import shutil
import sys

from e2e import check, failures, run

SKIPPED = 77


class Case:
    def __init__(self, source, programs, scan, work):
        self.mesh = programs / "trocar-mesh"
        self.scan, self.work = scan, work
        self.load = source / "tests" / "e2e" / "three" / "load.mjs"
        self.three = (source / "tests" / "e2e" / "three" / "node_modules" / "three").is_dir() and shutil.which("node")

    def build(self, name, *arguments):
        """Makes an asset from a scan; its report, `info` and three.js must agree. Returns the report and the asset."""
        asset, report = self.work / f"{name}.glb", self.work / f"{name}.json"
        run(self.mesh, *arguments, "-o", asset, "--report", report, "--quiet")
        run(self.mesh, "verify", "--independent", asset)
        info = json.loads(run(self.mesh, "info", asset, "--json").stdout)
        report = json.loads(report.read_text())
        check(report["asset"]["bytes"] == asset.stat().st_size, f"{name}: report's bytes")
        check(len(report["slices"]) == len(info["slices"]), f"{name}: slices of report and info")
        for told, held in zip(report["slices"], info["slices"]):
            for field in ("index", "vertices", "triangles"):
                check(told[field] == held[field], f"{name}: slice {held['index']}: {field}")
        if self.three:
            self.open_with_three(name, asset, info)
        print(f"{name}: {len(report['slices'])} slices, "
              f"{sum(s['triangles'] for s in report['slices'])} triangles, {asset.stat().st_size} bytes")
        return report, asset

    def open_with_three(self, name, asset, info):
        seen = json.loads(run("node", self.load, asset).stdout)
        drawn = {piece["index"]: piece for piece in seen["slices"]}
        for held in info["slices"]:
            piece = drawn.pop(held["index"], None)
            if piece is None:
                check(held["triangles"] == 0, f"{name}: three.js lacks slice {held['index']}")
                continue
            lines = piece["line_segments"] > 0
            for ours, theirs in (("vertices", "vertices"), ("triangles", "triangles"),
                                 ("outline_segments", "line_segments"))[:3 if lines else 2]:
                check(held[ours] == piece[theirs],
                      f"{name}: slice {held['index']}: {ours} {held[ours]}, three.js sees {piece[theirs]}")
            if lines:
                check(piece["bounds"] == piece["lines_bounds"],
                      f"{name}: slice {held['index']}: triangles and outline have different bounds")
        check(not drawn, f"{name}: three.js shows slices {sorted(drawn)} that info does not")
        low, high = seen["world_bounds_m"]["min"], seen["world_bounds_m"]["max"]
        check(all(0 < b - a < 1 for a, b in zip(low, high) if b != a), f"{name}: not in metres")

    def check_damage_is_noticed(self, asset):
        """The checks above can fail: verify and three.js refuse a broken file."""
        data = bytearray(asset.read_bytes())
        cut = self.work / "cut.glb"
        cut.write_bytes(data[: len(data) * 2 // 3])
        at = data.find(b"DRACO")
        check(at > 0, "no Draco payload found")
        data[at + 12:at + 28] = b"\xff" * 16
        broken = self.work / "broken.glb"
        broken.write_bytes(data)
        for file in (cut, broken, self.work / "absent.glb"):
            done = run(self.mesh, "verify", file, expect=3)
            check(len(done.stderr.strip().splitlines()) == 1, f"{file.name}: not one line: {done.stderr!r}")
            check(file.name in done.stderr, f"{file.name}: is not named in {done.stderr!r}")
            if self.three:
                run("node", self.load, file, expect=1)


def check_quality(name, report, min_angle_deg=30.0, unless_warned=False, springs=True):
    """Small angles occur only at small input angles; on a clinical scan also elsewhere, with a warning. Edges have positive
    stiffness, except where pixel chains leave an input angle of a few degrees and rounding to the lattice decides the sign."""
    warned = {k for w in report["warnings"] if w["code"] == "angle_not_reached" for k in w["slices"]}
    for piece in report["slices"]:
        excused = piece["triangles_below_min_angle_at_small_input_angle"]
        check(piece["triangles_below_min_angle_unexplained"] == 0,
              f"{name}: slice {piece['index']}: {piece['triangles_below_min_angle_unexplained']} triangles "
              f"below {min_angle_deg} degrees where the input has no smaller angle")
        check(piece["negative_stiffness_edges"] == 0 or not springs,
              f"{name}: slice {piece['index']}: {piece['negative_stiffness_edges']} edges of negative stiffness")
        if unless_warned and piece["index"] in warned:
            continue
        check(piece["triangles_below_min_angle"] == excused,
              f"{name}: slice {piece['index']}: {piece['triangles_below_min_angle']} triangles below "
              f"{min_angle_deg} degrees, {excused} of them at a small input angle")


def sample(case):
    scan = case.scan
    about = json.loads((scan / "sample.json").read_text())
    low, high = about["png_window_HU"]
    grey = (226 - low) / (high - low) * 255
    spacing = "0.3125,0.3125,1"
    reports = {}
    reports["dicom"], asset = case.build("dicom", scan / "dicom")
    reports["nifti"], _ = case.build("nifti", scan / "sample.nii.gz", "--lines")
    reports["png"], _ = case.build("png", scan / "png", "--spacing", spacing, "--threshold", f"{grey:.4f}")
    worst = 0.0
    for name, report in reports.items():
        check(len(report["slices"]) == 35, f"{name}: {len(report['slices'])} slices")
        check_quality(name, report)
        for ours, reference in zip(report["slices"], reports["dicom"]["slices"]):
            difference = abs(ours["area_mm2"] / reference["area_mm2"] - 1)
            worst = max(worst, difference)
            check(difference <= 0.005, f"{name}: slice {ours['index']}: area differs by {100 * difference:.2f} %")
    print(f"areas of PNG, DICOM and NIfTI differ by at most {100 * worst:.3f} %")

    paper, _ = case.build("paper", scan / "png", "--spacing", spacing, "--preset", "paper")
    check(len(paper["slices"]) == 35, f"paper: {len(paper['slices'])} slices")
    check_quality("paper", paper, springs=False)
    for piece in paper["slices"]:
        pixels = piece["max_area_mm2"] / 0.3125**2
        check(piece["triangles"] > 0, f"paper: slice {piece['index']} is empty")
        check(pixels <= 200 * (1 + 1e-9), f"paper: slice {piece['index']}: a triangle of {pixels:.1f} px^2")

    # The same input gives the same bytes for any number of threads.
    for jobs in (1, 3):
        again = case.work / f"jobs{jobs}.glb"
        run(case.mesh, scan / "dicom", "-o", again, "--jobs", jobs, "--quiet")
        check(again.read_bytes() == asset.read_bytes(), f"--jobs {jobs} gives other bytes")
    case.check_damage_is_noticed(asset)


def l3(case):
    folder = pathlib.Path(os.environ.get("TROCAR_REAL_CT", "")) / "l3"
    if not os.environ.get("TROCAR_REAL_CT") or not folder.is_dir():
        return SKIPPED
    report, _ = case.build("l3", folder / "sub-ct_label-22_ct.nii.gz", "--threshold", "226")
    check_quality("l3", report, unless_warned=True)
    labels, _ = case.build("l3_labels", folder / "sub-ct_seg-vert_label-22_msk.nii.gz", "--labels", "22")
    check_quality("l3_labels", labels, unless_warned=True)
    check(any(piece["triangles"] for piece in labels["slices"]), "l3_labels: no triangles")
    return 0


def head(case):
    scan = pathlib.Path(os.environ.get("TROCAR_HEAD_CT", "absent"))
    if not scan.is_file():
        return SKIPPED
    report, _ = case.build("head", scan)
    check(len(report["slices"]) == 108, f"head: {len(report['slices'])} slices, expected 108")
    check_quality("head", report, unless_warned=True)
    return 0


def main():
    if len(sys.argv) != 6 or sys.argv[1] not in ("sample", "l3", "head"):
        print("usage: assets_e2e_test.py sample|l3|head SOURCE BIN SCAN WORK", file=sys.stderr)
        return 2
    source, programs, scan, work = map(pathlib.Path, sys.argv[2:])
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    case = Case(source, programs, scan, work)
    if not case.three:
        print("three.js is not installed: `npm ci` in tests/e2e/three, or scripts/test, installs it")
        if os.environ.get("TROCAR_REQUIRE_THREE"):
            return 1
    code = globals()[sys.argv[1]](case) or 0
    for line in failures:
        print(line)
    if failures:
        return 1
    if code == 0 and not case.three:
        return SKIPPED
    return code


if __name__ == "__main__":
    sys.exit(main())
