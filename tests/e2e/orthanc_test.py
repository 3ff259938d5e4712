# SPDX-License-Identifier: Apache-2.0
"""scripts/archive: a real Orthanc receives studies, orthanc-hook meshes them, get-study gets them.

The sender ARCHIVE is another Orthanc, which says how many instances it has. The sender SCANNER is storescu, which does not.
Skipped if Orthanc is not installed (scripts/setup archive)."""
import json
import os
import shutil
import socket
import subprocess
import time
import urllib.error
import urllib.request
from concurrent.futures import ThreadPoolExecutor

import pydicom
import pytest
from programs import PROGRAMS, SCAN, SOURCE, run

ORTHANC = shutil.which("Orthanc") or shutil.which("Orthanc", path="/usr/sbin")
pytestmark = pytest.mark.skipif(ORTHANC is None, reason="Orthanc is not installed: scripts/setup archive")
MESH, SCRIPTS = PROGRAMS / "trocar-mesh", SOURCE / "scripts/archive"
SLICES = 12


def free_port():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


def wait_for(condition, what, seconds=60):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"not within {seconds} s: {what}"
        time.sleep(0.1)


class Orthanc:
    """An Orthanc with an empty database, on ports of this computer."""

    def __init__(self, place, title, port, **settings):
        self.title, self.port, self.http = title, port, free_port()
        place.mkdir()
        settings = {
            "StorageDirectory": str(place), "IndexDirectory": str(place), "Plugins": [], "HttpPort": self.http, "StableAge": 1,
            "OverwriteInstances": True, "DicomAet": title, "DicomPort": port, "DicomAlwaysAllowFind": True,
            "DicomAlwaysAllowGet": True, **settings}
        (place / "orthanc.json").write_text(json.dumps(settings))
        self.log = open(place / "orthanc.log", "w")
        self.process = subprocess.Popen([ORTHANC, str(place / "orthanc.json")], stdout=self.log, stderr=self.log, cwd=place)
        wait_for(self.answers, f"{title} starts")

    def answers(self):
        assert self.process.poll() is None, f"{self.title} has ended; see {self.log.name}"
        try:
            return self.ask("system")
        except urllib.error.URLError:
            return False

    def stop(self):
        self.process.terminate()
        self.process.wait(30)
        self.log.close()

    def ask(self, path, body=None):
        with urllib.request.urlopen(f"http://127.0.0.1:{self.http}/{path}", body, timeout=60) as answer:
            return json.load(answer)

    def take(self, files, title, *options):
        """Exit code of storescu, which sends the files under this title."""
        words = ["storescu", "-aet", title, "-aec", self.title, *options, "127.0.0.1", str(self.port), *map(str, files)]
        return subprocess.run(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False, timeout=60).returncode

    def send(self, study):
        self.ask("modalities/trocar/store", study.encode())

    def wait_until_stable(self, instances):
        wait_for(lambda: self.ask("statistics")["CountInstances"] == instances, f"{instances} instances")
        wait_for(lambda: all(study["IsStable"] for study in self.ask("studies?expand")), "all studies are stable")


@pytest.fixture(name="pair")
def archive_and_receiver(place):
    ports = [free_port(), free_port()]
    pair = [Orthanc(place / "archive", "ARCHIVE", ports[0], DicomModalities={"trocar": ["TROCAR", "127.0.0.1", ports[1]]})]
    try:
        pair.append(Orthanc(place / "receiver", "TROCAR", ports[1], DicomModalities={"pacs": ["ARCHIVE", "127.0.0.1", ports[0]]}))
        yield pair
    finally:
        for one in pair:
            one.stop()


def study(folder, uid, brighter=0):
    """The files of a study with the UID, made from the sample scan."""
    folder.mkdir()
    for k, file in enumerate(sorted((SCAN / "dicom").iterdir())[:SLICES]):
        data = pydicom.dcmread(file)
        data.StudyInstanceUID, data.SeriesInstanceUID, data.PatientName = uid, f"{uid}.1", "SECRET^NAME"
        data.SOPInstanceUID = data.file_meta.MediaStorageSOPInstanceUID = f"{uid}.1.{k + 1}"
        pixels = data.pixel_array
        data.PixelData = (pixels + pixels.dtype.type(brighter)).tobytes()
        data.save_as(folder / file.name)
    return sorted(folder.iterdir())


