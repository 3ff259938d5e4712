# SPDX-License-Identifier: Apache-2.0
"""The HU at the vertices of whole scans (--colour), as the report states it: SCAN is trocar-sample-ct's folder;
the vertebra of the folder TROCAR_REAL_CT and the head CT of the file TROCAR_HEAD_CT are taken where they are."""
import json

from programs import HEAD_CT, L3_SCAN, PROGRAMS, SCAN, WORK, run

FIELDS = {"hu_bias", "hu_rms", "hu_pixels"}
MOST_BIAS_HU = 5


def report_of(scan, *options, name="out"):
    asset, report = WORK / f"{name}.glb", WORK / f"{name}.json"
    run(PROGRAMS / "trocar-mesh", scan, "-o", asset, "--report", report, "--quiet", *(() if "--no-colour" in options else ("--colour",)),
        *(word for word in options if word != "--no-colour"))
    report = json.loads(report.read_text())
    for entry in report["slices"]:
        entry.pop("ms", None)  # of several materials only the first has it
    return report


def field(entry):
    return FIELDS & entry.keys()


def check_bias(name, scan, *options):
    slices = report_of(scan, *options, name=name)["slices"]
    for entry in slices:
        where = f"{name} {' '.join(options)}, slice {entry['index']}"
        assert field(entry) == FIELDS, f"{where}: {sorted(entry)}"
        if field(entry) != FIELDS:
            continue
        assert abs(entry["hu_bias"]) <= MOST_BIAS_HU, f"{where}: bias {entry['hu_bias']} HU"
        assert (entry["hu_pixels"] > 0) == (entry["area_mm2"] > 0), f"{where}: {entry['hu_pixels']} pixels"
        assert (entry["hu_rms"] > 0) == (entry["area_mm2"] > 0), f"{where}: rms {entry['hu_rms']} HU"


def test_hu_field():
    sample = SCAN / "sample.nii.gz"
    scans = {"sample": sample, "dicom": SCAN / "dicom",
             "L3": L3_SCAN,
             "head": HEAD_CT}
    for name, scan in scans.items():
        if scan.exists():
            check_bias(name, scan)
            check_bias(name, scan, "--simplify", "area", "--tolerance", "0.2")
        else:
            print(f"skipped: no {name}")
    check_bias("vertebra", sample, "--preset", "vertebra", "--slices", "15:17")
    check_bias("equalized", sample, "--equalize", "240", "--slices", "15:17")
    whole = report_of(sample, "--slices", "15:17")["slices"]
    crop = report_of(sample, "--slices", "15:17", "--crop", "60:470,40:480")["slices"]
    for a, b in zip(whole, crop):
        if a["area_mm2"] == b["area_mm2"]:
            assert all(abs(a.get(key, 0) - b.get(key, 1)) < 1e-6 for key in FIELDS), f"cropped: {a} {b}"
    assert any(a["area_mm2"] == b["area_mm2"] for a, b in zip(whole, crop)), "no slice is the same when cropped"

    # Graded: more triangles, a smaller error.
    graded = report_of(sample, "--slices", "15:17", "--grade", "200")["slices"]
    for a, b in zip(whole, graded):
        assert b["hu_rms"] < 0.8 * a["hu_rms"] and b["triangles"] > 1.5 * a["triangles"], f"graded: {a} {b}"
    one, two = (report_of(sample, "--jobs", jobs)["slices"] for jobs in ("1", "3"))
    assert one == two, "the field depends on the number of threads"
    assert b"_HU" in (WORK / "out.glb").read_bytes(), "the asset has no HU"

    for what, scan, options in (("plain", sample, ()), ("--no-hu", sample, ("--no-hu",)),
                                ("images", SCAN / "png", ("--spacing", "0.3125,0.3125,1", "--threshold", "150"))):
        report = report_of(scan, "--slices", "15:16", "--no-colour", *options)
        assert not any(field(entry) for entry in report["slices"]), f"{what}: has {FIELDS}"
        assert b"_HU" not in (WORK / "out.glb").read_bytes(), f"{what}: the asset has HU"
        assert ("hu" in report["parameters"]) == (what == "--no-hu"), f"{what}: {report['parameters']}"
    labels = scans["L3"].with_name("sub-ct_seg-vert_label-22_msk.nii.gz")
    if labels.exists():
        report = report_of(labels, "--no-colour", "--labels", "all")
        assert not any(field(entry) for entry in report["slices"]), "labels: have HU"
