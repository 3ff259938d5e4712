# SPDX-License-Identifier: Apache-2.0
"""Folders as hospitals and CDs have them: sub-folders, several series, a DICOMDIR, stray
files. What trocar-mesh takes from them and says of it, `trocar-mesh list` and --series."""
import json
import os
import re
import shutil
import subprocess

import pytest
from exported import schema_of
from programs import run

pydicom = pytest.importorskip("pydicom")
from pydicom.uid import generate_uid  # noqa: E402

SLICES, SIZE = 9, 128


class Studies:
    def __init__(self, programs, work):
        self.programs, self.mesh, self.work = programs, programs / "trocar-mesh", work
        subprocess.run([programs / "trocar-sample-ct", work / "scan", "--size", str(SIZE), "--slices", str(SLICES), "--quiet"], check=True)
        self.scan = work / "scan"
        self.schema = schema_of("list")
        self.plain = self.asset(self.scan / "dicom")

    def run(self, *words, **keys):
        return run(self.mesh, *words, timeout=60, **keys)

    def refuses(self, code, texts, *words):
        """Expects this exit code, and one line on stderr that contains all `texts`."""
        said = self.run(*words, expect=code).stderr
        assert len(said.splitlines()) == 1 and all(text in said for text in texts), f"{words}: {said!r} lacks one of {texts}"

    def asset(self, *words):
        """The bytes of the asset."""
        out = self.work / "out.glb"
        out.unlink(missing_ok=True)
        self.run(*words, "-o", out, "--quiet")
        return out.read_bytes() if out.exists() else b"none"

    def warnings(self, *words):
        """What is said of each code, and the series that the report names."""
        out, report = self.work / "out.glb", self.work / "out.json"
        report.unlink(missing_ok=True)
        said = self.run(*words, "-o", out, "--report", report).stderr.splitlines()
        assert len(said) == len({line.split(")")[0] for line in said}), f"two lines of a kind: {said}"
        made = json.loads(report.read_bytes()) if report.exists() else {"warnings": [], "input": {}}
        assert str(self.work) not in json.dumps(made), f"{words}: a path in the report: {made['warnings']}"
        codes = (re.search(r"warning \((\w+)\): (.*)", line) for line in said)
        return {found[1]: found[2] for found in codes if found}, made["input"].get("series")

    def list(self, folder, expect=0):
        """The scans that `list --json` names, by number or path, and those that it marks."""
        done = self.run("list", folder, "--json", expect=expect)
        made = json.loads(done.stdout) if done.stdout else {"scans": []}
        if done.stdout:
            for error in list(self.schema.iter_errors(made))[:3]:
                pytest.fail(f"list {folder}: {error.json_path}: {error.message[:300]}")
        return {scan.get("number") or scan["path"]: scan for scan in made["scans"]}, made

    def series(self, folder, number, description, slices=range(SLICES), edit=None, **keys):
        """Writes slices of the sample as a series of its own."""
        folder.mkdir(parents=True, exist_ok=True)
        for k in slices:
            ds = pydicom.dcmread(self.scan / "dicom" / f"CT_{k + 1:03}.dcm")
            ds.SeriesInstanceUID = f"1.2.826.0.1.3680043.10.77.{number}"
            ds.SOPInstanceUID = ds.file_meta.MediaStorageSOPInstanceUID = generate_uid(entropy_srcs=[f"{number} {k}"])
            ds.SeriesNumber, ds.SeriesDescription = number, description
            for name, value in keys.items():
                setattr(ds, name, value)
            if edit:
                edit(ds, k)
            ds.save_as(folder / f"IM{k:06}")
        return folder


def make_dicomdir(folder, *slices):
    run("dcmmkdir", "+r", "-Nxc", "-W", "-Nrc", "-Nec", "+I", "+D", "DICOMDIR", "+id", *slices, cwd=folder, expect=None)
    assert (folder / "DICOMDIR").exists(), "dcmmkdir made none"


