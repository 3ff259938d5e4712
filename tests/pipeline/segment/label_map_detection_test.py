# SPDX-License-Identifier: Apache-2.0
"""A label map given as a CT and a CT given with --labels are recognised by their values and warned of,
naming what was found and what to try; pictures, crops and phantoms that only resemble one are not. Made-up scans, and the real CT
and label maps in TROCAR_REAL_CT, if it has them."""
import nibabel
import numpy as np
import pytest
from mesh_runs import MeshRuns
from PIL import Image
from programs import L3_SCAN, REAL_CT


class DryRun(MeshRuns):
    def nifti(self, name, data):
        nibabel.save(nibabel.Nifti1Image(data, np.diag([-1.0, -1.0, 1.0, 1.0])), self.work / f"{name}.nii")
        return self.work / f"{name}.nii"

    def pngs(self, name, data):
        folder = self.work / name
        folder.mkdir()
        for k in range(data.shape[2]):
            Image.fromarray(data[:, :, k].T.astype(np.uint8)).save(folder / f"{k:03}.png")
        return folder

    def doubts(self, name, *words):
        """What the warnings of these two codes say."""
        code, lines, report, *_ = self.run(*words)
        assert code == 0, f"{name}: exit {code}, {lines}"
        said = {w["code"]: w["where"] + ": " + w["sentence"] for w in report["warnings"] if w["code"].startswith("looks_")}
        lines = [line for line in lines if "looks_" in line]
        assert len(lines) == len(said) and all(any(code in line for line in lines) for code in said), f"{name}: {lines}"
        return said

    def warned(self, name, code, texts, *words):
        said = self.doubts(name, *words)
        assert said is not None and set(said) == {code} and all(text in said[code] for text in texts), f"{name}: {said} lacks {code} or one of {texts}"

    def silent(self, name, *words):
        said = self.doubts(name, *words)
        assert said == {}, f"{name}: {said}"


