# SPDX-License-Identifier: Apache-2.0
"""Every kind of DICOM file that is accepted, written by DCMTK's and
GDCM's programs, compared voxel by voxel with the original values; and every kind that is refused,
with the reason and the file that the message names. pydicom makes the originals and edits geometry."""
import shutil
import subprocess
import zlib

import numpy as np
import pytest
from mesh_runs import dump

pydicom = pytest.importorskip("pydicom")
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset  # noqa: E402
from pydicom.sequence import Sequence  # noqa: E402
from pydicom.uid import ExplicitVRLittleEndian, generate_uid  # noqa: E402

TOOLS = ["dcmconv", "dcmcrle", "dcmcjpeg", "dcmcjpls", "dcmodify", "img2dcm", "gdcmconv"]
COLUMNS, ROWS, SLICES = 61, 48, 5  # odd, so that 8-bit frames have odd sizes
SPACING_U, SPACING_V, STEP = 0.5, 0.75, 1.25
CT, ENHANCED_CT = "1.2.840.10008.5.1.4.1.1.2", "1.2.840.10008.5.1.4.1.1.2.1"
SERIES = "1.2.826.0.1.3680043.10.1"


def stored(k, bits, signed, seed=0):
    """Slice k as stored integers: smooth with some noise, using all the bits."""
    y, x = np.mgrid[0:ROWS, 0:COLUMNS]
    rng = np.random.default_rng(1000 + k + 77 * seed)
    f = 0.5 + 0.3 * np.sin(x / 9 + k) * np.cos(y / 7) + 0.02 * rng.standard_normal((ROWS, COLUMNS))
    f[0, 0], f[0, 1] = 0, 1
    v = np.clip(np.round(f * (2**bits - 1)), 0, 2**bits - 1).astype(int)
    return v - 2 ** (bits - 1) if signed else v


def pixel_bytes(values, allocated, bits, shift=0):
    words = (values & ((1 << bits) - 1)) << shift
    return words.astype("<u2" if allocated == 16 else "<u1").tobytes()


def meta(sop_class, uid):
    m = FileMetaDataset()
    m.MediaStorageSOPClassUID, m.MediaStorageSOPInstanceUID = sop_class, uid
    m.TransferSyntaxUID = ExplicitVRLittleEndian
    return m


def describe(ds, bits, signed, allocated, shift=0):
    ds.PatientName, ds.PatientID, ds.Modality = "Test", "1", "CT"
    ds.StudyInstanceUID, ds.SeriesInstanceUID = "1.2.826.0.1.3680043.10.9", SERIES
    ds.FrameOfReferenceUID = "1.2.826.0.1.3680043.10.8"
    ds.Rows, ds.Columns, ds.SamplesPerPixel = ROWS, COLUMNS, 1
    ds.PhotometricInterpretation = "MONOCHROME2"
    ds.BitsAllocated, ds.BitsStored, ds.HighBit = allocated, bits, bits - 1 + shift
    ds.PixelRepresentation = int(signed)


def make_slice(k, bits=16, signed=True, allocated=16, shift=0, seed=0):
    uid = generate_uid(entropy_srcs=[f"{k} {bits} {signed} {seed}"])
    ds = FileDataset(None, {}, file_meta=meta(CT, uid), preamble=b"\0" * 128)
    ds.is_little_endian, ds.is_implicit_VR = True, False
    describe(ds, bits, signed, allocated, shift)
    ds.SOPClassUID, ds.SOPInstanceUID, ds.InstanceNumber = CT, uid, k + 1
    ds.ImageType = ["ORIGINAL", "PRIMARY", "AXIAL"]
    ds.ImagePositionPatient = [-10, 20, 5 + STEP * k]
    ds.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
    ds.PixelSpacing = [SPACING_V, SPACING_U]
    ds.RescaleSlope, ds.RescaleIntercept = 1, 0
    data = pixel_bytes(stored(k, bits, signed, seed), allocated, bits, shift)
    ds.PixelData = data + b"\0" * (len(data) % 2)
    ds["PixelData"].VR = "OW" if allocated == 16 else "OB"
    return ds


def item(**keys):
    ds = Dataset()
    for name, value in keys.items():
        setattr(ds, name, value)
    return ds


