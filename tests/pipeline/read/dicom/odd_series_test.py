# SPDX-License-Identifier: Apache-2.0
"""Series that do not hold exactly one stack: an image of another orientation, several volumes at the same positions, parts of one
scan in series of their own, and frames without positions. What is meshed has the areas of the plain stack. pydicom writes the files."""
import copy
import json
import shutil
import subprocess

import pytest

from dicom_variants_test import COLUMNS, ENHANCED_CT, ROWS, STEP, Sequence, item, make_enhanced, pydicom  # skipped without pydicom
from mesh_runs import MeshRuns
from modality_test import series

import numpy as np

COUNT = 4
CORONAL = [1, 0, 0, 0, 0, -1]


@pytest.fixture(name="t", scope="module")
def dry_run(programs, work):
    return Odd(programs, work)


class Odd(MeshRuns):
    def stack(self, folder=None, names="slice", edit=None, height=0, **keys):
        """COUNT slices with a block that grows by 1 px from slice to slice and by `height`; `edit(ds, k)` changes each."""
        folder = series(folder or self.folder(), count=COUNT, names=names, **keys)
        for k in range(COUNT):
            file = folder / f"{names}{k}.dcm"
            ds = pydicom.dcmread(file)
            block = np.full((ROWS, COLUMNS), -1000, "<i2")
            block[10 : 30 + height, 10 : 40 + k] = 500
            ds.PixelData = block.tobytes()
            if edit:
                edit(ds, k)
            ds.save_as(file)
        return folder

    def areas(self, *words, codes=()):
        """The areas of the slices; the warnings must have these codes."""
        code, lines, report, *_ = self.run(*words)
        assert code == 0, lines
        assert sorted({w["code"] for w in report["warnings"]}) == sorted(codes), report["warnings"]
        return [s["area_mm2"] for s in report["slices"]]

    def list(self, folder, expect=0):
        done = subprocess.run([self.mesh, "list", folder, "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False, timeout=60)
        assert done.returncode == expect, done.stderr
        return json.loads(done.stdout)["scans"]

    def table(self, folder):
        return subprocess.run([self.mesh, "list", folder], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False, timeout=60).stdout

    def fails(self, code, texts, scan, *words):
        return self.refused(scan, *texts, words=words, code=code)


@pytest.fixture(name="plain", scope="module")
def plain_areas(t):
    return t.areas(t.stack())


def turn(orientation=tuple(CORONAL)):
    def edit(ds, k):
        ds.ImageOrientationPatient = list(orientation)
    return edit


def put(folder, name, source, edit):
    """Writes an edited copy of a slice."""
    ds = pydicom.dcmread(source)
    edit(ds, 0)
    ds.SOPInstanceUID = ds.file_meta.MediaStorageSOPInstanceUID = f"1.2.99.{abs(hash(name)) % 10**9}"
    ds.save_as(folder / name)


@pytest.mark.parametrize("name", ["a_first.dcm", "z_last.dcm"])
def test_an_image_of_another_orientation(t, plain, name):
    folder = t.stack()
    put(folder, name, folder / "slice2.dcm", turn())
    assert t.areas(folder, codes=["other_orientation"]) == plain
    code, lines, report, *_ = t.run(folder)
    assert code == 0 and len(lines) == 1 and name in lines[0], lines
    assert report["warnings"][0]["where"].endswith(name), report["warnings"]
    assert [(scan["slices"], scan["taken"]) for scan in t.list(folder)] == [(COUNT, True)]


def test_the_odd_image_is_blamed(t):
    # It takes the place of a slice, which would be lost.
    folder = t.stack()
    put(folder, "a.dcm", folder / "slice2.dcm", turn())
    (folder / "slice2.dcm").unlink()
    said = t.fails(3, ("/a.dcm: its orientation differs", "1 of 4 slices", "give the other files by their names"), folder)
    assert said.startswith(f"trocar-mesh: {folder}/a.dcm"), said
    assert "a.dcm: its orientation" in t.list(folder, expect=3)[0]["problem"]
    for what, edit in (("size", lambda ds, k: (setattr(ds, "Rows", ROWS // 2), setattr(ds, "PixelData", bytes(ROWS // 2 * COLUMNS * 2)))),
                       ("pixel spacing", lambda ds, k: setattr(ds, "PixelSpacing", [2, 2])),
                       ("frame of reference", lambda ds, k: setattr(ds, "FrameOfReferenceUID", "1.2.3"))):
        folder = t.stack()
        put(folder, "a.dcm", folder / "slice2.dcm", edit)
        said = t.fails(3, (f"its {what} differs", "by their names"), folder)
        assert said.startswith(f"trocar-mesh: {folder}/a.dcm"), said
    # Two stacks in one series: neither is odd.
    folder = t.stack()
    for k in range(COUNT):
        put(folder, f"coronal{k}.dcm", folder / f"slice{k}.dcm", turn())
    t.fails(3, ("its orientation differs", f"{COUNT} of {2 * COUNT} slices"), folder)
    # Slightly turned is not another view.
    folder = t.stack()
    put(folder, "a.dcm", folder / "slice2.dcm", turn((1, 0, 0, 0, 0.9998, 0.02)))
    t.fails(3, ("a.dcm: its orientation differs",), folder)


PHASES = {
    "AcquisitionNumber": lambda phase, k: phase + 1,
    "TemporalPositionIdentifier": lambda phase, k: 9 + phase,  # 9 and 10: by number
    "AcquisitionTime": lambda phase, k: f"12{phase}000",
    "ContentTime": lambda phase, k: f"12{phase}00{k}",  # of each slice
    "TriggerTime": lambda phase, k: 100 * phase + k,
    "EchoTime": lambda phase, k: 1.5 + phase,
    "KVP": lambda phase, k: 80 + 60 * phase,
    "InstanceNumber": lambda phase, k: COUNT * phase + k + 1,
}


@pytest.mark.parametrize("name", PHASES)
def test_two_volumes_in_a_series(t, plain, name):
    folder = t.folder()
    for phase, names in ((0, "z"), (1, "a")):  # the files of the second come first
        t.stack(folder, names, lambda ds, k, phase=phase: (
            setattr(ds, name, PHASES[name](phase, k)), setattr(ds, "SOPInstanceUID", f"1.2.{phase}.{k}")), height=5 * phase)
    other = t.areas(t.stack(height=5))
    assert other != plain
    t.fails(2, ("holds 2 volumes", name, f"{COUNT} slices", "0:1 with --volume"), folder)
    assert t.areas(folder, "--volume", "0") == plain
    assert t.areas(folder, "--volume", "1", "--series", "1.2.3.4") == other
    t.fails(2, ("--volume 2 is outside 0:1",), folder, "--volume", "2")
    scans = t.list(folder)
    assert [(s["volume"], s["slices"], s["usable"], s["taken"], s["evenly_spaced"]) for s in scans] == [(k, COUNT, True, False, True) for k in (0, 1)]
    assert all(name in s["volume_name"] for s in scans)
    table = t.table(folder)
    assert "volume" in table.splitlines()[0] and "--volume" in table.splitlines()[-1] and table.count(name) == 2, table


def test_volumes_in_a_collection(t, plain):
    folder = t.folder()
    for phase, names in ((0, "z"), (1, "a")):
        t.stack(folder, names, lambda ds, k, phase=phase: setattr(ds, "AcquisitionNumber", phase), height=5 * phase)
    done = subprocess.run([t.mesh, "list", folder, "--manifest"], stdout=subprocess.PIPE, check=True, timeout=60, cwd=t.work)
    scans = json.loads(done.stdout)["scans"]
    assert [s["parameters"] for s in scans] == [{"volume": 0}, {"volume": 1}] and scans[0]["name"] != scans[1]["name"], scans
    (t.work / "volumes.json").write_bytes(done.stdout)
    subprocess.run([t.mesh, "batch", t.work / "volumes.json", "-o", t.work / "volumes", "--quiet"], check=True, timeout=60)
    report = json.loads((t.work / "volumes" / "reports" / f"{scans[0]['name']}.json").read_bytes())
    assert [s["area_mm2"] for s in report["slices"]] == plain


def test_volumes_that_are_not_alike(t, plain):
    # The second covers a part; one of its slices is equal to that of the first.
    folder = t.folder()
    t.stack(folder, "a", lambda ds, k: setattr(ds, "AcquisitionNumber", 1))
    t.stack(folder, "b", lambda ds, k: setattr(ds, "AcquisitionNumber", 2), height=5)
    (folder / "b3.dcm").unlink()
    put(folder, "b2.dcm", folder / "a2.dcm", lambda ds, k: setattr(ds, "AcquisitionNumber", 2))
    t.fails(2, ("holds 2 volumes", "0 (AcquisitionNumber 1, 4 slices), 1 (AcquisitionNumber 2, 3 slices)"), folder)
    assert t.areas(folder, "--volume", "0") == plain
    assert len(t.areas(folder, "--volume", "1")) == 3
    # Copies under another number are copies.
    folder = t.folder()
    t.stack(folder, "a", lambda ds, k: setattr(ds, "AcquisitionNumber", 1))
    t.stack(folder, "b", lambda ds, k: setattr(ds, "AcquisitionNumber", 2))
    assert t.areas(folder, codes=["copied_slice"]) == plain
    # The table has moved a little, or by a part of a slice.
    for name, shift in (("AcquisitionNumber", 0.005), ("TemporalPositionIdentifier", 0.3)):
        folder = t.folder()
        t.stack(folder, "a", lambda ds, k, name=name: setattr(ds, name, 1))
        t.stack(folder, "b", lambda ds, k, name=name, shift=shift: (
            setattr(ds, name, 2), setattr(ds, "ImagePositionPatient", [-10, 20, 5 + STEP * k + shift])), height=5)
        t.fails(2, ("holds 2 volumes", f"{name} 1, {COUNT} slices"), folder)
        assert t.areas(folder, "--volume", "0") == plain
    # Nothing tells the slices apart.
    folder = t.folder()
    t.stack(folder, "a")
    t.stack(folder, "b", height=5)
    t.fails(3, ("at the same position as",), folder)
    t.fails(2, ("is none",), t.stack(), "--volume", "0")


def test_volumes_in_an_enhanced_image(t):
    folder = t.folder()
    ds = make_enhanced()
    data, groups = ds.PixelData, list(ds.PerFrameFunctionalGroupsSequence)
    both = []
    for phase in (2, 1):
        for group in groups:
            own = copy.deepcopy(group)  # a Dataset of a Dataset shares its elements
            own.FrameContentSequence = Sequence([item(TemporalPositionIndex=phase)])
            both.append(own)
    ds.PerFrameFunctionalGroupsSequence = Sequence(both)
    ds.NumberOfFrames, ds.PixelData = len(both), data + bytes(len(data))
    ds.save_as(folder / "all.dcm", write_like_original=False)
    t.fails(2, ("holds 2 volumes", "TemporalPositionIndex 1, 5 slices"), folder)
    assert [s["volume"] for s in t.list(folder)] == [0, 1]
    code, lines, report, *_ = t.run(folder, "--volume", "1", "--threshold", "100")
    assert code == 0 and len(report["slices"]) == 5, lines


def own_series(ds, k):
    ds.SeriesInstanceUID = f"1.2.40.{k + 1}"
    ds.SeriesNumber = 3


def test_each_slice_in_its_own_series(t, plain):
    folder = t.stack(edit=own_series)
    assert t.areas(folder, codes=["joined_series"]) == plain
    assert t.areas(folder, "--series", "1.2.40.3", codes=["joined_series"]) == plain
    assert [(s["slices"], s["taken"], s["uid"]) for s in t.list(folder)] == [(COUNT, True, "1.2.40.1")]
    # With other series beside it: a scout, and a scan that overlaps.
    series(folder, uid="1.2.41", names="scout", count=1, ImageType=["ORIGINAL", "PRIMARY", "LOCALIZER"])
    series(folder, uid="1.2.42", names="other", count=2, SeriesDescription="other")
    assert t.areas(folder, codes=["joined_series", "localiser", "other_series"]) == plain
    # Each with a number of its own.
    folder = t.stack(edit=lambda ds, k: (own_series(ds, k), setattr(ds, "SeriesNumber", k + 1)))
    assert t.areas(folder, codes=["joined_series"]) == plain
    # One is missing; one is broken.
    (folder / "slice1.dcm").unlink()
    assert len(t.areas(folder, codes=["joined_series", "uneven_spacing"])) == COUNT - 1
    file = folder / "slice2.dcm"
    file.write_bytes(file.read_bytes()[:-100])
    t.fails(3, ("slice2.dcm", "truncated"), folder)
    # Two parts with two slices each.
    folder = t.stack(edit=lambda ds, k: own_series(ds, k // 2))
    assert t.areas(folder, codes=["joined_series"]) == plain


def test_series_that_are_no_parts_of_one_scan(t, plain):
    # Two kernels, each slice in its own series: two scans.
    folder = t.folder()
    for n, kernel in ((1, "H30s"), (2, "H60s")):
        t.stack(folder, kernel, lambda ds, k, n=n, kernel=kernel: (
            setattr(ds, "SeriesInstanceUID", f"1.2.50.{n}.{k}"), setattr(ds, "SeriesNumber", n), setattr(ds, "ConvolutionKernel", kernel)), height=5 * (n - 1))
    assert t.areas(folder, codes=["joined_series", "other_series"]) == plain
    assert [(s["kernel"], s["slices"]) for s in t.list(folder)] == [("H30s", COUNT), ("H60s", COUNT)]
    # Two reconstructions that lie between each other's slices, and two stations with a gap.
    for shift in (STEP / 2, STEP * COUNT * 2):
        folder = t.folder()
        for n in (1, 2):
            t.stack(folder, f"n{n}", lambda ds, k, n=n, shift=shift: (
                setattr(ds, "SeriesInstanceUID", f"1.2.51.{n}"), setattr(ds, "SeriesNumber", 4),
                setattr(ds, "ImagePositionPatient", [-10, 20, 5 + STEP * k + (n - 1) * shift])))
        assert t.areas(folder, codes=["other_series"]) == plain
        assert [s["slices"] for s in t.list(folder)] == [COUNT, COUNT]
    # Single slices that differ are refused: one of them is no scan.
    for what, edit in (("frame of reference", lambda ds, k: setattr(ds, "FrameOfReferenceUID", f"1.2.3.{k}")),
                       ("description", lambda ds, k: setattr(ds, "SeriesDescription", f"slice {k}")),
                       ("positions", lambda ds, k: setattr(ds, "ImagePositionPatient", [-10, 20, k ** 1.5]))):
        folder = t.stack(edit=lambda ds, k, edit=edit: (own_series(ds, k), edit(ds, k)))
        t.fails(3, ("single slice each", f"they differ in {what}", "--series"), folder)
        assert len(t.list(folder)) == COUNT and not any(s["taken"] for s in t.list(folder))
        assert len(t.areas(folder, "--series", "1.2.40.1")) == 1
    # Two phases of which each slice has its own series.
    folder = t.folder()
    for phase in (0, 1):
        t.stack(folder, f"p{phase}", lambda ds, k, phase=phase: (
            setattr(ds, "SeriesInstanceUID", f"1.2.52.{phase}.{k}"), setattr(ds, "AcquisitionNumber", phase)), height=5 * phase)
    assert t.areas(folder, "--volume", "0", codes=["joined_series"]) == plain


def multi_frame(t, **keys):
    """The plain stack as one file without functional groups. A key with None is left out."""
    files = sorted(t.stack().glob("*.dcm"))
    frames = [pydicom.dcmread(file) for file in files]
    ds = frames[0]
    ds.NumberOfFrames, ds.SpacingBetweenSlices = COUNT, STEP
    ds.PixelData = b"".join(frame.PixelData for frame in frames)
    for name, value in keys.items():
        if value is not None:
            setattr(ds, name, value)
        elif name in ds:
            delattr(ds, name)
    ds.file_meta.MediaStorageSOPClassUID = ds.SOPClassUID
    file = t.folder() / "all.dcm"
    ds.save_as(file)
    return file


def test_frames_without_positions(t, plain):
    file = multi_frame(t)
    code, lines, report, *_ = t.run(file)
    assert code == 0 and [s["area_mm2"] for s in report["slices"]] == plain, lines
    assert np.allclose([s["z_mm"] for s in report["slices"]], [5 + STEP * k for k in range(COUNT)])
    assert len(lines) == 1 and "(assumed_direction)" in lines[0] and "1.25 mm apart (SpacingBetweenSlices)" in lines[0], lines
    assert [(s["slices"], s["usable"], s["spacing_mm"][2]) for s in t.list(file)] == [(COUNT, True, STEP)]
    packed = file.with_name("rle.dcm")
    subprocess.run(["dcmcrle", file, packed], check=True)
    assert t.areas(packed, codes=["assumed_direction"]) == plain
    capture = "1.2.840.10008.5.1.4.1.1.7.3"  # word secondary capture, as cone beam scanners write it
    assert t.areas(multi_frame(t, SOPClassUID=capture), codes=["assumed_direction"]) == plain
    thick = multi_frame(t, SpacingBetweenSlices=None, SliceThickness=2)
    assert "2 mm apart (SliceThickness" in t.run(thick)[1][0] and t.areas(thick, codes=["assumed_direction"]) == plain
    given = multi_frame(t, SpacingBetweenSlices=None)
    assert t.areas(given, "--spacing", "9,9,2", codes=["assumed_direction", "spacing_ignored"]) == plain
    t.fails(3, ("4 frames", "SpacingBetweenSlices", "--spacing"), given)
    t.fails(3, ("4 frames", "FrameIncrementPointer"), multi_frame(t, FrameIncrementPointer=0x00181063, FrameTime=40))
    t.fails(3, ("4 frames", "no image position"), multi_frame(t, ImagePositionPatient=None))
    t.fails(3, ("100000 frames", "at most"), multi_frame(t, NumberOfFrames=100000))
    shutil.rmtree(file.parent)


def test_frames_with_shared_groups_only(t):
    ds = make_enhanced()
    del ds.PerFrameFunctionalGroupsSequence
    shared = ds.SharedFunctionalGroupsSequence[0]
    shared.PlanePositionSequence = Sequence([item(ImagePositionPatient=[-10, 20, 5])])
    shared.PixelMeasuresSequence[0].SpacingBetweenSlices = STEP
    assert ds.SOPClassUID == ENHANCED_CT
    ds.RescaleSlope, ds.RescaleIntercept = 1, 0
    file = t.folder() / "all.dcm"
    ds.save_as(file, write_like_original=False)
    code, lines, report, *_ = t.run(file, "--threshold", "2000")
    assert code == 0 and np.allclose([s["z_mm"] for s in report["slices"]], [5 + STEP * k for k in range(5)]), lines