def hook(receiver, place, *parameters, path=PROGRAMS, expect=0):
    """What orthanc-hook prints."""
    done = run(SCRIPTS / "orthanc-hook", f"http://127.0.0.1:{receiver.http}", place / "studies", place / "store", *parameters,
               env={**os.environ, "PATH": f"{path}:{os.environ['PATH']}"}, expect=expect)
    assert "SECRET" not in done.stdout + done.stderr
    return done.stdout + done.stderr


def asset_of(place, uid):
    """(the study's only asset, its number of slices, whether it says that its completeness is unknown)"""
    (file,) = (place / "store/assets").glob(f"{uid}_*.glb")
    run(MESH, "verify", file)
    parameters = json.loads(run(MESH, "info", "--json", file).stdout)["parameters"]
    report = json.loads((place / "store/reports" / f"{file.stem}.json").read_text())
    is_unknown = parameters.get("completeness") == "unknown"
    assert is_unknown == any(warning["code"] == "completeness_unknown" for warning in report["warnings"])
    return file.read_bytes(), report["input"]["slices"], is_unknown


def by_hand(folder, *options):
    out = folder.with_suffix(".glb")
    run(MESH, folder, "-o", out, "--quiet", *options)
    return out.read_bytes()


def test_two_studies_at_once(pair, place):
    archive, receiver = pair
    for uid in ("2.25.1", "2.25.2"):
        assert archive.take(study(place / uid, uid, int(uid[-1])), "SCANNER") == 0
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(archive.send, archive.ask("studies")))
    receiver.wait_until_stable(2 * SLICES)
    hook(receiver, place, '{"tolerance": 0.3}')
    made = {uid: asset_of(place, uid) for uid in ("2.25.1", "2.25.2")}
    for uid, asset in made.items():
        assert asset == (by_hand(place / uid, "--tolerance", "0.3"), SLICES, False)
    assert (place / "studies").stat().st_mode & 0o777 == 0o700
    assert hook(receiver, place) == "", "the second call has nothing to do"


def test_half_a_study_waits_for_the_other_half(pair, place):
    archive, receiver = pair
    files = study(place / "sent", "2.25.3")
    archive.take(files, "SCANNER")
    receiver.take(files[:7], "ARCHIVE", "--abort")
    receiver.wait_until_stable(7)
    assert f"study 2.25.3: waits; 7 of {SLICES} instances" in hook(receiver, place)
    assert not (place / "store").exists()
    archive.send(archive.ask("studies")[0])
    receiver.wait_until_stable(SLICES)
    hook(receiver, place)
    assert asset_of(place, "2.25.3") == (by_hand(place / "sent"), SLICES, False)


def test_a_series_that_waited_is_asked_about_again(pair, place):
    archive, receiver = pair
    files = study(place / "sent", "2.25.8")
    archive.take(files[:7], "SCANNER")
    receiver.take(files, "ARCHIVE")
    receiver.wait_until_stable(SLICES)
    assert f"waits; {SLICES} of 7 instances" in hook(receiver, place)
    archive.take(files, "SCANNER")
    archive.wait_until_stable(SLICES)
    hook(receiver, place)
    assert asset_of(place, "2.25.8") == (by_hand(place / "sent"), SLICES, False)


def test_a_correction_with_the_same_uids_replaces(pair, place):
    archive, receiver = pair
    made = []
    for name, brighter in (("first", 0), ("corrected", 150)):
        archive.take(study(place / name, "2.25.4", brighter), "SCANNER")
        archive.send(archive.ask("studies")[0])
        receiver.wait_until_stable(SLICES)
        hook(receiver, place)
        made.append(by_hand(place / name))
        assert asset_of(place, "2.25.4") == (made[-1], SLICES, False)
    assert made[0] != made[1]