def make_enhanced(bits=12, signed=False, allocated=16, order=range(SLICES), per_frame_rescale=True):
    """An enhanced CT with its frames in the given order; orientation and spacing are shared."""
    uid = generate_uid(entropy_srcs=[f"enhanced {bits} {signed}"])
    ds = FileDataset(None, {}, file_meta=meta(ENHANCED_CT, uid), preamble=b"\0" * 128)
    ds.is_little_endian, ds.is_implicit_VR = True, False
    describe(ds, bits, signed, allocated)
    ds.SOPClassUID, ds.SOPInstanceUID = ENHANCED_CT, uid
    ds.ImageType = ["ORIGINAL", "PRIMARY", "VOLUME", "NONE"]
    ds.NumberOfFrames = SLICES
    shared = item(PlaneOrientationSequence=Sequence([item(ImageOrientationPatient=[1, 0, 0, 0, 1, 0])]),
                  PixelMeasuresSequence=Sequence([item(PixelSpacing=[SPACING_V, SPACING_U], SliceThickness=STEP)]))
    frames, data = [], b""
    for k in order:
        group = item(PlanePositionSequence=Sequence([item(ImagePositionPatient=[-10, 20, 5 + STEP * k])]))
        if per_frame_rescale:
            group.PixelValueTransformationSequence = Sequence(
                [item(RescaleIntercept=-1000 - k, RescaleSlope=1 + k / 4, RescaleType="HU")])
        frames.append(group)
        data += pixel_bytes(stored(k, bits, signed), allocated, bits)
    ds.SharedFunctionalGroupsSequence = Sequence([shared])
    ds.PerFrameFunctionalGroupsSequence = Sequence(frames)
    ds.PixelData = data + b"\0" * (len(data) % 2)
    ds["PixelData"].VR = "OW" if allocated == 16 else "OB"
    return ds