def litter(folder):
    """What lies beside the slices on CDs, in exports and in folders that somebody opened."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in (("Thumbs.db", b"\xd0\xcf\x11\xe0" + bytes(600)), ("desktop.ini", b"[.ShellClassInfo]"), (".DS_Store", b"\0\0\0\1Bud1"),
                          ("report.pdf", b"%PDF-1.4\n"), ("dose.json", b"{}"), ("README", b"open VIEWER.EXE\n"), ("VIEWER.EXE", b"MZ" + bytes(4000)),
                          ("empty", b""), ("._IM000001", b"\0\5\x16\7" + bytes(200))):
        (folder / name).write_bytes(content)


@pytest.fixture(name="s", scope="module")
def studies(programs, work):
    return Studies(programs, work)


def test_finds_the_slices(s):
    """Sub-folders, stray files, links and a DICOMDIR change nothing: the asset is that of the slices alone, byte for byte."""
    study = s.work / "study"
    for k in range(SLICES):  # over two sub-folders, as some archives store them
        folder = study / "DICOM" / "PA000001" / "ST000001" / f"SE00000{1 + k // 5}"
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copy(s.scan / "dicom" / f"CT_{k + 1:03}.dcm", folder / f"IM{k:06}")
    assert s.asset(study) == s.plain, "slices in sub-folders give another asset"
    (study / "DICOM" / "loop").symlink_to(study)
    (study / "again").symlink_to(study / "DICOM" / "PA000001")
    os.mkfifo(study / "pipe")
    assert s.asset(study) == s.plain, "links give another asset"
    for place in (study, study / "DICOM", study / "DICOM" / "PA000001" / "ST000001" / "SE000001", study / ".trash"):
        litter(place)
    (study / ".trash" / "IM000000").write_bytes((s.scan / "dicom" / "CT_001.dcm").read_bytes())
    make_dicomdir(study, "DICOM/PA000001", "+p", "IM*")
    assert s.asset(study) == s.plain, "stray files give another asset"
    said, _ = s.warnings(study)
    assert set(said) == {"not_dicom"} and "DICOMDIR" not in said["not_dicom"] and "Thumbs.db" not in said["not_dicom"], f"stray files: {said}"
    assert s.asset(study / "DICOMDIR") == s.plain, "a DICOMDIR does not stand for its folder"
    # Pictures and volumes beside the slices do not decide either, but it is said.
    (study / "jpeg").mkdir()
    for k in range(2 * SLICES):
        shutil.copy(s.scan / "png" / "slice_001.png", study / "jpeg" / f"{k}.png")
    shutil.copy(s.scan / "sample.nii.gz", study / "other.nii.gz")
    assert s.asset(study) == s.plain, "pictures beside the slices give another asset"
    said, _ = s.warnings(study)
    assert all(text in said.get("other_input", "") for text in ("18 images", "other.nii.gz", "DICOM")), f"left out: {said}"
    # A file that the storage does not give is not taken for a stray file: it may be a slice.
    lost = study / "DICOM" / "LOST"
    lost.symlink_to("/proc/self/mem")
    s.refuses(3, ("DICOM/LOST: Input/output error",), study, "-o", s.work / "none.glb")
    lost.unlink()
    # Nor is a damaged slice.
    whole = (study / "DICOM" / "PA000001" / "ST000001" / "SE000002" / "IM000006").read_bytes()
    (study / "DICOM" / "PA000001" / "ST000001" / "SE000002" / "IM000006").write_bytes(whole[:-500])
    s.refuses(3, ("SE000002/IM000006: ", "truncated"), study, "-o", s.work / "none.glb")
    # A volume and its sidecar; several volumes; images.
    volume = s.work / "volume"
    litter(volume / "deep")
    shutil.copy(s.scan / "sample.nii.gz", volume / "deep" / "ct.nii.gz")
    (volume / "deep" / "ct.json").write_text("{}")
    shutil.copy(s.scan / "png" / "slice_001.png", volume / "preview.png")
    assert s.asset(volume) == s.asset(s.scan / "sample.nii.gz"), "a volume in a folder gives another asset"
    shutil.copy(s.scan / "sample.nii.gz", volume / "second.nii.gz")
    s.refuses(2, ("ct.nii.gz", "second.nii.gz", "give one of them"), volume, "-o", s.work / "none.glb")
    pictures = s.work / "pictures"
    litter(pictures)
    shutil.copytree(s.scan / "png", pictures / "slices")
    grey = ("--spacing", "1.25,1.25,1", "--threshold", "95.2")
    assert s.asset(pictures, *grey) == s.asset(s.scan / "png", *grey), "images in a sub-folder give another asset"
    shutil.copytree(s.scan / "png", pictures / "more")
    s.refuses(2, ("pictures/more", "pictures/slices", "give one of them"), pictures, "-o", s.work / "none.glb", *grey)
    nothing = s.work / "nothing"
    litter(nothing)
    s.refuses(3, ("nothing", "no DICOM images"), nothing, "-o", s.work / "none.glb")


def test_files_that_cannot_be_read(s):
    """A link that leads nowhere is no reason to take the rest for the scan, wherever its slice would lie."""
    out = ("-o", s.work / "none.glb")
    for places in ((1,), (5,), (SLICES,), (2, 3, 7)):
        study = s.work / "links"
        shutil.rmtree(study, ignore_errors=True)
        shutil.copytree(s.scan / "dicom", study)
        for k in places:
            (study / f"CT_{k:03}.dcm").unlink()
            (study / f"CT_{k:03}.dcm").symlink_to("nowhere")
        said = (f"links/CT_{places[0]:03}.dcm: No such file or directory (a link that leads nowhere)",)
        if len(places) > 1:
            said += ("and 2 more files that cannot be read",)
        s.refuses(3, said, study, *out)
        s.refuses(3, said, "list", study)
        s.refuses(3, said, "list", study, "--manifest")
    collection, store = s.work / "links.json", s.work / "links_store"
    collection.write_text(json.dumps({"schema": "trocar.collection/1", "scans": [{"name": "links", "input": "links"}]}))
    summary = json.loads(s.run("batch", collection, "-o", store, "--json", expect=3).stdout)
    assert summary["failed"] == 1 and "leads nowhere" in str(summary["failures"]), summary
    for k in places:  # once they lead to the slices, the scan is made
        (study / f"CT_{k:03}.dcm").unlink()
        (study / f"CT_{k:03}.dcm").symlink_to(s.scan / "dicom" / f"CT_{k:03}.dcm")
    summary = json.loads(s.run("batch", collection, "-o", store, "--json").stdout)
    assert summary["made"] == 1 and (store / "assets" / "links.glb").read_bytes() == s.plain, summary
    # Links to themselves, and below a folder that is none.
    (study / "loop").symlink_to("loop")
    s.refuses(3, ("links/loop: Too many levels of symbolic links",), study, *out)
    (study / "loop").unlink()
    (study / "part").symlink_to(study / "CT_001.dcm" / "part")
    s.refuses(3, ("links/part: Not a directory",), study, *out)
    (study / "part").unlink()
    # The name of a document, of a picture or of a volume: it is not wanted, but named.
    for name, code in (("notes.txt", "not_read"), ("view.png", "other_input"), ("view.nii.gz", "other_input")):
        (study / name).symlink_to("nowhere")
        assert s.asset(study) == s.plain
        assert name in s.warnings(study)[0].get(code, ""), name
        # A name that is no part of the scan stays out of the report, which may be passed on.
        assert (name if code == "not_read" else code) in (s.work / "out.json").read_text()
        s.run("list", study)
        s.run("batch", collection, "-o", store, "--quiet")
        (study / name).unlink()
    # What a DICOMDIR names is wanted, too.
    (study / "CT").mkdir()
    for k in range(1, SLICES + 1):
        (study / f"CT_{k:03}.dcm").unlink()
        shutil.copy(s.scan / "dicom" / f"CT_{k:03}.dcm", study / "CT" / f"IM{k:03}")
    make_dicomdir(study, "CT")
    assert "missing_file" not in s.warnings(study)[0]
    (study / "CT" / "IM001").rename(study / "CT" / "im001;1")  # as some systems show a CD
    assert "missing_file" not in s.warnings(study)[0]
    for k in (2, 9):
        (study / "CT" / f"IM{k:03}").unlink()
    line = s.warnings(study / "DICOMDIR")[0].get("missing_file", "")
    assert "names 2 images that are not in the folder" in line and "IM002" in line, line
    assert "missing_file" in s.run("list", study).stderr


def test_folders_that_cannot_be_read(s):
    """Without permission: refused, except for those of a file system."""
    user = 65534 if os.geteuid() == 0 else None
    study = s.work / "closed"
    (study / "part").mkdir(parents=True)
    for k in range(SLICES):
        shutil.copy(s.scan / "dicom" / f"CT_{k + 1:03}.dcm", study / ("part" if k > 5 else ".") / f"{k}")
    if user and subprocess.run(["test", "-r", study / "0", "-a", "-x", s.mesh], user=user, check=False).returncode != 0:
        pytest.skip("the other user has no access to the folder of the test")
    keys = {"user": user} if user else {}
    (study / "part").chmod(0)
    try:
        (study / "out").mkdir(mode=0o777)
        (study / "out").chmod(0o777)
        for words in ((study, "-o", study / "out" / "x.glb"), ("list", study)):
            said = s.run(*words, expect=3, **keys).stderr
            assert "closed/part: Permission denied" in said and len(said.splitlines()) == 1, said
        (study / "part").chmod(0o755)
        (study / "lost+found").mkdir(mode=0)
        assert "(folder_left_out)" in s.run("list", study, **keys).stderr
    finally:
        for folder in (study / "part", study / "lost+found"):
            if folder.exists():
                folder.chmod(0o755)


def test_dicomdir_in_a_collection(s):
    """A batch sees all files for which a DICOMDIR stands: it makes the scan once, and again if a slice changes."""
    slices = s.work / "cd" / "DICOM" / "A"
    slices.mkdir(parents=True)
    for k in range(SLICES):
        shutil.copy(s.scan / "dicom" / f"CT_{k + 1:03}.dcm", slices / f"IM{k:06}")
    make_dicomdir(s.work / "cd", "DICOM/A", "+p", "IM*")
    collection, store = s.work / "cd.json", s.work / "cd_store"
    collection.write_text(json.dumps({"schema": "trocar.collection/1", "scans": [{"name": "cd", "input": "cd/DICOMDIR"}]}))

    def counts():
        summary = json.loads(s.run("batch", collection, "-o", store, "--json").stdout)
        return summary["made"], summary["unchanged"]

    assert counts() == (1, 0)
    assert (store / "assets" / "cd.glb").read_bytes() == s.plain, "a DICOMDIR does not stand for its folder"
    assert counts() == (0, 1)
    ds = pydicom.dcmread(slices / "IM000003")
    ds.PixelData = bytes([ds.PixelData[0] ^ 1]) + ds.PixelData[1:]
    ds.save_as(slices / "IM000003")
    assert counts() == (1, 0), "a changed slice went unnoticed"


def test_chooses(s):
    """One line says which series was taken and why; a CT series comes before larger ones of other modalities."""
    study = s.work / "several"
    s.series(study / "a", 5, "Soft H30s", ConvolutionKernel="H30s")
    s.series(study / "b", 4, "Bone H60s", ConvolutionKernel="H60s")
    s.series(study / "c", 7, "Thick", range(0, SLICES, 3))
    said, taken = s.warnings(study)
    line = said.get("other_series", "")
    for text in ("series 4 'Bone H60s'", "lowest number of the 2 CT series", "9 slices", "5 'Soft H30s'", "7 'Thick'", "--series"):
        assert text in line, f"equals: {line!r} lacks {text!r}"
    assert taken == {"number": 4, "kernel": "H60s", "modality": "CT"}, f"the report names {taken}"
    (study / "c" / "IM000099").write_bytes(b"")
    s.series(study / "d", 3, "Thin", range(SLICES), lambda ds, k: setattr(ds, "Modality", "MR"))
    s.series(study / "e", 1, "Topogram", range(1), ImageType=["ORIGINAL", "PRIMARY", "LOCALIZER"])
    assert "series 4 " in s.warnings(study)[0].get("other_series", ""), "an MR of a lower number was taken"
    for name in "ab":
        shutil.rmtree(study / name)
    line = s.warnings(study)[0].get("other_series", "")
    assert "series 7 'Thick'" in line and "only CT" in line and "3 'Thin'" in line, f"the only CT: {line!r}"
    # Screen captures without a position are not slices, however many there are.
    def capture(ds, k):
        ds.SOPClassUID = ds.file_meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.7"
        del ds.ImagePositionPatient
    s.series(study / "f", 99, "Captures", range(SLICES), capture)
    assert "series 7 'Thick'" in s.warnings(study)[0].get("other_series", ""), "captures were taken"
    # Two patients in one folder: nothing says which is meant but the number of slices; it is said that there are two.
    two = s.work / "two"
    s.series(two / "a", 2, "Head", range(SLICES))
    s.series(two / "b", 2, "Head", range(4), lambda ds, k: (setattr(ds, "StudyInstanceUID", "1.2.3"), setattr(ds, "SeriesInstanceUID", "1.2.3.4")))
    assert "study" in s.run("list", two).stdout.splitlines()[0], "the list does not tell studies apart"
    assert "2 studies" in s.warnings(two)[0].get("other_series", ""), "two studies were not told"


def test_lists(s):
    """`list` names what there is, marks what is taken, and reads headers only."""
    study = s.work / "listed"

    def tilt(ds, k):
        x, y, z = ds.ImagePositionPatient
        ds.ImagePositionPatient = [x, float(y) + 0.25 * k, z]

    s.series(study / "DICOM" / "A", 2, "Sch\u00e4del H60s", ConvolutionKernel="H60s", SpecificCharacterSet="ISO_IR 100")
    s.series(study / "DICOM" / "B", 3, "Tilted", range(5), tilt)
    s.series(study / "DICOM" / "C", 9, "PET", range(3), Modality="PT")
    s.series(study / "DICOM" / "D", 1, "Topogram", range(1), ImageType=["ORIGINAL", "PRIMARY", "LOCALIZER"])
    s.series(study / "DICOM" / "E", 8, "Twice", (1, 2))
    s.series(s.work / "again", 8, "Twice", (1,), lambda ds, k: setattr(ds, "PixelData", bytes([ds.PixelData[0] ^ 1]) + ds.PixelData[1:]),
             ImageComments="another header, too")
    shutil.move(s.work / "again" / "IM000001", study / "DICOM" / "E" / "copy")
    shutil.copy(s.scan / "sample.nii.gz", study / "ct.nii.gz")
    shutil.copytree(s.scan / "png", study / "png")
    litter(study)
    scans, whole = s.list(study)
    assert whole.get("schema") == "trocar.list/1" and whole.get("folder") == "listed", f"{whole.get('schema')} {whole.get('folder')}"
    assert str(s.work) not in json.dumps(whole), "a path in the list"
    for wrong in ({**whole, "more": 1}, {**whole, "scans": []}, {**whole, "scans": [{**whole["scans"][0], "path": "/home"}]},
                  {**whole, "scans": [{k: v for k, v in whole["scans"][0].items() if k != "kernel"}]}):
        assert not s.schema.is_valid(wrong), "the schema accepts anything"
    want = {2: ("dicom", "Sch\u00e4del H60s", "H60s", "CT", SLICES, 0, True), 3: ("dicom", "Tilted", None, "CT", 5, 14.036, True),
            9: ("dicom", "PET", None, "PT", 3, 0, False), 1: ("dicom", "Topogram", None, "CT", 1, None, False), 8: ("dicom", "Twice", None, "CT", 3, None, False),
            "ct.nii.gz": ("nifti", None, None, None, SLICES, 0, True), "png": ("images", None, None, None, SLICES, None, True)}
    assert set(scans) == set(want), f"listed: {list(scans)}"
    for key, (kind, description, kernel, modality, slices, tilted, usable) in want.items():
        scan = scans.get(key, {})
        have = tuple(scan.get(name) for name in ("kind", "description", "kernel", "modality", "slices", "usable"))
        assert have == (kind, description, kernel, modality, slices, usable), f"{key}: {scan}"
        angle = scan.get("tilt_deg")
        assert angle is None if tilted is None else abs((angle or 0) - tilted) < 0.01, f"{key}: tilt {angle}"
        assert scan.get("taken") == (key == 2), f"{key}: taken {scan.get('taken')}"
    pixel = 160 / SIZE
    assert all(abs(a - b) < 1e-4 for a, b in zip(scans[2]["spacing_mm"], (pixel, pixel, 1))), f"spacing: {scans[2]}"
    assert all(abs(a - b) < 1e-4 for a, b in zip(scans["ct.nii.gz"]["spacing_mm"], (pixel, pixel, 1))), f"spacing: {scans['ct.nii.gz']}"
    assert scans[2]["path"] == "DICOM/A" and "LOCALIZER" in scans[1]["image_type"], f"{scans[2]['path']}, {scans[1]}"
    assert "same position" in scans[8]["problem"], f"{scans[8]}"
    assert "PT (positron" in (scans[9]["problem"] or "") and "LOCALIZER" in (scans[1]["problem"] or ""), f"{scans[9]}, {scans[1]}"
    table = s.run("list", study).stdout
    for text in ("Sch\u00e4del H60s", "H60s", "PT", "1.25 x 1.25 x 1", "14.0", "Topogram", "localiser", "same position", "ct.nii.gz", "png", "most slices of the 3 CT series", "--series"):
        assert text in table, f"the table lacks {text!r}:\n{table}"
    marked = [line for line in table.splitlines() if line.startswith("*")]
    assert len(marked) == 1 and "Sch\u00e4del" in marked[0], f"marked: {marked}"
    # The same again with every file cut behind its header: no pixel is read.
    for file in (study / "DICOM").glob("?/*"):
        content = file.read_bytes()
        file.write_bytes(content[:content.rindex(b"\xe0\x7f\x10\x00") + 12])
    assert s.list(study)[1] == whole, "files without pixels are listed differently"
    assert s.run("list", study).stdout == table, "the table of files without pixels differs"
    s.refuses(3, ("truncated",), study, "-o", s.work / "none.glb")
    litter(s.work / "litter")
    # What list says is what meshing takes.
    for folder in ("several", "two"):  # of chooses()
        _, taken = s.warnings(s.work / folder)
        made = s.list(s.work / folder)[1]["scans"]
        assert [scan["number"] for scan in made if scan["taken"]] == [(taken or {}).get("number")], f"{folder}: {taken}"
    # A file; nothing usable.
    assert s.list(s.scan / "sample.nii.gz")[0].get("sample.nii.gz", {}).get("slices") == SLICES, "a file cannot be listed"
    s.refuses(3, ("litter", "no DICOM images"), "list", s.work / "litter")
    done = s.run("list", s.series(s.work / "scouts", 1, "Topogram", range(1), ImageType=["ORIGINAL", "PRIMARY", "LOCALIZER"]), "--json", expect=3)
    assert "Topogram" in done.stdout and "scouts" in done.stderr and len(done.stderr.splitlines()) == 1, f"only a localiser: {done.stdout} {done.stderr}"
    s.refuses(3, ("nowhere",), "list", s.work / "nowhere")
    s.refuses(2, ("FOLDER",), "list")


def test_takes_the_series_that_is_named(s):
    """--series by UID, number or description; the asset is that of the series alone, whatever it was named by."""
    study, out = s.work / "named", ("-o", s.work / "none.glb")
    for number, description in ((3, "Head Bone thin"), (4, "Head bone thick"), (5, "bone"), (12, "Soft 3.0 B30f")):
        s.series(study / str(number), number, description, range(number - 3, min(number, SLICES)) if number < 12 else range(SLICES))
    uid = "1.2.826.0.1.3680043.10.77."
    for number, names in ((3, ("3", uid + "3", "Head Bone thin", "THIN", "bone THIN")), (4, ("4", "04", uid + "4", "thick")), (5, ("5", "bone")),
                          (12, ("12", "soft", "B30F", "3.0"))):
        alone = s.work / "alone"
        shutil.rmtree(alone, ignore_errors=True)
        shutil.copytree(study / str(number), alone)
        want = s.asset(alone, "--series", uid + str(number))
        for name in names:
            assert s.asset(study, "--series", name) == want, f"--series {name} is not series {number}"
    s.refuses(2, ("--series Bone", "3 'Head Bone thin'", "4 'Head bone thick'", "5 'bone'"), study, "--series", "Bone", *out)
    s.refuses(2, ("--series head", "2 series", "3 'Head Bone thin'", "4 'Head bone thick'"), study, "--series", "head", *out)
    for name in ("7", "1.2.3", "abdomen", uid):
        s.refuses(2, (f"no series {name}", "there are:", "3 'Head Bone thin'", "12 'Soft 3.0 B30f'"), study, "--series", name, *out)
    # A number of two studies.
    s.series(study / "other", 12, "Other", range(4), lambda ds, k: (setattr(ds, "StudyInstanceUID", "1.2.3"), setattr(ds, "SeriesInstanceUID", "1.2.3.4")))
    s.refuses(2, ("--series 12", "2 series", uid + "12", "1.2.3.4"), study, "--series", "12", *out)
    assert s.asset(study, "--series", "Other") == s.asset(study, "--series", "1.2.3.4"), "a description of another study"
    s.series(study / "scout", 1, "Topogram", range(1), ImageType=["ORIGINAL", "PRIMARY", "LOCALIZER"])
    s.refuses(3, ("scout/IM000000", "localiser"), study, "--series", "1", *out)
    assert b"glTF" in s.asset(study, "--series", "topo", "--any-modality", "--threshold", "0"), "a localiser by its description"
