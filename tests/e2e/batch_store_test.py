# SPDX-License-Identifier: Apache-2.0
"""What a store of trocar-mesh batch holds (garbage collection: garbage_test): several users, warnings, changes of inputs; and the names of list --manifest."""
import json
import os
import pathlib
import shutil
import stat
import subprocess
import tempfile

import pydicom
import pytest
from batch_collection import write_collection
from programs import PROGRAMS, SANITIZED, run

MESH = PROGRAMS / "trocar-mesh"
A, B, GROUP = 30001, 30002, 30000  # made-up users of one group


@pytest.fixture(name="folder")
def open_folder():
    """A folder that other users reach, with a phantom."""
    with tempfile.TemporaryDirectory(prefix="trocar_store_") as name:
        folder = pathlib.Path(name)
        folder.chmod(0o755)
        run(PROGRAMS / "trocar-sample-ct", folder / "phantom", "--slices", 5, "--size", 64, "--quiet")
        yield folder


def two_scans(folder):
    return write_collection(folder / "collection.json", [{"name": name, "input": "phantom/sample.nii.gz", "parameters": {"threshold": 150 + k}}
                                                         for k, name in enumerate("ab")])


def batch(collection, store, *options, expect=0, **keys):
    return json.loads(run(MESH, "batch", collection, "-o", store, "--json", *options, expect=expect, **keys).stdout or "{}")


def contents(store):
    return sorted(path.name for path in (store / "content").glob("*/*"))


def as_user(user, umask="002"):
    return {"preexec_fn": lambda: (os.umask(int(umask, 8)), os.setgroups([]), os.setgid(GROUP), os.setuid(user)) if user else os.umask(int(umask, 8))}


needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can run programs as other users")


@needs_root
@pytest.mark.parametrize("umask", ["002", "022", "077"])
def test_users_of_one_group_share_a_store(folder, umask):
    collection, store = two_scans(folder), folder / "store"
    store.mkdir()
    os.chown(store, A, GROUP)
    store.chmod(0o2770)
    assert batch(collection, store, **as_user(A, umask))["made"] == 2
    whole = contents(store)
    for user in (B, 0, A):
        done = batch(collection, store, "--gc", "--grace", 0, **as_user(user, umask))
        assert (done["unchanged"], done["gc"]["removed"]) == (2, 0), user
    # What one user adds, all can use, remove and make again.
    scans = json.loads(collection.read_text())["scans"]
    for k, user in enumerate((B, 0, A)):
        scans.append({"name": f"of_{user}", "input": "phantom/sample.nii.gz", "parameters": {"threshold": 300 + k}})
        write_collection(collection, scans)
        assert batch(collection, store, **as_user(user, umask))["made"] == 1
    for user in (A, B, 0):
        assert batch(collection, store, "--rehash", **as_user(user, umask))["unchanged"] == 5, user
    for path in store.rglob("*"):
        mode = path.lstat().st_mode
        if not stat.S_ISLNK(mode):
            assert path.lstat().st_gid == GROUP and mode & 0o060 == 0o060, f"{path} {mode:o}"
            if path.parent.name in ("scans", "journal") or "actions" in path.parts and path.is_file():
                assert mode & 0o007 == 0, f"{path} {mode:o}"
    del scans[2:]
    write_collection(collection, scans)
    assert batch(collection, store, "--gc", "--prune", "--grace", 0, **as_user(B, umask))["gc"]["dropped"] == 3
    assert contents(store) == whole


@needs_root
def test_a_store_of_one_user_refuses_others_before_anything_is_made(folder):
    collection, store = two_scans(folder), folder / "store"
    store.mkdir()
    os.chown(store, A, GROUP)
    store.chmod(0o777)
    batch(collection, store, **as_user(A))
    files = {path: path.lstat().st_mtime_ns for path in store.rglob("*") if not path.is_dir()}
    for options in ((), ("--gc", "--grace", 0), ("--verify",)):
        done = run(MESH, "batch", collection, "-o", store, *options, expect=4, **as_user(B))
        assert f"belongs to user {A}" in done.stderr and done.stderr.count("\n") == 1, done.stderr
    assert {path: path.lstat().st_mtime_ns for path in store.rglob("*") if not path.is_dir()} == files
    # Root may work for the user, who can go on.
    scans = json.loads(collection.read_text())["scans"]
    write_collection(collection, [*scans, {"name": "c", "input": "phantom/sample.nii.gz", "parameters": {"threshold": 300}}])
    assert batch(collection, store)["made"] == 1
    assert all(path.lstat().st_uid == A for path in store.rglob("*") if not path.is_symlink())
    assert batch(collection, store, "--rehash", "--gc", "--grace", 0, **as_user(A))["unchanged"] == 3


