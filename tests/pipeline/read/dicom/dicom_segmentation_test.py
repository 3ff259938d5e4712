# SPDX-License-Identifier: Apache-2.0
"""A DICOM segmentation gives the same label images and assets as the same label map in a NIfTI,
however its frames are packed, ordered and left out; what does not fit is refused. pydicom writes the files."""
import json
import shutil
import struct
import subprocess

import numpy as np

from dicom_variants_test import generate_uid, item, make_slice, meta, FileDataset, Sequence  # skipped without pydicom
import jsonschema
import nibabel
import pydicom
import pytest
from html_pages import embedded_json
from mesh_runs import MeshRuns, dump
from programs import SOURCE

SEG = "1.2.840.10008.5.1.4.1.1.66.4"
WIDTH, HEIGHT, SLICES = 37, 29, 11  # 1073 pixels: frames of one bit do not begin at a byte
SPACING_U, SPACING_V, STEP = 0.75, 0.5, 1.25
ORIGIN = (-10, 20, 5)
NAMES = {1: "L1", 2: "L2", 300: "Sacrum, künstlich"}


def conforms(document, schema):
    """To a schema of formats/session."""
    file = SOURCE / "formats" / "session" / f"{schema}.schema.json"
    tree = json.loads(file.read_text(encoding="utf-8"))
    del tree["$id"]  # python3-jsonschema 4.10 joins a relative one to itself
    errors = list(jsonschema.Draft202012Validator(tree).iter_errors(document))
    assert not errors, f"{schema}: {[error.message for error in errors]}"


def label_map():
    """Labels 1, 2 and 300, which touch; slices 0, 1, 5 and 10 have none."""
    z, y, x = np.mgrid[0:SLICES, 0:HEIGHT, 0:WIDTH]
    out = np.zeros((SLICES, HEIGHT, WIDTH), int)
    out[(x - 12) ** 2 + (y - 14) ** 2 < 80] = 1
    out[(x >= 15) & (x < 30) & (y > 6) & (y < 20)] = 2
    out[(x - 24) ** 2 + (y - 22) ** 2 < 25] = 300
    out[np.isin(z, (0, 1, 5, 10))] = 0
    out[3][out[3] == 2] = 0
    return out


def hounsfield():
    rng = np.random.default_rng(5)
    return (100 * label_map() % 701 + rng.integers(-50, 50, (SLICES, HEIGHT, WIDTH))).astype(np.int16)


