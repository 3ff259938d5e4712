# SPDX-License-Identifier: Apache-2.0
"""DICOM that is not CT is refused by its name, with what to do; with --any-modality it is meshed, and
the report and the asset say that its values are not HU. pydicom writes the files."""

import nibabel
import numpy as np
from mesh_runs import MeshRuns

from dicom_variants_test import COLUMNS, CT, ENHANCED_CT, ROWS, make_slice  # skipped without pydicom

import pytest

MR, PT = "1.2.840.10008.5.1.4.1.1.4", "1.2.840.10008.5.1.4.1.1.128"
ENHANCED_MR, CAPTURE = "1.2.840.10008.5.1.4.1.1.4.1", "1.2.840.10008.5.1.4.1.1.7"
AXIAL = ["ORIGINAL", "PRIMARY", "AXIAL"]
SLICES = 3


def series(folder, uid="1.2.3.4", names="slice", count=SLICES, first=0, value=500, **keys):
    """Slices with a block of the value in -1000 (in 0 where `value` is below 400). A key with None is left out."""
    for k in range(first, first + count):
        ds = make_slice(k)
        block = np.full((ROWS, COLUMNS), -1000 if value >= 400 else 0, "<i2")
        block[10:30, 10:40] = value
        ds.PixelData, ds.SeriesInstanceUID = block.tobytes(), uid
        ds.SOPInstanceUID = ds.file_meta.MediaStorageSOPInstanceUID = f"{uid}.{k}"
        for key, what in keys.items():
            if what is None:
                delattr(ds, key)
            else:
                setattr(ds, key, what)
        ds.file_meta.MediaStorageSOPClassUID = ds.get("SOPClassUID", CT)
        ds.save_as(folder / f"{names}{k}.dcm", write_like_original=False)
    return folder


@pytest.fixture(name="t", scope="module")
def dry_run(programs, work):
    return MeshRuns(programs, work)


def test_other_modalities(t):
    """Each is refused by its name; with --any-modality it is meshed and its values are not HU."""
    for name, keys, said in (
            ("MR", {"Modality": "MR", "SOPClassUID": MR}, "MR (magnetic resonance)"),
            ("PT", {"Modality": "PT", "SOPClassUID": PT}, "PT (positron emission tomography)"),
            ("NM", {"Modality": "NM"}, "NM (nuclear medicine)"),
            ("XYZ", {"Modality": "XYZ"}, "XYZ"),
            ("MR", {"Modality": None, "SOPClassUID": MR}, "MR (magnetic resonance)"),
            ("MR", {"Modality": "", "SOPClassUID": ENHANCED_MR}, "MR (magnetic resonance)"),
            ("MR MOSAIC", {"Modality": "MR", "SOPClassUID": MR, "ImageType": ["ORIGINAL", "PRIMARY", "M", "ND", "MOSAIC"]}, "MOSAIC"),
            ("CT MOSAIC", {"ImageType": ["DERIVED", "SECONDARY", "MOSAIC"]}, "MOSAIC"),
            ("CT SECONDARY CAPTURE", {"SOPClassUID": "1.2.840.10008.5.1.4.1.1.7", "RescaleIntercept": None}, "a picture of a screen"),
            ("CT SECONDARY CAPTURE", {"ImageType": ["DERIVED", "SECONDARY", "SCREEN SAVE"]}, "a picture of a screen"),
            ("CT ED", {"RescaleType": "ED"}, "RescaleType ED"),
            ("CT LOCALIZER", {"ImageType": ["ORIGINAL", "PRIMARY", "LOCALIZER"]}, "LOCALIZER"),
            ("CT REF_SURVIEW", {"ImageType": ["DERIVED", "SECONDARY", "REF_SURVIEW"]}, "REF_SURVIEW"),
            ("MR LOCALIZER", {"Modality": "MR", "ImageType": ["ORIGINAL", "PRIMARY", "LOCALIZER"]}, "LOCALIZER")):
        folder = series(t.folder(), value=300, **keys)
        t.refused(folder, "slice0.dcm: ", said, "not HU", "--any-modality")
        t.refused(folder, said, "--any-modality", words=("--series", "1.2.3.4"))
        t.refused(folder / "slice1.dcm", "slice1.dcm: ", said, "--any-modality")
        for words in ((), ("--series", "1.2.3.4"), ("--threshold", "100")):
            code, lines, report, asset, _ = t.run(folder, "--any-modality", *words)
            assert code == 0, f"{name} {words}: exit {code}, {lines}"
            warned = [w for w in report["warnings"] if w["code"] == "not_hu"]
            shared = "OT" if name == "XYZ" else name  # a modality that DICOM does not define could be a name
            assert len(warned) == 1 and f"these images are {shared};" in warned[0]["sentence"], f"{name}: {report['warnings']}"
            assert "values are not HU" in warned[0]["sentence"], f"{name}: {report['warnings']}"
            said_so = [line for line in lines if "values are not HU" in line]
            assert said_so == [line for line in lines if "(not_hu)" in line] and name in said_so[0], f"{name}: {lines}"
            expected = ["not_hu", "uneven_spacing"] + (["no_rescale"] if "RescaleIntercept" in keys else [])
            others = [w["code"] for w in report["warnings"] if w["code"] not in expected]
            assert others == ([] if "--threshold" in words else ["default_threshold"]), f"{name} {words}: {others}"
            for where in (report["parameters"], asset["extras"]["trocar"]["parameters"]):
                assert where.get("modality") == shared and where.get("values_are_hu") is False, f"{name}: {where}"
            meshes, nodes = asset["meshes"], asset["nodes"][3:]
            assert sum(len(mesh["primitives"]) for mesh in meshes) == SLICES, f"{name}: {meshes}"
            assert "mean_hu" not in str(nodes) and "_HU" not in str(meshes), f"{name}: {nodes}"
    # Bytes of the file are not copied to messages and assets as they are.
    folder = series(t.folder(), value=300, Modality="M\u00dc\"R'")
    t.refused(folder, "M?", "--any-modality")
    code, _, _, asset, _ = t.run(folder, "--any-modality")
    assert code == 0 and asset["extras"]["trocar"]["parameters"]["modality"] == "OT", f"{folder}: exit {code}"