@needs_root
def test_entries_that_cannot_be_read_are_not_made_again(folder):
    """A store whose files only their maker can read."""
    collection, store = two_scans(folder), folder / "store"
    store.mkdir()
    os.chown(store, A, GROUP)
    store.chmod(0o2775)
    batch(collection, store, **as_user(A))
    (store / "scans/b.json").chmod(0o600)
    before = {path: path.lstat().st_mtime_ns for path in store.rglob("*") if not path.is_dir()}
    done = run(MESH, "batch", collection, "-o", store, expect=3, **as_user(B))
    assert f"{store}/scans/b.json: Permission denied" in done.stderr and done.stderr.count("\n") == 1, done.stderr
    assert {path: path.lstat().st_mtime_ns for path in store.rglob("*") if not path.is_dir()} == before


def test_the_journal_is_private(folder):
    batch(two_scans(folder), folder / "store")
    (journal,) = (folder / "store/journal").iterdir()
    assert stat.S_IMODE(journal.stat().st_mode) == 0o600


@pytest.mark.skipif(bool(SANITIZED), reason="a sanitizer must be the first library")
@pytest.mark.parametrize("form", ["nifti", "png"])
def test_one_error_of_the_storage_is_no_lasting_failure(folder, form):
    """Whichever read fails: of the digest, of the header, of the voxels."""
    file = next(iter(sorted((folder / "phantom/png").iterdir()))) if form == "png" else folder / "phantom/sample.nii.gz"
    parameters = {"spacing": "1,1,1", "equalize": 203} if form == "png" else {}
    collection = write_collection(folder / "collection.json", [{"name": "a", "input": str(file), "parameters": parameters},
                                                               {"name": "b", "input": "phantom/sample.nii.gz", "parameters": {"threshold": 300}}])
    once = pathlib.Path(f"{file}.once")
    libraries = str(PROGRAMS / "libfailing_read.so")
    reads = 0
    for k in range(12):
        store = folder / f"store{k}"
        once.write_text(str(k))
        done = run(MESH, "batch", collection, "-o", store, "--json", "--only", "-", input="a\n", expect=None,
                   env={**os.environ, "LD_PRELOAD": libraries, "TROCAR_FAIL_READ": str(file)})
        if once.exists():
            break
        reads += 1
        assert done.returncode in (0, 3), done.stderr
        again = batch(collection, store)
        assert (again["known"], again["failed"]) == (0, 0), f"read {k}: {again}"
    assert reads >= 2


def remove_slice(folder):
    slices = sorted((folder / "phantom/dicom").iterdir())
    slices[2].unlink()
    shutil.copy(slices[1], slices[1].with_name("copy.dcm"))


def test_warnings_are_in_report_index_summary_and_review(folder):
    remove_slice(folder)
    dicom = {"folder": "phantom/dicom", "series": 1}
    collection = write_collection(folder / "collection.json", [{"name": "gap", "input": dicom, "parameters": {"threshold": 200}},
                                                               {"name": "whole", "input": "phantom/sample.nii.gz"}])
    store = folder / "store"
    wanted = {"missing_slice", "copied_slice"}

    def codes(warnings):
        return {one["code"] for one in warnings}

    for k in range(3):
        done = run(MESH, "batch", collection, "-o", store, *(("--rehash",) if k == 2 else ()))
        assert "1 with warnings" in done.stdout and "warning missing_slice: gap" in done.stdout, done.stdout
        summary = batch(collection, store)
        assert summary["warned"] == 1 and {one["scan"] for one in summary["warnings"]} == {"gap"}
        assert wanted <= codes(summary["warnings"]) <= codes(json.loads((store / "scans/gap.json").read_text())["warnings"])
        report = (store / "reports/gap.json").read_text()
        assert wanted <= codes(json.loads(report)["warnings"])
        assert "copy.dcm" not in report and "phantom" not in report
    assert "missing_slice" in run(MESH, "batch", collection, "-o", store, "--strict", expect=3).stderr
    assert wanted <= codes(batch(collection, store, "--explain", "gap")["warnings"])
    page = folder / "review.html"
    assert json.loads(run(MESH, "review", store, "-o", page, "--json").stdout)["warned"] == 1
    assert "are left out" in page.read_text() and '"code":"missing_slice"' in page.read_text()
    # The same scan under another name is found, and so are its warnings; without the copy it has the same asset and another report.
    (store / "scans/gap.json").unlink()
    found = batch(collection, store)
    assert found["found"] == 1 and wanted <= codes(found["warnings"])
    (folder / "phantom/dicom/copy.dcm").unlink()
    found = batch(collection, store)
    assert found["found"] == 1 and codes(found["warnings"]) & wanted == {"missing_slice"}
    assert "copied_slice" not in (store / "reports/gap.json").read_text()
    batch(collection, store, "--verify")
    batch(collection, store, "--gc", "--grace", 0)
    assert batch(collection, store)["unchanged"] == 2