def make_seg(labels, numbers=None, order=None, kind="BINARY", keep_empty=False, largest=255, step=True, masks=None):
    """`masks`: {(segment, slice): pixels} instead of those of the labels."""
    uid = generate_uid(entropy_srcs=["segmentation"])
    ds = FileDataset(None, {}, file_meta=meta(SEG, uid), preamble=b"\0" * 128)
    ds.is_little_endian, ds.is_implicit_VR = True, False
    ds.SOPClassUID, ds.SOPInstanceUID, ds.Modality = SEG, uid, "SEG"
    ds.PatientName, ds.PatientID, ds.SpecificCharacterSet = "Test", "1", "ISO_IR 192"
    ds.StudyInstanceUID, ds.SeriesInstanceUID = "1.2.826.0.1.3680043.10.9", "1.2.826.0.1.3680043.10.77"
    ds.FrameOfReferenceUID, ds.SeriesNumber, ds.SeriesDescription = "1.2.826.0.1.3680043.10.8", 5, "Vertebrae"
    ds.ImageType = ["DERIVED", "PRIMARY"]
    ds.Rows, ds.Columns, ds.SamplesPerPixel, ds.PhotometricInterpretation = HEIGHT, WIDTH, 1, "MONOCHROME2"
    ds.SegmentationType, ds.PixelRepresentation = kind, 0
    ds.BitsAllocated = ds.BitsStored = 1 if kind == "BINARY" else 8
    ds.HighBit = ds.BitsAllocated - 1
    numbers = numbers or sorted(set(labels[labels > 0].tolist()))
    segments = []
    for n in numbers:
        code = item(CodeValue="51282000", CodingSchemeDesignator="SCT", CodeMeaning="Vertebra")
        segments.append(item(SegmentNumber=n, SegmentLabel=NAMES.get(n, f"segment {n}"), SegmentAlgorithmType="MANUAL",
                             SegmentedPropertyTypeCodeSequence=Sequence([code])))
    ds.SegmentSequence = Sequence(segments)
    if kind != "BINARY":
        ds.SegmentationFractionalType, ds.MaximumFractionalValue = "OCCUPANCY", largest
    measures = item(PixelSpacing=[SPACING_V, SPACING_U], SliceThickness=STEP)
    if step:
        measures.SpacingBetweenSlices = STEP
    ds.SharedFunctionalGroupsSequence = Sequence([item(
        PlaneOrientationSequence=Sequence([item(ImageOrientationPatient=[1, 0, 0, 0, 1, 0])]),
        PixelMeasuresSequence=Sequence([measures]))])
    if masks is None:
        masks = {(n, k): labels[k] == n for n in numbers for k in range(SLICES)}
        masks = {where: mask for where, mask in masks.items() if keep_empty or mask.any()}
    keys = list(masks)
    keys = [keys[i] for i in (order if order is not None else range(len(keys)))]
    frames, pixels = [], []
    for n, k in keys:
        frames.append(item(PlanePositionSequence=Sequence([item(ImagePositionPatient=[*ORIGIN[:2], ORIGIN[2] + STEP * k])]),
                           SegmentIdentificationSequence=Sequence([item(ReferencedSegmentNumber=n)])))
        pixels.append(np.asarray(masks[n, k]).ravel())
    ds.NumberOfFrames = len(frames)
    ds.PerFrameFunctionalGroupsSequence = Sequence(frames)
    all_pixels = np.concatenate(pixels)
    if kind == "BINARY":
        data = np.packbits(all_pixels.astype(bool), bitorder="little").tobytes()
    else:
        data = (all_pixels if all_pixels.dtype != bool else all_pixels * largest).astype(np.uint8).tobytes()
    ds.PixelData = data + b"\0" * (len(data) % 2)
    ds["PixelData"].VR = "OB"
    return ds


def without_signs_of_zero(node):
    """JSON in which -0.0 is 0.0: a NIfTI's axes point the other way."""
    if isinstance(node, dict):
        return {key: without_signs_of_zero(value) for key, value in node.items()}
    if isinstance(node, list):
        return [without_signs_of_zero(value) for value in node]
    return node + 0.0 if isinstance(node, float) else node


class Asset:
    """What an asset holds, without its slice index, which has checksums of the JSON's text."""

    def __init__(self, data):
        size = struct.unpack_from("<I", data, 12)[0]
        self.json = without_signs_of_zero(json.loads(data[20 : 20 + size]))
        assert data[28 + size :].startswith(b"TROCARIX"), "no slice index in front"
        self.payload = data[28 + size + self.json["bufferViews"][0]["byteOffset"] :]

    def __eq__(self, other):
        return isinstance(other, Asset) and (self.json, self.payload) == (other.json, other.payload)