class Case:
    """A folder of files, and checks of what the readers make of it."""

    def __init__(self, programs, work, name):
        self.programs, self.folder, self.name = programs, work / name, name
        self.spacing = "-"  # or X,Y,Z, as of --spacing
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True)

    def save(self, ds, name, tool=("dcmconv", "+te")):
        """Writes `ds`, then lets the tool write the file that is read."""
        original, out = self.folder.with_suffix(".original"), self.folder / name
        ds.save_as(original, write_like_original=False)
        program, *arguments = tool
        order = [program, *arguments, str(original), str(out)]
        done = subprocess.run(order, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        assert done.returncode == 0 and out.exists(), f"{' '.join(order)}: {done.stdout}"
        original.unlink()
        return out

    def run(self):
        return dump(self.programs, self.folder.with_suffix(".raw"), "transverse", self.spacing, self.folder)

    def gives(self, want, bound=0.0, warnings=(), step=STEP):
        """These voxels, at their positions in the patient."""
        code, out, got = self.run()
        assert code == 0, f"{self.name}: refused: {out}"
        want = np.asarray(want, np.float32)
        assert got.shape == want.shape, f"{self.name}: {got.shape}, not {want.shape}"
        worst = float(np.abs(got - want).max())
        assert worst <= bound, f"{self.name}: off by up to {worst}, allowed {bound}"
        for k, s in enumerate(out["slices"]):
            z = 5 + step * k
            last = [-10 + SPACING_U * (COLUMNS - 1), 20 + SPACING_V * (ROWS - 1), z]
            assert np.allclose(s["first"], [-10, 20, z]) and np.allclose(s["last"], last), f"{self.name}: slice {k} lies at {s}"
        codes = sorted(w["code"] for w in out["warnings"])
        assert codes == sorted(warnings), f"{self.name}: warnings {out['warnings']}, expected {warnings}"
        return out

    def refuses(self, *words):
        code, out, _ = self.run()
        said = out if code else "nothing"
        ok = code == 3 and len(said.splitlines()) == 1 and all(w in said for w in words)
        assert ok, f"{self.name}: exit {code}, {said!r} lacks one of {words}"

    def accepts(self, slices, *codes):
        """This number of slices, with these warnings."""
        code, out, _ = self.run()
        got = sorted({w["code"] for w in out["warnings"]}) if code == 0 else out
        assert code == 0 and len(out["slices"]) == slices and got == sorted(codes), f"{self.name}: {code} {got}, expected {slices} slices, {codes}"
        return out


LOSSLESS = {
    "explicit": ("dcmconv", "+te"), "implicit": ("dcmconv", "+ti"), "big_endian": ("dcmconv", "+tb"),
    "deflated": ("dcmconv", "+td"), "no_preamble": ("dcmconv", "-F", "+ti"), "undefined_lengths": ("dcmconv", "+te", "-e"),
    "rle": ("dcmcrle",), "jpeg_lossless_sv1": ("dcmcjpeg",), "jpeg_lossless": ("dcmcjpeg", "+el"),
    "jpeg_ls": ("dcmcjpls", "+el"), "fragments": ("dcmcjpls", "+el", "+fs", "1"),
    "gdcm_j2k": ("gdcmconv", "--j2k"), "gdcm_rle": ("gdcmconv", "--rle"), "gdcm_jpeg": ("gdcmconv", "--jpeg"),
    "gdcm_jpegls": ("gdcmconv", "--jpegls"), "gdcm_raw": ("gdcmconv", "--raw"),
}
PLAIN = {"implicit", "deflated", "no_preamble", "undefined_lengths", "fragments", "gdcm_raw"}
# Bits stored, signed, bits allocated.
FORMATS = [(16, True, 16), (16, False, 16), (12, False, 16), (12, True, 16), (10, False, 16), (8, False, 8), (8, True, 8)]


@pytest.fixture(name="case")
def new_case(programs, work):
    absent = [tool for tool in TOOLS if shutil.which(tool) is None]
    if absent:
        pytest.skip(f"not installed: {' '.join(absent)}")
    return lambda name: Case(programs, work, name)


def test_codecs(case):
    for name, tool in LOSSLESS.items():
        for bits, signed, allocated in FORMATS if name not in PLAIN else FORMATS[:1] + FORMATS[-1:]:
            label = f"{name}_{'s' if signed else 'u'}{bits}of{allocated}"
            c = case(label)
            for k in (0, 1):  # the names in the wrong order
                c.save(make_slice(k, bits, signed, allocated), f"{1 - k}", tool)
            c.gives([stored(k, bits, signed) for k in range(2)])
    # Lossy: within a bound.
    for name, tool, (bits, signed, allocated), bound in [
            ("jpeg_baseline", ("dcmcjpeg", "+eb", "+q", "95"), (8, False, 8), 12),
            ("jpeg_extended", ("dcmcjpeg", "+ee", "+q", "95"), (12, False, 16), 160),
            ("jpeg_ls_near", ("dcmcjpls", "+en", "+md", "3"), (12, False, 16), 3),
            ("j2k_lossy", ("gdcmconv", "--j2k", "--lossy", "-r", "3"), (12, False, 16), 40)]:
        c = case(name)
        for k in range(SLICES):
            c.save(make_slice(k, bits, signed, allocated), f"{k}", tool)
        c.gives([stored(k, bits, signed) for k in range(SLICES)], bound, ["lossy_compression"])


def test_values(case):
    # Stored in the high bits: 12 bits in bits 4..15.
    c = case("high_bit_15")
    for k in range(SLICES):
        c.save(make_slice(k, 12, True, 16, shift=4), f"{k}")
    c.gives([stored(k, 12, True) for k in range(SLICES)])
    # The photometric interpretation does not change HU.
    c = case("monochrome1")
    for k in range(SLICES):
        f = c.save(make_slice(k, 12, False), f"{k}")
        subprocess.run(["dcmodify", "-nb", "-m", "PhotometricInterpretation=MONOCHROME1", f], check=True)
    c.gives([stored(k, 12, False) for k in range(SLICES)])
    c = case("rescale")
    for k in range(SLICES):
        f = c.save(make_slice(k, 12, False), f"{k}")
        subprocess.run(["dcmodify", "-nb", "-m", f"RescaleSlope={0.3 + k / 7:.6f}", "-m", f"RescaleIntercept={-1024.5 - k}", f], check=True)
    c.gives([stored(k, 12, False) * float(f"{0.3 + k / 7:.6f}") - 1024.5 - k for k in range(SLICES)], 1e-3)


def test_multi_frame(case):
    order = [2, 0, 4, 3, 1]
    hu = [stored(k, 12, False) * (1 + k / 4) - 1000 - k for k in range(SLICES)]
    for name, tool in LOSSLESS.items():
        c = case(f"enhanced_{name}")
        c.save(make_enhanced(order=order), "all.dcm", tool)
        out = c.gives(hu)
        assert out["slices"][0]["name"].endswith("frame 2"), f"{c.name}: {out['slices'][0]['name']}"
    c = case("enhanced_8_bit")
    c.save(make_enhanced(8, False, 8, per_frame_rescale=False), "all.dcm", ("dcmcrle",))
    c.gives([stored(k, 8, False) for k in range(SLICES)], warnings=["no_rescale"])
    c = case("enhanced_8_bit_native")  # frames of an odd number of bytes, not padded
    c.save(make_enhanced(8, False, 8, per_frame_rescale=False), "all.dcm")
    c.gives([stored(k, 8, False) for k in range(SLICES)], warnings=["no_rescale"])
    for name, edit, *words in (
            ("short_groups", lambda ds: setattr(ds, "PerFrameFunctionalGroupsSequence", ds.PerFrameFunctionalGroupsSequence[:3]), "5 frames", "groups for 3"),
            ("no_groups", lambda ds: delattr(ds, "PerFrameFunctionalGroupsSequence"), "5 frames", "functional groups"),
            ("no_position", lambda ds: delattr(ds.PerFrameFunctionalGroupsSequence[3], "PlanePositionSequence"), "frame 4", "no image position"),
            ("truncated", lambda ds: setattr(ds, "PixelData", ds.PixelData[:-2 * COLUMNS * ROWS]), "truncated")):
        ds = make_enhanced()
        edit(ds)
        c = case("enhanced_" + name)
        c.save(ds, "all.dcm")
        c.refuses("all.dcm", *words)
    c = case("enhanced_duplicate")
    ds = make_enhanced(order=[0, 1, 2, 2, 3])
    c.save(ds, "all.dcm")
    c.accepts(SLICES - 1, "copied_slice")
    ds.PixelData = ds.PixelData[:-1] + b"\x07"  # of the last frame, which moves to the place of the one before it
    ds.PerFrameFunctionalGroupsSequence[4].PlanePositionSequence = ds.PerFrameFunctionalGroupsSequence[3].PlanePositionSequence
    c.save(ds, "all.dcm")
    c.refuses("all.dcm frame 3", "all.dcm frame 5", "same position")


def series(case, count=SLICES, **keys):
    c = case
    for k in range(count):
        c.save(make_slice(k, **keys), f"{k}")
    return c


def modify(file, *edits):
    subprocess.run(["dcmodify", "-nb", *edits, str(file)], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def test_geometry(case):
    plain = [stored(k, 16, True) for k in range(SLICES)]
    # A tilted gantry: positions move within the plane.
    c = series(case("gantry_tilt"))
    for k in range(SLICES):
        modify(c.folder / f"{k}", "-m", f"ImagePositionPatient=-10\\{20 + 0.4 * k}\\{5 + STEP * k}")
    out = c.accepts(SLICES, "gantry_tilt")
    for k, s in enumerate(out["slices"]):
        assert np.allclose(s["first"], [-10, 20 + 0.4 * k, 5 + STEP * k]), f"gantry_tilt: slice {k} at {s}"
    c = series(case("uneven"))
    modify(c.folder / "4", "-m", f"ImagePositionPatient=-10\\20\\{5 + STEP * 4.3}")
    out = c.accepts(SLICES, "uneven_spacing")
    assert any(c.folder.name + "/3" in w["where"] and "/4" in w["where"] for w in out["warnings"]), "uneven: " + str(out["warnings"])
    c = series(case("missing"))
    (c.folder / "2").unlink()
    out = c.accepts(SLICES - 1, "missing_slice")
    assert any("/1" in w["where"] and "/3" in w["where"] for w in out["warnings"]), "missing: " + str(out["warnings"])
    c = series(case("duplicate"))
    c.save(make_slice(2, seed=1), "2b")
    c.refuses("2b", "/2", "same position")
    c = series(case("copied_file"))
    shutil.copy(c.folder / "2", c.folder / "copy")
    out = c.accepts(SLICES, "copied_slice")
    assert any("1 slice is there twice with equal pixels" in w["sentence"] for w in out["warnings"]), "copied_file: " + str(out["warnings"])
    ds = pydicom.dcmread(c.folder / "copy")  # the same instance with other pixels
    ds.PixelData = bytes([ds.PixelData[0] ^ 1]) + ds.PixelData[1:]
    ds.save_as(c.folder / "copy")
    c.refuses("copy", "/2", "same SOP instance with other pixels")
    for name, edits, *words in (
            ("turned", ("-m", "ImageOrientationPatient=0\\1\\0\\0\\0\\-1"), "orientation differs"),
            ("two_frames_of_reference", ("-m", "FrameOfReferenceUID=1.2.3"), "frame of reference differs"),
            ("other_spacing", ("-m", "PixelSpacing=1\\1"), "pixel spacing differs"),
            ("no_lengths", ("-m", "PixelSpacing=0\\0"), "PixelSpacing", "not two lengths"),
            ("bad_orientation", ("-m", "ImageOrientationPatient=1\\0\\0\\1\\0\\0"), "right angles"),
            *((f"no_{tag}", ("-ea", tag), reason, tag) for tag, reason in (("ImagePositionPatient", "no image position"),
                                                                          ("ImageOrientationPatient", "no image orientation"),
                                                                          ("PixelSpacing", "no pixel spacing"))),
            ("slope_zero", ("-m", "RescaleSlope=0"), "slope of zero"),
            # A rescale that is present but invalid is not replaced by 1 and 0: HU would be wrong.
            *((f"rescale_{value}_{keyword}", ("-m", f"{keyword}={value}"), "out of range" if value == "1e300" else keyword)
              for value in ("abc", "", "nan", "1e300") for keyword in ("RescaleSlope", "RescaleIntercept"))):
        c = series(case(name))
        modify(c.folder / "3", *edits)
        c.refuses("/3", *words)
    # Where files have no pixel spacing it may be given; positions stay the files'.
    for name, edited in (("given_spacing", range(SLICES)), ("given_to_one", (3,))):
        c = series(case(name))
        c.spacing = f"{SPACING_U},{SPACING_V},99"
        for k in edited:
            modify(c.folder / f"{k}", "-ea" if k % 2 else "-m", "PixelSpacing" if k % 2 else "PixelSpacing=")
        out = c.gives(plain, warnings=["no_pixel_spacing"])
        assert out and out["warnings"][0]["sentence"].startswith(f"{len(edited)} "), f"{name}: {out and out['warnings']}"
    c.spacing = "1,1,1"
    c.refuses("/3", "pixel spacing differs")
    c = series(case("own_spacing"))
    c.spacing = "9,9,9"
    c.gives(plain, warnings=["spacing_ignored"])
    c = series(case("given_no_lengths"))
    c.spacing = "1,1,1"
    modify(c.folder / "3", "-m", "PixelSpacing=0\\0")
    c.refuses("/3", "PixelSpacing", "not two lengths")
    c = series(case("reversed"))  # orientation that faces the feet: slices run down
    for k in range(SLICES):
        modify(c.folder / f"{k}", "-m", "ImageOrientationPatient=1\\0\\0\\0\\-1\\0")
    out = c.accepts(SLICES)
    assert [s["first"][2] for s in out["slices"]] == [5 + STEP * k for k in reversed(range(SLICES))], "reversed: " + str(out["slices"])
    c = case("localisers")
    series(c)
    ds = make_slice(0, seed=5)
    ds.ImageType = ["ORIGINAL", "PRIMARY", "LOCALIZER"]
    ds.ImageOrientationPatient = [0, 1, 0, 0, 0, -1]
    c.save(ds, "scout")
    c.gives(plain, warnings=["localiser"])


def test_identity(case, work):
    plain = [stored(k, 16, True) for k in range(SLICES)]
    # Several series: the largest is chosen, the others are named.
    c = series(case("two_series"))
    for k in range(2):
        modify(c.save(make_slice(k, seed=3), f"other{k}"), "-m", "SeriesInstanceUID=1.2.3.4")
    out = c.gives(plain, warnings=["other_series"])
    assert out and "1.2.3.4" in out["warnings"][0]["sentence"], "two_series: the other is not named"
    # The largest is chosen even if it is broken, not a smaller one beside it.
    c = series(case("broken_series"))
    for k in range(SLICES):
        modify(c.folder / f"{k}", "-ea", "PixelSpacing")
    modify(c.save(make_slice(0, seed=3), "other"), "-m", "SeriesInstanceUID=1.2.3.4")
    c.refuses("/0", "PixelSpacing", "--series")
    # Defects of another series do not matter.
    c = series(case("colour_capture"))
    picture = work / "picture.bmp"
    size = 3 * 4 * 4
    picture.write_bytes(b"BM" + (54 + size).to_bytes(4, "little") + bytes(4) + (54).to_bytes(4, "little") + (40).to_bytes(4, "little") +
                        (4).to_bytes(4, "little") * 2 + (1).to_bytes(2, "little") + (24).to_bytes(2, "little") + bytes(4) +
                        size.to_bytes(4, "little") + bytes(16) + bytes(range(size)))
    subprocess.run(["img2dcm", "-i", "BMP", picture, c.folder / "capture"], check=True)
    out = c.gives(plain, warnings=["other_series"])
    assert out and "colour" in out["warnings"][0]["sentence"], "colour_capture: " + str(out and out["warnings"])
    c = series(case("many_captures"))  # more than there are slices
    for k in range(2 * SLICES):
        subprocess.run(["img2dcm", "-i", "BMP", picture, c.folder / f"capture{k}"], check=True)
        modify(c.folder / f"capture{k}", "-m", "SeriesInstanceUID=1.2.3.4")
    c.gives(plain, warnings=["other_series"])
    c = series(case("no_rescale"))
    for k in range(SLICES):
        modify(c.folder / f"{k}", "-ea", "RescaleIntercept")
    out = c.gives(plain, warnings=["no_rescale"])
    assert out and str(SLICES) in out["warnings"][0]["sentence"], "no_rescale: " + str(out and out["warnings"])
    assert out and out["warnings"][0]["where"].endswith("/0"), "no_rescale: " + str(out and out["warnings"])
    # Stored values would differ from HU by a thousand; the first file without a rescale is named.
    for name, without in (("rescale_of_some", (2, 3)), ("rescale_of_one", (1, 2, 3, 4))):
        c = series(case(name))
        for k in without:
            modify(c.folder / f"{k}", "-ea", "RescaleSlope", "-ea", "RescaleIntercept")
        c.refuses(f"/{without[0]}: ", "no rescale", f"{SLICES - len(without)} of the series' {SLICES}")
    c = case("only_colour")
    subprocess.run(["img2dcm", "-i", "BMP", picture, c.folder / "capture"], check=True)
    c.refuses("capture", "colour")
    # UIDs empty or missing.
    for name, edits in (("empty_uids", ("-m", "SeriesInstanceUID=", "-m", "SOPInstanceUID=")), ("missing_uids", ("-e", "SeriesInstanceUID", "-e", "SOPInstanceUID"))):
        c = series(case(name))
        for k in range(SLICES):
            ds = pydicom.dcmread(c.folder / f"{k}")
            for keyword in ("SeriesInstanceUID", "SOPInstanceUID"):
                if name == "missing_uids":
                    delattr(ds, keyword)
                else:
                    setattr(ds, keyword, "")
            ds.save_as(c.folder / f"{k}")
        c.gives(plain, warnings=["no_series_uid", "no_sop_uid"])
    c = series(case("not_images"))
    (c.folder / "README").write_text("not a scan\n")
    (c.folder / "empty").write_bytes(b"")
    subprocess.run(["dcmmkdir", "+r", "-Nxc", "+D", "DICOMDIR", "+id", ".", "nothing"], cwd=c.folder, check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    c.accepts(SLICES, "not_dicom")


def test_broken(case):
    c = series(case("truncated"))
    whole = (c.folder / "2").read_bytes()
    (c.folder / "2").write_bytes(whole[:-1000])
    c.refuses("/2", "truncated")
    for name, keys, *words in (
            ("short_pixels", {"PixelData": make_slice(2).PixelData[:-200]}, "truncated", str(2 * COLUMNS * ROWS)),
            ("huge", {"Rows": 65535, "Columns": 65535}, "65535 x 65535"),
            ("32_bits", {"BitsAllocated": 32, "BitsStored": 32, "HighBit": 31, "PixelData": make_slice(2).PixelData * 2}, "32")):
        c, ds = series(case(name)), make_slice(2)
        for key, value in keys.items():
            setattr(ds, key, value)
        c.save(ds, "2")
        c.refuses("/2", *words)
    c = series(case("truncated_header"))
    (c.folder / "2").write_bytes(whole[:700])
    c.refuses("/2", "damaged or truncated")
    for name in ("rle", "jpeg_lossless", "jpeg_ls", "gdcm_j2k", "deflated"):
        c = series(case("truncated_" + name))
        f = c.save(make_slice(2), "2", LOSSLESS[name])
        f.write_bytes(f.read_bytes()[: -f.stat().st_size // 3])
        c.refuses("/2")
    # Fragments that end early, in a file whose elements are complete.
    for name in ("rle", "jpeg_lossless", "jpeg_ls", "gdcm_j2k"):
        c = series(case("cut_" + name))
        f = c.save(make_slice(2), "2", LOSSLESS[name])
        ds = pydicom.dcmread(f)
        data = pydicom.encaps.defragment_data(ds.PixelData)
        ds.PixelData = pydicom.encaps.encapsulate([data[: len(data) // 2]])
        ds.save_as(f)
        c.refuses("/2")
    c = case("wrong_size_j2k")
    f = c.save(make_slice(2), "2", LOSSLESS["gdcm_j2k"])
    ds = pydicom.dcmread(f)
    ds.Rows, ds.Columns = COLUMNS, ROWS
    ds.save_as(f)
    c.refuses("/2", "JPEG 2000", f"{ROWS} x {COLUMNS}")
    for name in ("jpeg_lossless", "jpeg_ls"):  # DCMTK itself refuses the latter
        c = case("wrong_size_" + name)
        f = c.save(make_slice(2), "2", LOSSLESS[name])
        ds = pydicom.dcmread(f)
        ds.Rows, ds.Columns = COLUMNS, ROWS
        ds.save_as(f)
        c.refuses("/2", "JPEG")
    c = series(case("unknown_syntax"))
    f = c.save(make_slice(2), "2", LOSSLESS["jpeg_lossless"])
    ds = pydicom.dcmread(f)
    ds.file_meta.TransferSyntaxUID = "1.2.840.10008.1.2.4.100"  # MPEG2
    ds.save_as(f)
    c.refuses("/2", "no decoder", "MPEG2")
    # A few hundred kilobytes that inflate to more than 512 MiB.
    c = case("inflated")
    f = c.save(make_slice(0), "0", LOSSLESS["deflated"])
    body = f.read_bytes()
    start = 132 + 12 + int.from_bytes(body[140:144], "little")
    data = zlib.decompress(body[start:], -15)
    zeros = bytes(1 << 24)
    pack = zlib.compressobj(1, zlib.DEFLATED, -15)
    packed = pack.compress(data + bytes.fromhex("f1ff1010") + b"OB\0\0" + (40 << 24).to_bytes(4, "little"))
    packed += b"".join(pack.compress(zeros) for _ in range(40)) + pack.flush()
    f.write_bytes(body[:start] + packed)
    c.refuses("/0", "512 MiB")
    # Deeply nested sequences: DCMTK recurses into them.
    c = case("nested")
    nest = bytes.fromhex("0800401153510000ffffffff" "feff00e0ffffffff")
    head = (c.save(make_slice(0), "0")).read_bytes()
    start = head.index(bytes.fromhex("0800") + b"\x08\x00CS")
    (c.folder / "0").write_bytes(head[:start] + nest * 200000)
    c.refuses("/0", "nested too deep")
    c = case("nothing_usable")
    (c.folder / "text").write_text("no scan")
    c.refuses("/text: not a DICOM image")


def test_many_frames_at_one_position(case):
    """The time is linear in the number of frames. It was quadratic, and longer than Case.run() allows."""
    frames = 20_000
    c = case("copies")
    ds = make_enhanced()
    ds.Rows = ds.Columns = 2
    ds.NumberOfFrames = frames
    shared = ds.SharedFunctionalGroupsSequence[0]
    shared.PlanePositionSequence = Sequence([item(ImagePositionPatient=[-10, 20, 5])])
    shared.PixelValueTransformationSequence = Sequence([item(RescaleIntercept=-1000, RescaleSlope=1, RescaleType="HU")])
    ds.PerFrameFunctionalGroupsSequence = Sequence([item() for _ in range(frames)])
    ds.PixelData = bytes(2 * 2 * 2 * frames)
    c.save(ds, "0")
    code, out, values = c.run()
    assert code == 0, out
    assert len(out["slices"]) == 1 and (values == -1000).all()


def fragmented(ds, pieces):
    """Writes each frame in so many fragments, with an empty offset table."""
    out = b"\xfe\xff\x00\xe0" + bytes(4)
    frames = list(pydicom.encaps.generate_pixel_data_frame(ds.PixelData, int(ds.get("NumberOfFrames", 1))))
    for frame, count in zip(frames, pieces):
        size = -(-len(frame) // count // 2) * 2
        for part in (frame[k : k + size] for k in range(0, len(frame), size)):
            out += b"\xfe\xff\x00\xe0" + len(part).to_bytes(4, "little") + part
    ds.PixelData = out
    ds["PixelData"].is_undefined_length = True
    return ds


def test_fragments_without_an_offset_table(case):
    for name, tool in (("jpeg_extended", ("dcmcjpeg", "+ee", "+q", "95")), ("jpeg_lossless", ("dcmcjpeg",)), ("jpeg_ls", ("dcmcjpls", "+el")),
                       ("j2k", ("gdcmconv", "--j2k"))):
        c = case(f"whole_{name}")
        file = c.save(make_enhanced(), "all.dcm", tool)
        code, out, want = c.run()
        assert code == 0, out
        for pieces in ((1, 3, 2, 1, 4), (1, 1, 1, 1, 1), (2, 2, 2, 2, 2)):  # of each frame
            ds = fragmented(pydicom.dcmread(file), pieces)
            c = case(f"fragments_{name}_{sum(pieces)}")
            ds.save_as(c.folder / "all.dcm")
            code, out, got = c.run()
            assert code == 0 and (got == want).all(), f"{c.name}: {code} {out}"
    # 11 fragments for two frames, and a fragment that is lost.
    ds = make_enhanced()
    ds.NumberOfFrames, ds.PixelData = 2, ds.PixelData[: 2 * 2 * ROWS * COLUMNS]
    ds.PerFrameFunctionalGroupsSequence = Sequence(list(ds.PerFrameFunctionalGroupsSequence)[:2])
    c = case("two_frames")
    file = c.save(ds, "all.dcm", ("dcmcjpeg", "+ee", "+q", "95"))
    want = c.run()[2]
    ds = fragmented(pydicom.dcmread(file), (5, 6))
    ds.save_as(file)
    code, out, got = c.run()
    assert code == 0 and (got == want).all(), out
    ds.PixelData = ds.PixelData.replace(b"\xff\xd9", b"\xff\x00", 1)  # the end of the first frame
    ds.save_as(file)
    c.refuses("all.dcm", "11 fragments", "cannot be assigned to 2 frames")


def test_pixels_of_other_kinds(case):
    for name, kind, bits in (("FloatPixelData", "<f4", 32), ("DoubleFloatPixelData", "<f8", 64)):
        ds = make_slice(2)
        for key in ("PixelData", "BitsStored", "HighBit", "PixelRepresentation"):
            delattr(ds, key)
        ds.BitsAllocated = bits
        setattr(ds, name, np.zeros((ROWS, COLUMNS), kind).tobytes())
        c = series(case(name))
        ds.save_as(c.folder / "2", write_like_original=False)
        c.refuses("/2", f"floating-point numbers ({name})")
    # Cut off exactly before the pixels.
    c = series(case("no_pixels"))
    whole = (c.folder / "2").read_bytes()
    (c.folder / "2").write_bytes(whole[: whole.rindex(b"\xe0\x7f\x10\x00")])
    c.refuses("/2", "no pixels (PixelData)")
    # Transfer syntaxes that DCMTK does not know: deflated frames, High-Throughput JPEG 2000.
    for uid in ("1.2.840.10008.1.2.8.1", "1.2.840.10008.1.2.4.201"):
        c = series(case("syntax_" + uid))
        file = c.save(make_slice(2), "2", LOSSLESS["gdcm_j2k"])
        body = file.read_bytes()
        assert body.count(b"1.2.840.10008.1.2.4.90") == 1
        at = body.index(b"1.2.840.10008.1.2.4.90") - 2
        value = uid.encode() + b"\0" * (len(uid) % 2)
        old = int.from_bytes(body[at : at + 2], "little")
        body = body[:at] + len(value).to_bytes(2, "little") + value + body[at + 2 + old :]
        group = int.from_bytes(body[140:144], "little") + len(value) - old
        file.write_bytes(body[:140] + group.to_bytes(4, "little") + body[144:])
        c.refuses("/2", "no decoder for its transfer syntax", uid)
