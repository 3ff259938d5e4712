# SPDX-License-Identifier: Apache-2.0
"""A DICOM scan with its identifying attributes (PS3.15, table E.1-1) filled, each with a
text, date, time or UID of its own. None of them is in the asset or the report, byte by byte; another scan that differs in these
attributes only gives the same asset. A digest of the input is stored with a key only. A threshold that meshes a face is warned of."""
import json
import re
import shutil
import subprocess

import pytest
from programs import SOURCE, run

pydicom = pytest.importorskip("pydicom")
from pydicom.datadict import dictionary_VR  # noqa: E402

# Table E.1-1 without private and overlay data, sequences, and what pydicom does not know.
IDENTIFYING = (SOURCE / "tests/e2e/identifying_attributes.txt").read_text(encoding="ascii").split()

FORMS = {
    "DA": lambda n: f"{1800 + n // 12:04}{1 + n % 12:02}17", "TM": lambda n: f"{n // 60:02}{n % 60:02}37.{7000 + n}",
    "DT": lambda n: f"{1800 + n // 12:04}{1 + n % 12:02}19{n // 60:02}{n % 60:02}41", "UI": lambda n: f"1.2.826.0.1.3680043.10.7731.{9000 + n}.5",
    "AS": lambda n: f"{n % 1000:03}M", "PN": lambda n: f"Qv{n:03}Doe^Jane", "AE": lambda n: f"QVAE{n:03}X", "SH": lambda n: f"Qv{n:03}sh", "CS": lambda n: f"QV{n:03}CS",
}
TEXTS = {"LO", "ST", "LT", "UT", "UC"}


def fill(source, target, first):
    """The scan with every attribute set to a value of its own; gives all values."""
    target.mkdir()
    values = {}
    for number, name in enumerate(IDENTIFYING, first):
        try:
            vr = dictionary_VR(name)
        except (KeyError, ValueError):
            continue
        if vr in FORMS:
            values[name] = FORMS[vr](number)
        elif vr in TEXTS:
            values[name] = f"Qv{number:03} Text Of {name}"[:60]
    for k, file in enumerate(sorted(source.iterdir())):
        ds = pydicom.dcmread(file)
        for name, value in values.items():
            setattr(ds, name, value)
        ds.SOPInstanceUID = ds.file_meta.MediaStorageSOPInstanceUID = f"{values['SOPInstanceUID']}.{k}"
        ds.save_as(target / f"{k}.dcm")
    return values


def test_private_assets(programs, work):
    mesh = programs / "trocar-mesh"
    subprocess.run([programs / "trocar-sample-ct", work / "scan", "--size", "96", "--slices", "5", "--quiet"], check=True)
    first = fill(work / "scan" / "dicom", work / "a", 1)
    second = fill(work / "scan" / "dicom", work / "b", 301)
    assert len(first) > 120, f"only {len(first)} attributes"

    def made(scan, *options):
        out, report = work / f"{scan.name}.glb", work / f"{scan.name}.json"
        said = run(mesh, scan, "-o", out, "--report", report, *options).stderr
        return out, out.read_bytes(), report.read_bytes(), said

    file, asset, report, said = made(work / "a", "--series", first["SeriesInstanceUID"])
    for name, value in first.items():
        token = value.split("^")[0].encode()
        if len(token) < 5:
            continue
        for what, data in (("asset", asset), ("report", report)):
            assert token not in data, f"{name} {value!r} is in the {what}"
    assert said == "", f"warnings: {said}"
    assert made(work / "b")[1] == asset, "other headers give another asset"
    assert made(work / "scan" / "dicom")[1] == asset, "the scan as it was gives another asset"
    done = run(mesh, "verify", "--private", file)
    assert done.stdout.strip().endswith("valid, 5 slices, private"), done.stdout
    assert json.loads(run(mesh, "verify", "--private", "--json", file).stdout)["private"] is True, "--json"

    # Of two series, the warning says which was taken, on the screen by name and in the report by number.
    both = work / "both"
    both.mkdir()
    for folder in ("a", "b"):
        shutil.copytree(work / folder, both / folder)
    out, said_of_both = work / "both.glb", run(mesh, both, "-o", work / "both.glb", "--report", work / "both.json").stderr
    assert "(other_series)" in said_of_both and first["SeriesDescription"] in said_of_both, said_of_both
    sentence = next(w["sentence"] for w in json.loads((work / "both.json").read_bytes())["warnings"] if w["code"] == "other_series")
    assert " was taken (" in sentence and re.search(r"left out: \S+ .*\(CT, 5 files\)", sentence), sentence
    for name, value in (*first.items(), *second.items()):
        token = value.split("^")[0].encode()
        assert len(token) < 5 or token not in out.read_bytes() + (work / "both.json").read_bytes(), f"{name} {value!r} of two series"

    # A digest is of the key and the input, and only on request.
    assert b"digest" not in asset and "key_digest" not in json.loads(report)["input"], "a digest without a key"
    digests = set()
    for scan, key in ((work / "a", bytes(16)), (work / "a", bytes(64)), (work / "b", bytes(16))):
        (work / "key").write_bytes(key)
        file, keyed, report, _ = made(scan, "--input-key", work / "key")
        digest = json.loads(report)["input"]["key_digest"]
        assert len(digest) == 64 and digest.encode() in keyed, f"{digest}"
        digests.add(digest)
        run(mesh, "verify", "--private", file)
    assert len(digests) == 3, f"{digests}"
    for size, code in ((15, 2), (65, 3), (0, 2)):
        (work / "key").write_bytes(bytes(size))
        run(mesh, work / "a", "-o", work / "no.glb", "--input-key", work / "key", expect=code)

    # A face is made of what is below 100 HU.
    for words, expected in ((("--threshold", "99"), True), (("--preset", "skin"), True), (("--threshold", "100"), False), ((), False)):
        _, _, report, said = made(work / "a", *words)
        codes = [w["code"] for w in json.loads(report)["warnings"]]
        assert ("face" in codes) == ("(face)" in said) == expected, f"{words}: {codes} {said}"