def test_a_sender_that_does_not_count(pair, place):
    receiver = pair[1]
    files = study(place / "sent", "2.25.5")
    for sent in (1, 7, SLICES):
        receiver.take(files[:sent], "SCANNER", *(["--abort"] if sent < SLICES else []))
        receiver.wait_until_stable(sent)
        hook(receiver, place)
        assert asset_of(place, "2.25.5")[1:] == (sent, True)
    (collection,) = (place / "studies").glob("*/collection.json")
    summary = json.loads(run(MESH, "batch", collection, "-o", place / "store", "--json").stdout)
    assert "completeness_unknown" in [warning["code"] for warning in summary["warnings"]]


def test_a_killed_hook_and_a_hostile_uid(pair, place):
    receiver = pair[1]
    uid = "../../../escape"
    for file in study(place / "sent", "2.25.6"):
        data = pydicom.dcmread(file)
        data.StudyInstanceUID = uid
        data.save_as(file)
        receiver.ask("instances", file.read_bytes())
    receiver.wait_until_stable(SLICES)
    (place / "bin").mkdir()
    (place / "bin/trocar-mesh").write_text("#!/bin/sh\nkill -9 $PPID\n")
    (place / "bin/trocar-mesh").chmod(0o755)
    hook(receiver, place, path=place / "bin", expect=-9)
    hook(receiver, place)
    assert asset_of(place, "escape")[1:] == (SLICES, True)
    assert all(path.is_relative_to(place / "studies") for path in place.parent.rglob("escape"))


def test_tls(place):
    keys = {}
    for name in ("receiver", "scanner", "stranger"):
        keys[name] = (place / f"{name}.key", place / f"{name}.pem")
        run("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", keys[name][0], "-out", keys[name][1], "-subj", f"/CN={name}")
    receiver = Orthanc(place / "orthanc", "TROCAR", free_port(), DicomTlsEnabled=True, DicomTlsPrivateKey=str(keys["receiver"][0]),
                       DicomTlsCertificate=str(keys["receiver"][1]), DicomTlsTrustedCertificates=str(keys["scanner"][1]))
    try:
        files = study(place / "sent", "2.25.7")
        trusted = ["+cf", str(keys["receiver"][1])]
        assert receiver.take(files, "SCANNER") != 0
        assert receiver.take(files, "SCANNER", "+tls", *map(str, keys["stranger"]), *trusted) != 0
        assert receiver.ask("statistics")["CountInstances"] == 0
        assert receiver.take(files, "SCANNER", "+tls", *map(str, keys["scanner"]), *trusted) == 0
        assert receiver.ask("statistics")["CountInstances"] == SLICES
    finally:
        receiver.stop()


def get_study(archive, uid, place, path="/usr/bin", expect=0):
    done = run(SCRIPTS / "get-study", f"ARCHIVE@127.0.0.1:{archive.port}", uid, place / "got",
               env={**os.environ, "PATH": f"{path}:{os.environ['PATH']}"}, expect=expect)
    assert done.stderr.count("\n") == (0 if expect == 0 else 1)
    return done.stderr


def test_get_study(pair, place):
    archive = pair[0]
    archive.take(study(place / "sent", "2.25.8"), "SCANNER")
    # This getscu loses an instance.
    (place / "bin").mkdir()
    (place / "bin/getscu").write_text('#!/bin/bash\n/usr/bin/getscu "$@"\nwhile [[ $1 != -od ]]; do shift; done\n'
                                      'files=("$2"/*)\nrm "${files[0]}"\n')
    (place / "bin/getscu").chmod(0o755)
    assert f"sent {SLICES - 1} of {SLICES} instances" in get_study(archive, "2.25.8", place, place / "bin", expect=3)
    assert "no such study" in get_study(archive, "2.25.9", place, expect=3)
    assert list((place / "got").iterdir()) == []
    get_study(archive, "2.25.8", place)
    assert by_hand(place / "got/2.25.8") == by_hand(place / "sent")
    assert "exists" in get_study(archive, "2.25.8", place, expect=2)
    archive.stop()
    assert "does not answer" in get_study(archive, "2.25.9", place, expect=3)