def ct_is_ct(t):
    """CT is not affected, with and without the option."""
    folder = series(t.folder())
    code, lines, report, asset, plain = t.run(folder)
    assert code == 0 and not lines and not report["warnings"], f"CT: exit {code}, {lines}"
    for where in (report["parameters"], asset["extras"]["trocar"]["parameters"]):
        assert "modality" not in where and "values_are_hu" not in where, f"CT: {where}"
    assert len(asset["extras"]["trocar"]["hu_volumes"]) == 1, f"CT: {asset['extras']}"
    _, _, _, bare, _ = t.run(folder, "--no-hu")
    means = [mean for node in bare["nodes"][3:] for mean in node["extras"]["trocar"]["mean_hu"]]
    assert means == [500] * SLICES, f"CT: {bare['nodes'][3:]}"
    code, lines, _, _, same = t.run(folder, "--any-modality")
    assert code == 0 and not lines and same == plain, f"CT with --any-modality: exit {code}, {lines}, same bytes: {same == plain}"
    for keys in ({"Modality": None}, {"Modality": "", "SOPClassUID": ENHANCED_CT}):
        code, lines, report, _, same = t.run(series(t.folder(), **keys))
        assert code == 0 and not lines, f"CT by its SOP class: exit {code}, {lines}"
    # Neither is there, or the class says nothing: HU are assumed, and this is said.
    for keys in ({"Modality": None, "SOPClassUID": None}, {"Modality": None, "SOPClassUID": CAPTURE}):
        code, lines, report, _, _ = t.run(series(t.folder(), **keys))
        assert code == 0 and [w["code"] for w in report["warnings"]] == ["no_modality"], f"{keys}: exit {code}, {lines}"
    return plain


def beside_ct(t, plain):
    """Other images beside a CT do not decide: they are left out with a warning, whatever their number."""
    folder = series(series(t.folder()), "1.2.5", "mr", count=9, first=20, value=300, Modality="MR", SOPClassUID=MR)
    code, lines, report, _, got = t.run(folder)
    assert code == 0 and [w["code"] for w in report["warnings"]] == ["other_series"] and "MR" in report["warnings"][0]["sentence"], f"CT and MR: exit {code}, {lines}"
    assert got is not None and len(report["slices"]) == SLICES, "CT and MR: not the CT's slices"
    t.refused(folder, "MR (magnetic resonance)", words=("--series", "1.2.5"))
    code, lines, report, _, _ = t.run(folder, "--series", "1.2.5", "--any-modality")
    assert code == 0 and len(report["slices"]) == 9 and report["parameters"].get("modality") == "MR", f"the MR chosen: exit {code}, {lines}"
    for kind in ("LOCALIZER", "REF_SURVIEW"):
        for uid in ("1.2.3.4", "1.2.6"):  # in the CT's series, and as a series
            folder = series(series(t.folder()), uid, "scout", count=5, first=40, ImageType=["ORIGINAL", "PRIMARY", kind],
                            ImageOrientationPatient=[0, 1, 0, 0, 0, -1])
            for words in ((), ("--any-modality",)):
                code, lines, report, _, got = t.run(folder, *words)
                assert code == 0 and [w["code"] for w in report["warnings"]] == ["localiser"], f"CT and {kind}: exit {code}, {lines}"
                assert got == plain, f"CT and {kind}: another asset"
    # A series that is both is refused: its slices do not belong together.
    folder = series(series(t.folder()), names="mr", first=20, value=300, Modality="MR", SOPClassUID=MR)
    t.refused(folder, "mr20.dcm: ", "MR (magnetic resonance)", "2 more files")


def test_ct_and_files_beside_it(t):
    beside_ct(t, ct_is_ct(t))


def test_volumes(t):
    """A NIfTI cannot say that it is MR; the option changes nothing, and this is said."""
    data = np.full((20, 20, 3), -1000, np.int16)
    data[5:15, 5:15] = 500
    file = t.folder() / "scan.nii"
    nibabel.save(nibabel.Nifti1Image(data, np.eye(4)), file)
    plain = t.run(file)[4]
    code, lines, report, _, same = t.run(file, "--any-modality")
    assert code == 0 and [w["code"] for w in report["warnings"]] == ["no_modality"] and same == plain, f"NIfTI: exit {code}, {lines}"