def blocks(values, size=(40, 40, 6), background=0):
    """Even boxes side by side, one for each value, through all slices."""
    out = np.full(size, background, np.int16)
    for i, value in enumerate(values):
        x = 2 + i * 36 // len(values)
        out[x : x + 36 // len(values), 4 + i % 3 : 34] = value
    return out


def smooth(data, passes):
    """A mean over five pixels, several times: as after a soft kernel."""
    data = data.astype(float)
    for _ in range(passes):
        data = (data + np.roll(data, 1, 0) + np.roll(data, -1, 0) + np.roll(data, 1, 1) + np.roll(data, -1, 1)) / 5
    return data


def made_up_ct():
    """A body in air with bone in it, with noise."""
    rng = np.random.default_rng(7)
    x, y = np.meshgrid(np.arange(96), np.arange(96), indexing="ij")
    r = np.hypot(x - 48, y - 48)
    one = np.where(r < 40, 40.0, -1000.0) + np.where(np.hypot(x - 48, y - 60) < 14, 700, 0) - np.where(np.hypot(x - 30, y - 40) < 10, 900, 0)
    data = np.repeat(smooth(one, 2)[:, :, None], 6, 2)
    return data + rng.normal(0, 20, data.shape)


def window(hu, low, high):
    return np.clip(np.round((hu - low) / (high - low) * 255), 0, 255)


@pytest.fixture(name="t", scope="module")
def dry_run(programs, work):
    return DryRun(programs, work)


def test_label_maps_as_ct(t):
    for name, values, threshold, texts in (
            ("vertebrae", (21, 22, 23), "10", ("the labels 21-23;", "try --labels 21-23 ")),
            ("large_labels", (300, 301, 302), None, ("300-302",)),
            ("brain", (2, 3, 41, 42, 1000, 1001, 2035), None, ("the labels 2-3, 41-42, 1000-1001, 2035;", "--labels 2-3,41-42,1000-1001,2035")),
            ("some", (10, 20, 24), "5", ("10, 20, 24",)),
            ("two", (1, 2), "0.5", ("--labels 1-2",))):
        words = ("--threshold", threshold) if threshold else ()
        for kind in (np.int16, np.float32):
            file = t.nifti(f"{name}_{kind.__name__}", blocks(values).astype(kind))
            t.warned(name, "looks_like_labels", (f"{file.name}: ", "not like HU", *texts), file, *words)
        t.silent(f"{name} as labels", file, "--labels", "all")
    t.warned("equalised", "looks_like_labels", ("21-23",), t.work / "vertebrae_int16.nii", "--equalize", "128")
    # One label a slice, and two.
    data = np.zeros((40, 40, 6), np.int16)
    for k in range(6):
        data[10:30, 10:30, k] = 230 + k // 2
    t.warned("one a slice", "looks_like_labels", ("230-232",), t.nifti("one_a_slice", data))
    t.warned("mask of 255 at 226", "looks_like_labels", ("255",), t.nifti("mask_255", blocks((255,))))


def test_no_label_maps(t):
    """What only resembles one. A phantom of 8 bits, of several materials; a crop; 8 bits, also smoothed."""
    ct = made_up_ct()
    for name, data, words in (
            ("binary phantom", blocks((1000,)), ()),
            ("binary mask", blocks((1,)), ("--threshold", "0.5")),
            ("mask of 255", blocks((255,)), ("--threshold", "127.5")),
            ("phantom with air", blocks((40, 300, 1000), background=-1000), ()),
            ("phantom without air", blocks((50, 400, 1000)), ()),
            ("CT", ct.astype(np.int16), ()),
            ("CT without its air", np.maximum(ct, 0).astype(np.int16), ()),
            ("crop in bone", np.maximum(ct[40:56, 52:68], 0).astype(np.int16), ()),
            ("CT from 0", (ct + 1100).clip(0).astype(np.int16), ("--threshold", "1326")),
            ("8 bits", window(ct, -200, 800).astype(np.uint8), ("--threshold", "120")),
            ("8 bits, wide", window(ct, -1000, 3000).astype(np.uint8), ("--threshold", "90")),
            ("8 bits, narrow", window(ct, 200, 300).astype(np.uint8), ("--threshold", "90")),
            ("8 bits, smooth", window(smooth(ct, 20), -1000, 3000).astype(np.uint8), ("--threshold", "70"))):
        file = t.nifti(name.replace(" ", "_"), data)
        t.silent(name, file, *words)
        t.silent(name + ", a slice", file, *words, "--slices", "2:2")
    for name, data in (("png", window(ct, -200, 800)), ("png_wide", window(ct, -1000, 3000)), ("png_binary", blocks((255,))),
                       ("png_of_levels", blocks((85, 170, 255))), ("png_of_labels", blocks((100, 101, 102)))):
        t.silent(name, t.pngs(name, data), "--spacing", "1,1,1", "--threshold", "90")


def test_offset(t):
    """A CT whose intercept was lost; and the same in HU, without the values below 0."""
    ct = made_up_ct()
    for name, data in (("offset", ct + 1024), ("offset_clipped", (ct + 1024).clip(0)), ("offset_half", (ct * 2).round().clip(-2000) / 2 + 1020)):
        file = t.nifti(name, data.astype(np.float32) if "half" in name else data.round().clip(0).astype(np.int16))
        t.warned(name, "looks_offset", (f"{file.name}: ", "1024", "--threshold"), file)
    t.silent("the same in HU", t.nifti("no_offset", ct.clip(0).round().astype(np.int16)))
    t.silent("much dense bone", t.nifti("dense", np.where(ct > 600, 1040 + ct / 50, ct).clip(0).round().astype(np.int16)))


def test_ct_with_labels(t):
    ct = made_up_ct()
    whole, half = t.nifti("whole", ct.round().astype(np.int16)), t.nifti("half", (ct.clip(0) * 2).round().astype(np.float32) / 2)
    positive = t.nifti("positive", ct.clip(0).round().astype(np.int16))
    for words in (("40",), ("20-60",), ("all",)):
        t.refused(whole, f"{whole.name} slice 0: voxel 0, 0 is -", "which is no label", "without --labels", words=("--labels", *words, "--min-region", "0"))
        t.warned("CT from 0", "looks_like_ct", (f"{positive.name}: ", "HU", f"0 to {int(ct.round().max())}", "without --labels"), positive, "--labels", *words,
                 "--min-region", "0")
    t.warned("a slice of CT", "looks_like_ct", (), positive, "--labels", "all", "--slices", "2:2")
    t.warned("a crop of CT", "looks_like_ct", (), positive, "--labels", "all", "--crop", "40:60,40:60")
    t.warned("8 bits", "looks_like_ct", ("0 to 255",), t.work / "8_bits.nii", "--labels", "all")
    t.warned("PNG", "looks_like_ct", ("grey levels",), t.work / "png", "--spacing", "1,1,1", "--labels", "all")
    soft = t.nifti("soft_labels", smooth(blocks((21, 22, 23)), 1).astype(np.float32))
    for file in (half, soft):  # an interpolated label map, too
        t.refused(file, "which is no label", words=("--labels", "all", "--min-region", "0"))


def test_are_labels(t):
    """What --labels is for."""
    rng = np.random.default_rng(3)
    points = np.zeros((96, 96, 6), np.int16)
    for label in range(1, 25):  # single marked voxels beside one region
        points[tuple(rng.integers(0, 96, 2))][label % 6] = label
    points[20:60, 20:60] = 40
    thin = np.zeros((96, 96, 6), np.int16)
    thin[:, 10:90:6], thin[:, 11:90:6], thin[:, 12:90:6] = 5, 5, 7
    many = np.arange(48 * 48 // 16).reshape(12, 12).repeat(8, 0).repeat(8, 1)[:, :, None].repeat(6, 2).astype(np.int16)
    for name, data in (("points", points), ("thin", thin), ("a hundred labels", many), ("binary", blocks((1,)))):
        t.silent(name, t.nifti(name.replace(" ", "_"), data), "--labels", "all")
    for name, data in (("minus one", blocks((1, 2, 3), background=-1)), ("phantom", blocks((40, 1000), background=-1000))):
        t.refused(t.nifti(name.replace(" ", "_"), data), "voxel 0, 0 is -1", words=("--labels", "all"))
    t.silent("PNG of labels", t.work / "png_of_labels", "--spacing", "1,1,1", "--labels", "100-102")


def test_real(t):
    folder, ct = REAL_CT, L3_SCAN
    if not ct.is_file():
        pytest.skip("no real CT in the folder TROCAR_REAL_CT")
    vertebrae, parts = folder / "sub-ct_seg-vert_label-22_msk.nii.gz", folder / "sub-ct_seg-subreg_label-22_msk.nii.gz"
    for axis in ("transverse", "coronal", "sagittal"):
        along = ("--axis", axis)
        t.warned("vertebrae", "looks_like_labels", ("21-23",), vertebrae, "--threshold", "10", *along)
        t.warned("parts", "looks_like_labels", ("41-50",), parts, "--threshold", "40.5", *along)
        t.silent("vertebrae as labels", vertebrae, "--labels", "22", *along)
        t.silent("parts as labels", parts, "--labels", "41,42", *along)
        t.silent("CT", ct, *along)
        t.refused(ct, "which is no label", "without --labels", words=("--labels", "all", "--min-region", "100", *along))
    t.silent("a crop of parts", parts, "--labels", "all", "--crop", "20:44,20:44", "--slices", "15:25")
    t.silent("a crop of CT", ct, "--crop", "30:44,30:44", "--slices", "20:24")
    hu = np.asanyarray(nibabel.load(ct).dataobj)
    for low, high, threshold in ((-1000, 2000, "105"), (-450, 1050, "116"), (-160, 240, "250")):
        t.silent(f"CT, {low} to {high} in 8 bits", t.nifti(f"real{low}", window(hu, low, high).astype(np.uint8)), "--threshold", threshold)