def test_an_edit_with_the_old_size_and_time_is_found(folder):
    collection, store = two_scans(folder), folder / "store"
    batch(collection, store)
    file = folder / "phantom/sample.nii.gz"
    before = file.stat()
    with file.open("r+b") as stream:
        stream.seek(4)  # the time in gzip's header: what is unpacked is the same
        stream.write(b"\x01\x02\x03\x04")
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert (file.stat().st_size, file.stat().st_mtime_ns, file.stat().st_ino) == (before.st_size, before.st_mtime_ns, before.st_ino)
    assert batch(collection, store)["made"] == 2
    # Other rights or another link change no byte: the file is read again, and nothing is made.
    file.chmod(0o640)
    assert batch(collection, store)["found"] == 2
    assert batch(collection, store)["unchanged"] == 2


def copy_series(folder, to, uid, number):
    to.mkdir(parents=True)
    for file in sorted(folder.iterdir()):
        data = pydicom.dcmread(file)
        data.SeriesInstanceUID, data.SeriesNumber = uid, number
        data.SOPInstanceUID = data.file_meta.MediaStorageSOPInstanceUID = f"{uid}.{data.InstanceNumber}"
        data.save_as(to / file.name)


def test_a_new_series_takes_no_name_from_another(folder):
    study = folder / "study"
    copy_series(folder / "phantom/dicom", study / "x", "1.2.9", 4)

    def names():
        scans = json.loads(run(MESH, "list", study, "--manifest").stdout)["scans"]
        return {scan["input"]["series"]: scan["name"] for scan in scans}

    before = names()
    copy_series(folder / "phantom/dicom", study / "y", "1.2.1", 4)
    for file in (study / "y").iterdir():
        file.rename(study / "x" / f"y_{file.name}")
    (study / "y").rmdir()
    after = names()
    assert len(set(after.values())) == 2 and after["1.2.9"] == before["1.2.9"]


def test_a_manifest_works_where_it_is_saved(folder):
    (folder / "sub").mkdir()
    for command, file in ((f"'{MESH}' list phantom --manifest > sub/one.json", "sub/one.json"),
                          (f"'{MESH}' list phantom --manifest -o sub/two.json", "sub/two.json"),
                          (f"cd sub && '{MESH}' list ../phantom --manifest -o ../three.json", "three.json")):
        subprocess.run(command, shell=True, cwd=folder, check=True, stderr=subprocess.DEVNULL)
        done = batch(folder / file, folder / f"store of {pathlib.Path(file).name}", expect=3)  # images need a spacing
        assert (done["made"] + done["found"], done["failed"]) == (2, 1), file
    assert str(folder) not in (folder / "sub/two.json").read_text()


def test_names_that_a_collection_cannot_state_are_left_out_and_named(folder):
    for name in (b"new\nline", b"latin\xe91", b"good \xc3\xa9"):
        os.mkdir(os.path.join(os.fsencode(folder), name))
        shutil.copy(os.fsencode(folder / "phantom/sample.nii.gz"), os.path.join(os.fsencode(folder), name))
    shutil.rmtree(folder / "phantom")
    done = subprocess.run([MESH, "list", folder, "--manifest", "-o", folder / "c.json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, check=True)
    assert done.stderr.count(b"not_in_collection") == 2 and b"rename it" in done.stderr, done.stderr
    (scan,) = json.loads((folder / "c.json").read_text())["scans"]
    assert scan["input"] == "good é/sample.nii.gz"
    assert batch(folder / "c.json", folder / "store")["made"] == 1


@pytest.mark.skipif(bool(SANITIZED), reason="a sanitizer must be the first library")
def test_without_hard_links(tmp_path):
    """Leases are created files there."""
    without_links = {**os.environ, "LD_PRELOAD": str(PROGRAMS / "libno_hard_links.so")}
    source = tmp_path / "a"
    source.write_text("x")
    refused = run("ln", source, tmp_path / "b", env=without_links, expect=None)
    assert refused.returncode != 0 and not (tmp_path / "b").exists(), "the library does not work"
    run(PROGRAMS / "trocar-sample-ct", tmp_path / "phantom", "--slices", 3, "--size", 64, "--quiet")
    scans = [{"name": f"s{k}", "input": "phantom/sample.nii.gz", "parameters": {"threshold": 150 + k}} for k in range(20)]
    collection = write_collection(tmp_path / "collection.json", scans)
    command = [str(MESH), "batch", str(collection), "-o", str(tmp_path / "store"), "--json"]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=without_links) for _ in range(2)]
    summaries = [json.loads(process.communicate()[0]) for process in both]
    assert sum(one["made"] for one in summaries) == 20, "two batches did work twice"
    assert not [path for top in ("tmp", "claims") for path in (tmp_path / "store" / top).iterdir()]
    run(MESH, "batch", collection, "-o", tmp_path / "with_links", "--quiet")
    for scan in scans:
        assert os.readlink(tmp_path / "store/assets" / f"{scan['name']}.glb") == os.readlink(tmp_path / "with_links/assets" / f"{scan['name']}.glb")