class DryRun(MeshRuns):
    def __init__(self, programs, work):
        super().__init__(programs, work)
        self.programs = programs
        # A segmentation's own names are the materials', which are in the asset: here each file has these.
        self.same_names = work / "same_names.json"
        self.same_names.write_text(json.dumps({str(n): f"label {n}" for n in NAMES}))

    def save(self, ds, name="seg.dcm", tool=None):
        out = self.folder() / name
        ds.save_as(out, write_like_original=False)
        if tool:
            original = out.with_suffix(".original")
            out.rename(original)
            subprocess.run([*tool, original, out], check=True)
            original.unlink()
        return out

    def nifti(self, data, name="labels.nii.gz", step=STEP, origin=ORIGIN, turn=0.0, spacing=(SPACING_U, SPACING_V)):
        out = self.folder() / name
        affine = np.diag([-spacing[0], -spacing[1], step, 1])  # LPS to RAS
        affine[:3, 3] = -origin[0], -origin[1], origin[2]
        rotation = np.eye(4)
        rotation[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        image = nibabel.Nifti1Image(np.asarray(data).transpose(2, 1, 0).astype(np.int16), rotation @ affine)
        image.set_qform(None, 0)
        nibabel.save(image, out)
        return out

    def ct(self, hu=None, slices=range(SLICES)):
        """As DICOM, in a folder."""
        out = self.folder()
        hu = hounsfield() if hu is None else hu
        for k in slices:
            ds = make_slice(k)
            ds.Rows, ds.Columns, ds.PixelSpacing = HEIGHT, WIDTH, [SPACING_V, SPACING_U]
            ds.ImagePositionPatient = [*ORIGIN[:2], ORIGIN[2] + STEP * k]
            ds.PixelData = hu[k].astype("<i2").tobytes()
            if len(ds.PixelData) % 2:
                ds.PixelData += b"\0"
            ds.SeriesNumber, ds.SeriesDescription = 2, "Bone"
            ds.save_as(out / f"ct{k:02}.dcm", write_like_original=False)
        return out

    def run(self, scan, *words):
        """Exit code, lines on stderr, report, and the asset."""
        code, lines, report, _, data = super().run(scan, *words)
        return code, lines, report, data and Asset(data)

    def images(self, *words):
        """The readers' label images, or the line of a refusal."""
        return dump(self.programs, self.work / "dump.raw", *words)

    def refused(self, scan, *texts, words=("--labels", "all"), code=3):
        return super().refused(scan, *texts, words=words, code=code)


def codes(report):
    return sorted(w["code"] for w in report["warnings"])


@pytest.fixture(name="t", scope="module")
def dry_run(programs, work):
    return DryRun(programs, work)


def test_as_pydicom_reads(t):
    """The packing of this file's writer is that of pydicom's reader."""
    labels = label_map()
    for kind in ("BINARY", "FRACTIONAL"):
        ds = pydicom.dcmread(t.save(make_seg(labels, kind=kind, keep_empty=True)))
        want = [labels[k] == n for n in NAMES for k in range(SLICES)]
        assert (ds.pixel_array.astype(bool) == want).all(), f"{kind}: pydicom reads other frames"


def test_same_as_nifti(t):
    """Frames in any order, empty ones left out or not, BINARY and FRACTIONAL, in several transfer syntaxes."""
    labels = label_map()
    rng = np.random.default_rng(3)
    shown, whole = t.nifti(labels[2:10], origin=(*ORIGIN[:2], ORIGIN[2] + 2 * STEP)), t.nifti(labels)
    count = sum((labels[k] == n).any() for n in NAMES for k in range(SLICES))
    fractions = {(n, k): np.where(labels[k] == n, rng.integers(128, 256, labels[k].shape), rng.integers(0, 128, labels[k].shape))
                 for n in NAMES for k in range(SLICES)}
    cases = {
        "in order": (make_seg(labels), None, shown), "shuffled": (make_seg(labels, order=rng.permutation(count)), None, shown),
        "without a step": (make_seg(labels, step=False), None, shown),
        "every frame": (make_seg(labels, keep_empty=True), None, whole),
        "fractional": (make_seg(labels, kind="FRACTIONAL"), None, shown),
        "fractional, of 1": (make_seg(labels, kind="FRACTIONAL", largest=1), None, shown),
        "real fractions": (make_seg(labels, kind="FRACTIONAL", masks=fractions), None, whole),
        "high bit 1": (damaged(lambda ds: setattr(ds, "HighBit", 1)), None, shown), "implicit": (make_seg(labels), ("dcmconv", "+ti"), shown), "big endian": (make_seg(labels), ("dcmconv", "+tb"), shown),
        "deflated": (make_seg(labels), ("dcmconv", "+td"), shown),
        "undefined lengths": (make_seg(labels), ("dcmconv", "+te", "-e"), shown),
        "fractional, RLE": (make_seg(labels, kind="FRACTIONAL", keep_empty=True), ("dcmcrle",), whole),
        "fractional, JPEG-LS": (make_seg(labels, kind="FRACTIONAL", keep_empty=True), ("dcmcjpls", "+el"), whole),
    }
    for name, (ds, tool, nifti) in cases.items():
        seg = t.save(ds, tool=tool)
        code, out, got = t.images("labels", "-", seg)
        _, expected, want = t.images("labels", "-", nifti)
        assert code == 0 and got.shape == want.shape, f"{name}: {code} {out if code else got.shape}"
        assert (got == want).all(), f"{name}: {(got != want).sum()} pixels differ"
        places = [np.allclose(a[end], b[end], atol=1e-5) for a, b in zip(out["slices"], expected["slices"]) for end in ("first", "last")]
        assert all(places), f"{name}: its slices lie elsewhere"
        left_out = [w for w in out["warnings"] if w["code"] == "frames_left_out"]
        assert len(left_out) == (1 if nifti == shown else 0) and len(left_out) == len(out["warnings"]), f"{name}: {out['warnings']}"
        assert all("slice 3," in w["sentence"] and "its frames" in w["sentence"] for w in left_out), f"{name}: {left_out}"
        for words in (("--labels", "all"), ("--labels", "1,2"), ("--labels", "300", "--axis", "sagittal")):
            code, lines, report, asset = t.run(seg, *words, "--names", t.same_names)
            _, _, expected, want = t.run(nifti, *words, "--names", t.same_names)
            assert code == 0, f"{name} {words}: exit {code} {lines}"
            assert asset == want, f"{name} {words}: another asset than the NIfTI's"
            assert codes(report) == sorted(codes(expected) + ["frames_left_out"] * len(left_out)), f"{name} {words}: {codes(report)}"
            for part in ("slices", "labels"):
                strip = [{k: v for k, v in one.items() if k not in ("ms", "name")} for one in report.get(part, [])]
                assert strip == [{k: v for k, v in one.items() if k not in ("ms", "name")} for one in expected.get(part, [])], f"{name}: {part}"


def test_overlaps(t):
    """Two wanted segments in one voxel are refused with their names; of what is not wanted it does not matter."""
    labels = label_map()
    masks = {(n, k): labels[k] == n for n in NAMES for k in range(SLICES)}
    masks[2, 4] = masks[2, 4] | (labels[4] == 1) & (np.arange(WIDTH)[None, :] > 12)
    y, x = np.argwhere(masks[2, 4] & masks[1, 4])[0]
    seg = t.save(make_seg(labels, masks=masks))
    for words in (("--labels", "all"), ("--labels", "1,2"), ("--labels", "1-300"), ("--labels", "all", "--axis", "coronal")):
        t.refused(seg, "seg.dcm slice 4: ", "1 (L1)", "2 (L2)", "overlap", f"pixel {x}, {y}", "--labels", words=words)
    for wanted in ("1", "2", "300", "1,300"):
        kept = {int(n) for n in wanted.split(",")}
        painted = np.zeros_like(labels)
        for last in (False, True):  # what is wanted is on top
            for (n, k), mask in masks.items():
                if (n in kept) == last:
                    painted[k][mask] = n
        words = ("--labels", wanted, "--names", t.same_names)
        code, lines, _, asset = t.run(seg, *words)
        assert code == 0 and asset == t.run(t.nifti(painted), *words)[3], f"--labels {wanted}: exit {code}, {lines}"
    code, lines, _, _ = t.run(seg, "--labels", "all", "--slices", "0:3")
    assert code == 0, f"slices without an overlap: {code} {lines}"


def test_without_labels(t):
    """A segmentation is no picture, with and without --any-modality; beside a CT it is found by --labels."""
    labels = label_map()
    seg = t.save(make_seg(labels))
    for words in ((), ("--any-modality",), ("--threshold", "0.5")):
        for scan in (seg, seg.parent):
            t.refused(scan, "seg.dcm: ", "SEG (segmentation)", "--labels", words=words)
    folder = t.ct()
    plain = t.run(folder)[3]
    shutil.copy(seg, folder / "seg.dcm")
    code, lines, report, asset = t.run(folder)
    assert code == 0 and asset == plain and codes(report) == ["empty_slice", "other_series", "regions_dropped"], f"CT beside SEG: {code} {lines}"
    alone = t.run(seg, "--labels", "all")[3]
    for words in ((), ("--series", "5")):
        code, lines, report, asset = t.run(folder, "--labels", "all", *words)
        assert code == 0 and "other_series" in codes(report) and report["input"]["series"]["modality"] == "SEG", f"SEG beside CT: {code} {lines}"
        assert words or asset == alone, "SEG beside CT: another asset"
    shutil.copy(seg, folder / "again.dcm")
    t.refused(folder, "2 segmentations", "again.dcm", "seg.dcm", code=2)


def test_previewed(t):
    """The preview shows the directions at the edges, whether the slices are the stored ones or are said to be transverse."""
    seg, page = t.save(make_seg(label_map())), t.work / "seg.html"
    for words in ((), ("--axis", "transverse"), ("--axis", "coronal")):
        subprocess.run([t.mesh, "preview", seg, "--labels", "all", "-o", page, "--quiet", *words], check=True, timeout=60)
        shown = embedded_json(page.read_text(), "preview")
        assert shown["input"] == "DICOM" and shown["unit"] == "labels", f"{words}: {shown}"
        top = "S" if "coronal" in words else "A"
        letters = [(s["letters"]["left"], s["letters"]["top"]) for s in shown["slices"]]
        assert letters == [("R", top)] * len(letters) != [], f"{words}: {letters}"


def test_listed(t):
    """`list` says what is in a segmentation."""
    folder = t.ct()
    make_seg(label_map()).save_as(folder / "seg.dcm", write_like_original=False)
    done = subprocess.run([t.mesh, "list", "--json", folder], stdout=subprocess.PIPE, check=True, timeout=60)
    conforms(json.loads(done.stdout), "list")
    scans = json.loads(done.stdout)["scans"]
    assert [s["modality"] for s in scans] == ["CT", "SEG"] and [s["taken"] for s in scans] == [True, False], f"{scans}"
    seg = scans[-1]
    assert seg["usable"] and seg["problem"] is None and seg["slices"] == 8 and seg["width_px"] == WIDTH and seg["height_px"] == HEIGHT, f"{seg}"
    assert seg["spacing_mm"] == [SPACING_U, SPACING_V, STEP] and seg["evenly_spaced"], f"{seg}"
    assert seg["segments"] == [{"label": n, "name": name} for n, name in NAMES.items()], f"{seg}"
    text = subprocess.run([t.mesh, "list", folder / "seg.dcm"], stdout=subprocess.PIPE, text=True, check=True, timeout=60).stdout
    assert "--labels" in text and all(f"{n} {name}" in text for n, name in NAMES.items()), text
    broken = t.save(damaged(lambda ds: delattr(ds, "SegmentSequence")))
    done = subprocess.run([t.mesh, "list", broken], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False, timeout=60)
    assert done.returncode == 3 and "SegmentSequence" in done.stderr, f"{done}"


def damaged(change):
    ds = make_seg(label_map())
    change(ds)
    return ds


def groups(ds, k=2):
    return ds.PerFrameFunctionalGroupsSequence[k]


def moved(ds, *mm, k=2):
    groups(ds, k).PlanePositionSequence[0].ImagePositionPatient = list(mm)


def test_damages(t):
    """Each is refused in one line that names the file and the reason."""
    def put(holder, key, value):
        setattr(holder, key, value)

    count = make_seg(label_map()).NumberOfFrames
    cases = {
        "no segments": (lambda ds: delattr(ds, "SegmentSequence"), "no segments"),
        "an empty sequence": (lambda ds: put(ds, "SegmentSequence", Sequence([])), "no segments"),
        "no number": (lambda ds: delattr(ds.SegmentSequence[1], "SegmentNumber"), "SegmentNumber"),
        "number 0": (lambda ds: put(ds.SegmentSequence[1], "SegmentNumber", 0), "SegmentNumber"),
        "twice": (lambda ds: put(ds.SegmentSequence[1], "SegmentNumber", 1), "segment 1 is there twice"),
        "another type": (lambda ds: put(ds, "SegmentationType", "LABELMAP"), "LABELMAP"),
        "no type": (lambda ds: delattr(ds, "SegmentationType"), "SegmentationType"),
        "fractional of bits": (lambda ds: (put(ds, "SegmentationType", "FRACTIONAL"), put(ds, "MaximumFractionalValue", 255)), "1 bits"),
        "no maximum": (lambda ds: put(ds, "SegmentationType", "FRACTIONAL"), "MaximumFractionalValue"),
        "8 bits": (lambda ds: (put(ds, "BitsAllocated", 8), put(ds, "BitsStored", 8), put(ds, "HighBit", 7)), "8 bits"),
        "no groups": (lambda ds: delattr(ds, "PerFrameFunctionalGroupsSequence"), "functional groups for 0"),
        "fewer groups": (lambda ds: ds.PerFrameFunctionalGroupsSequence.pop(), f"{count} frames, but per-frame functional groups for {count - 1}"),
        "more frames": (lambda ds: put(ds, "NumberOfFrames", count + 1), f"{count + 1} frames"),
        "no frames": (lambda ds: put(ds, "NumberOfFrames", 0), "number of frames"),
        "two thousand million frames": (lambda ds: put(ds, "NumberOfFrames", 2147483647), "2147483647 frames"),
        "a shared group less": (lambda ds: delattr(ds, "SharedFunctionalGroupsSequence"), "frame 1: no image orientation"),
        "no spacing": (lambda ds: delattr(ds.SharedFunctionalGroupsSequence[0], "PixelMeasuresSequence"), "frame 1: no pixel spacing"),
        "no position": (lambda ds: delattr(groups(ds), "PlanePositionSequence"), "frame 3: no image position"),
        "no segment": (lambda ds: delattr(groups(ds), "SegmentIdentificationSequence"), "frame 3: it names no segment"),
        "another segment": (lambda ds: put(groups(ds).SegmentIdentificationSequence[0], "ReferencedSegmentNumber", 9), "frame 3: its segment 9 is not"),
        "the same frame twice": (lambda ds: moved(ds, *ORIGIN[:2], ORIGIN[2] + 2 * STEP), "frame 3: is of the same segment and slice as frame 1"),
        "beside": (lambda ds: moved(ds, 3, 3, ORIGIN[2] + 3 * STEP, k=-1), "shifted"),
        "far away": (lambda ds: [moved(ds, *ORIGIN[:2], ORIGIN[2] + 20000 * k * STEP, k=k) for k in (1, 2)], "39999 slices, at most 32768"),
        "turned": (lambda ds: put(groups(ds), "PlaneOrientationSequence", Sequence([item(ImageOrientationPatient=[0, 1, 0, 1, 0, 0])])), "orientation differs"),
        "finer": (lambda ds: put(groups(ds), "PixelMeasuresSequence", Sequence([item(PixelSpacing=[0.1, 0.1])])), "spacing differs"),
        "short": (lambda ds: put(ds, "PixelData", ds.PixelData[:-2]), "truncated"),
        "padded frames": (lambda ds: put(ds, "PixelData", ds.PixelData + bytes(ds.NumberOfFrames)), "without padding"),
        "empty": (lambda ds: put(ds, "PixelData", b""), "truncated"),
        "no pixels": (lambda ds: delattr(ds, "PixelData"), "no pixels (PixelData); the file may be cut off"),
        "wide": (lambda ds: put(ds, "Columns", 65535), "65535 x 29 pixels"),
        "larger": (lambda ds: (put(ds, "Columns", 8192), put(ds, "Rows", 8192)), "truncated"),
        "no rows": (lambda ds: put(ds, "Rows", 0), "37 x 0 pixels"),
        "colour": (lambda ds: put(ds, "SamplesPerPixel", 3), "3 samples"),
    }
    for name, (change, why) in cases.items():
        t.refused(t.save(damaged(change), name.replace(" ", "_") + ".dcm"), name.replace(" ", "_") + ".dcm", why)
    whole = t.save(make_seg(label_map()), "cut.dcm")
    for part in (0.2, 0.5, 0.8, 0.99):
        data = whole.read_bytes()
        cut = t.folder() / "cut.dcm"
        cut.write_bytes(data[: int(len(data) * part)])
        t.refused(cut, "cut.dcm: ")
    over = make_seg(label_map(), kind="FRACTIONAL", largest=200)
    over.MaximumFractionalValue = 100
    t.refused(t.save(over), "frame 1: a value above its MaximumFractionalValue of 100")
    # Uneven slices stay where they are.
    code, lines, report, _ = t.run(t.save(damaged(lambda ds: moved(ds, *ORIGIN[:2], ORIGIN[2] + 20.3 * STEP))), "--labels", "all")
    assert code == 0 and "uneven_spacing" in codes(report) and len({s["index"] for s in report["slices"]}) == 8, f"uneven: {code} {lines}"
