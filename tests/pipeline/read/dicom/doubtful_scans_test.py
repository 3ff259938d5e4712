# SPDX-License-Identifier: Apache-2.0
"""Scans with something doubtful in them, as they come from hospitals: each is meshed with a warning that says what was done, or refused
with the option that decides. pydicom and nibabel write the files."""
import json
import shutil
import subprocess

import nibabel
import numpy as np
import pytest

from dicom_variants_test import COLUMNS, ROWS, item, make_enhanced, make_slice, pydicom  # skipped without pydicom
from mesh_runs import MeshRuns
from modality_test import series

AFFINE = np.diag([-1, -1, 2, 1])


@pytest.fixture(name="t", scope="module")
def dry_run(programs, work):
    return MeshRuns(programs, work)


def edit(folder, change):
    for file in sorted(folder.glob("*.dcm")):
        ds = pydicom.dcmread(file)
        change(ds)
        ds.save_as(file)
    return folder


def only_line(lines, code):
    found = [line for line in lines if f"({code})" in line]
    assert len(found) == 1, f"{code}: {lines}"
    return found[0]


def test_a_series_number_in_two_studies(t):
    folder = t.folder()
    for study, uid in (("1.2.9.1", "1.2.3.1"), ("1.2.9.2", "1.2.3.2")):
        series(folder, uid=uid, names=uid, StudyInstanceUID=study, SeriesNumber=201)
    code, lines, *_ = t.run(folder, "--series", "201")
    assert code == 2 and len(lines) == 1, lines
    for text in ("--series 201 names 2 series of 2 studies", "1.2.3.1", "1.2.3.2", "give the UID of one"):
        assert text in lines[0], f"{text} is not in {lines}"
    assert t.run(folder, "--series", "1.2.3.2")[0] == 0


def test_elements_of_unknown_representation(t, monkeypatch):
    monkeypatch.setattr(pydicom.config, "replace_un_with_known_vr", False)

    def change(ds):
        for name in ("Modality", "ImageType", "ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing", "RescaleIntercept", "Rows"):
            element = ds[name]
            if element.VR == "US":
                raw = int(element.value).to_bytes(2, "little")
            else:
                values = element.value if element.VM > 1 else [element.value]
                raw = "\\".join(str(value) for value in values).encode()
                raw += b" " * (len(raw) % 2)
            ds[name] = pydicom.DataElement(element.tag, "UN", raw)

    plain, unknown = series(t.folder()), series(t.folder())
    edit(unknown, change)
    assert b"\x08\x00\x60\x00UN" in next(unknown.glob("*.dcm")).read_bytes(), "the file has no element of unknown representation"
    expected, made = t.run(plain), t.run(unknown)
    assert expected[0] == made[0] == 0 and made[4] == expected[4], made[1]


def stored_block(value, corner):
    block = np.full((ROWS, COLUMNS), -1000, "<i2")
    block[10:30, 10:40] = value
    block[:8, :8] = corner
    return block.tobytes()


@pytest.mark.parametrize("padding,warned", [(3000, True), (-2000, False)])
def test_padding(t, padding, warned):
    def change(corner, keys=()):
        def apply(ds):
            ds.PixelData = stored_block(500, corner)
            for keyword, value in keys:
                ds.add_new(keyword, "SS", value)
        return apply

    plain = edit(series(t.folder()), change(-1024))
    padded = edit(series(t.folder()), change(padding, [("PixelPaddingValue", padding)]))
    expected, made = t.run(plain), t.run(padded)
    assert expected[0] == made[0] == 0
    triangles = [sum(s["triangles"] for s in report["slices"]) for report in (expected[2], made[2])]
    assert triangles[0] == triangles[1], f"{triangles}: padding was meshed"
    if warned:
        assert "3000 HU" in only_line(made[1], "dense_padding") and made[4] == expected[4], made[1]
    else:
        assert not made[1], made[1]


def test_padding_that_the_stored_bits_cannot_hold(t):
    """The 12 lower bits of -2000 are 2096, which is bone here."""
    def change(ds):
        block = np.full((ROWS, COLUMNS), 24, "<u2")
        block[10:30, 10:40] = 2096
        ds.PixelData = block.tobytes()
        ds.BitsAllocated, ds.BitsStored, ds.HighBit, ds.PixelRepresentation = 16, 12, 11, 0
        ds.RescaleSlope, ds.RescaleIntercept = 1, -1024

    plain, padded = edit(series(t.folder()), change), edit(series(t.folder()), change)
    edit(padded, lambda ds: ds.add_new("PixelPaddingValue", "US", 0x10000 - 2000))
    expected, made = t.run(plain), t.run(padded)
    assert expected[0] == made[0] == 0, made[1]
    assert made[1] == expected[1] and made[4] == expected[4], made[1]


def test_a_range_of_padding(t):
    def change(ds):
        ds.PixelData = stored_block(500, 2990)
        ds.add_new("PixelPaddingValue", "US", 3000)  # as some write it, though the pixels are signed
        ds.add_new("PixelPaddingRangeLimit", "US", 2980)

    code, lines, report, *_ = t.run(edit(series(t.folder()), change))
    assert code == 0 and "2980 to 3000 HU" in only_line(lines, "dense_padding")
    assert all(s["rings"] == 1 for s in report["slices"]), [s["rings"] for s in report["slices"]]


def test_a_tilt_that_the_planes_do_not_have(t):
    tilted = [1, 0, 0, 0, np.cos(np.radians(15)), -np.sin(np.radians(15))]
    for stated, orientation, warned in ((15, [1, 0, 0, 0, 1, 0], True), (0, [1, 0, 0, 0, 1, 0], False), (15, tilted, False),
                                        (-15, tilted, False), (0, tilted, True)):
        def change(ds, stated=stated, orientation=orientation):
            ds.GantryDetectorTilt, ds.ImageOrientationPatient = stated, [f"{x:.8f}" for x in orientation]

        code, lines, *_ = t.run(edit(series(t.folder()), change))
        assert code == 0 and any("(tilt_contradiction)" in line for line in lines) == warned, (stated, orientation, lines)


def test_lossy_compression(t):
    """Whether the file states it, or its transfer syntax alone."""
    def stated(**keys):
        return edit(series(t.folder()), lambda ds: [setattr(ds, key, value) for key, value in keys.items()])

    for keys, texts in (
            ({"LossyImageCompression": "01", "LossyImageCompressionRatio": 8.9, "LossyImageCompressionMethod": "ISO_10918_1"}, ("JPEG, ratio 8.9",)),
            ({"LossyImageCompression": "01", "LossyImageCompressionRatio": [4, 8.9], "LossyImageCompressionMethod": ["ISO_10918_1", "ISO_15444_1"]},
             ("JPEG, then JPEG 2000, ratio 8.9",)),
            ({"LossyImageCompression": "01"}, ("method not stated, ratio not stated",)),
            ({"LossyImageCompressionRatio": 3, "LossyImageCompressionMethod": "DOE_JOHN"}, ("a method that DICOM does not define, ratio 3",))):
        code, lines, report, *_ = t.run(stated(**keys))
        assert code == 0 and len(lines) == 1 and "3 of 3 files" in lines[0], lines
        for text in texts:
            assert text in only_line(lines, "lossy_compression"), lines
        assert [w["code"] for w in report["warnings"]] == ["lossy_compression"] and texts[0] in report["warnings"][0]["sentence"]
        assert "DOE" not in json.dumps(report)
    assert t.run(stated(LossyImageCompression="00"))[1] == []
    # Some slices only, with ratios of their own.
    folder = series(t.folder())
    for k, ratio in ((0, 7.5), (2, 9)):
        ds = pydicom.dcmread(folder / f"slice{k}.dcm")
        ds.LossyImageCompression, ds.LossyImageCompressionRatio, ds.LossyImageCompressionMethod = "01", ratio, "ISO_14495_1"
        ds.save_as(folder / f"slice{k}.dcm")
    line = only_line(t.run(folder)[1], "lossy_compression")
    assert "2 of 3 files" in line and "JPEG-LS, ratio 9 at most" in line, line
    # In a functional group.
    folder = t.folder()
    ds = make_enhanced()
    ds.PerFrameFunctionalGroupsSequence[3].DerivationImageSequence = [item(LossyImageCompression="01", LossyImageCompressionRatio=5)]
    ds.save_as(folder / "all.dcm", write_like_original=False)
    assert "ratio 5" in only_line(t.run(folder, "--threshold", "2000")[1], "lossy_compression")


@pytest.mark.parametrize("tool,bits,text", [
    (("dcmcjpeg", "+eb", "+q", "50"), 8, "JPEG, ratio "), (("dcmcjpeg", "+ee", "+q", "50"), 12, "JPEG, ratio "),
    (("dcmcjpls", "+en", "+md", "3"), 12, "JPEG-LS, ratio "), (("gdcmconv", "--j2k", "--lossy", "-r", "8"), 12, "JPEG 2000, ratio "),
    (("dcmcjpls", "+el"), 12, None), (("gdcmconv", "--j2k"), 12, None), (("dcmcjpeg",), 12, None), (("dcmcrle",), 12, None)])
def test_lossy_transfer_syntaxes(t, tool, bits, text):
    if shutil.which(tool[0]) is None:
        pytest.skip(f"not installed: {tool[0]}")
    folder, plain = t.folder(), t.folder()
    for k in range(3):
        make_slice(k, bits, False, 8 if bits == 8 else 16).save_as(plain / "in.dcm", write_like_original=False)
        out = folder / f"{k}.dcm"
        subprocess.run([*tool, plain / "in.dcm", out], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        ds = pydicom.dcmread(out)
        for key in ("LossyImageCompression", "LossyImageCompressionRatio", "LossyImageCompressionMethod"):
            if key in ds:
                delattr(ds, key)
        ds.save_as(out)
    code, lines, *_ = t.run(folder, "--threshold", str(2 ** (bits - 1)))
    assert code == 0, lines
    assert [text in line for line in lines if "(lossy_compression)" in line] == ([True] if text else []), lines


def test_a_preview_says_each_kind_of_warning_once(t):
    folder = series(t.folder())
    for k in range(9):
        (folder / f"note{k}.dat").write_text("a note")
    done = subprocess.run([t.mesh, "preview", folder, "-o", t.work / "sheet.png"], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          text=True, check=True, timeout=60)
    assert "and 6 more" in only_line(done.stderr.splitlines(), "not_dicom"), done.stderr


def volume(value=500.0, slices=4):
    out = np.full((40, 30, slices), -1000, np.float32)
    out[10:25, 8:20] = value
    return out


def save(t, values, name="scan.nii.gz"):
    file = t.folder() / name
    nibabel.save(nibabel.Nifti1Image(values, AFFINE), file)
    return file


@pytest.mark.parametrize("name", ["scan.nii", "scan.nii.gz"])
def test_several_volumes_in_a_nifti(t, name):
    file = save(t, np.stack([volume(300), volume(500)[::-1], volume(700)], axis=3), name)
    code, lines, *_ = t.run(file)
    assert code == 2 and "holds 3 volumes" in lines[0] and "0:2 with --volume" in lines[0], lines
    made, expected = t.run(file, "--volume", "1"), t.run(save(t, volume(500)[::-1].copy()))
    assert made[0] == 0 and made[2]["parameters"]["volume"] == 1, made[1]
    assert [s["area_mm2"] for s in made[2]["slices"]] == [s["area_mm2"] for s in expected[2]["slices"]]
    assert made[2]["slices"][1]["mean_hu"] == 500, made[2]["slices"][1]
    assert t.run(file, "--volume", "3")[0] == 2
    assert "outside 0:0" in t.run(save(t, volume()), "--volume", "1")[1][0]
    assert "is none" in t.run(series(t.folder()), "--volume", "0")[1][0]


def test_voxels_that_are_not_numbers(t):
    hole, air, infinite = volume(), volume(), volume()
    hole[:, :3, 1] = np.nan
    air[:, :3, 1] = -1024
    infinite[0, 0, 2] = np.inf
    made, expected = t.run(save(t, hole)), t.run(save(t, air))
    assert made[0] == 0 and made[4] == expected[4], made[1]
    assert "slice 1: 120 voxels are not numbers" in only_line(made[1], "not_numbers"), made[1]
    t.refused(save(t, infinite), "slice 2: an infinite voxel")
    labels, plain = np.zeros((40, 30, 4), np.float32), np.zeros((40, 30, 4), np.float32)
    labels[10:25, 8:20] = plain[10:25, 8:20] = 7
    labels[30:, :, 2] = np.nan
    made, expected = t.run(save(t, labels), "--labels", "7"), t.run(save(t, plain), "--labels", "7")
    assert made[0] == 0 and made[4] == expected[4] and only_line(made[1], "not_numbers"), made[1]


def test_slices_too_wide_for_the_lattice(t):
    """A field of 650 mm fits a lattice of 2^-13 mm, and no slice of 36 km is meshed."""
    ripple = 300 + 400 * np.sin(np.arange(512) / 3.0)[:, None, None] * np.ones((1, 512, 2), np.float32)
    for width_mm, fails, fits in ((650, "14", "13"), (1000, "14", "13"), (36000, "8", "7")):
        side = width_mm / 512
        file = t.folder() / "wide.nii"
        nibabel.save(nibabel.Nifti1Image(ripple.astype(np.float32), np.diag([-side, -side, 2, 1])), file)
        options = ("--max-area-px", "2000")
        t.refused(file, f"--lattice-bits {fits} is the finest lattice that holds it", words=("--lattice-bits", fails, *options))
        assert t.run(file, "--lattice-bits", fits, *options)[0] == 0, width_mm
    nibabel.save(nibabel.Nifti1Image(ripple.astype(np.float32), np.diag([-7e4, -7e4, 2, 1])), file)
    t.refused(file, "check the pixel size", words=("--lattice-bits", "0"))


@pytest.mark.parametrize("absolute", [True, False])
def test_the_report_does_not_name_the_folder(t, absolute):
    parent = t.folder()
    folder = series(t.folder()).rename(parent / "DOE_JOHN")
    (folder / "note.bin").write_text("a note")
    report = t.work / "report.json"
    words = [t.mesh, folder if absolute else "DOE_JOHN", "-o", t.work / "x.glb", "--report", report, "--quiet"]
    subprocess.run(words, check=True, cwd=parent, timeout=60)
    assert "DOE" not in report.read_text() and "input/note.bin" in report.read_text(), report.read_text()[:2000]
    shutil.rmtree(parent)
