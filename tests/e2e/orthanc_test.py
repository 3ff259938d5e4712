# SPDX-License-Identifier: Apache-2.0
"""Orthanc as the archive: three studies are sent to it, found in it, fetched from it, and pushed by it to a receiver that meshes them.
Skipped if Orthanc is not installed (scripts/setup archive)."""
import json
import shutil
import subprocess
import urllib.request

import pytest
from archive_peer import PATIENT, Receiver, dcmtk, free_port, study, wait_for
from programs import run

ORTHANC = shutil.which("Orthanc") or shutil.which("Orthanc", path="/usr/sbin")
pytestmark = pytest.mark.skipif(ORTHANC is None, reason="Orthanc is not installed: scripts/setup archive")


class Orthanc:
    """An Orthanc with an empty database, on free ports of this computer."""

    def __init__(self, place, receiver_port):
        self.port, self.http = free_port(), free_port()
        settings = {
            "Name": "archive", "StorageDirectory": str(place / "orthanc"), "IndexDirectory": str(place / "orthanc"), "Plugins": [],
            "HttpPort": self.http, "RemoteAccessAllowed": False, "AuthenticationEnabled": False,
            "DicomAet": "ORTHANC", "DicomPort": self.port, "DicomCheckCalledAet": True, "DicomAlwaysAllowGet": True,
            "DicomAlwaysAllowFind": True, "DicomAlwaysAllowStore": True, "DicomAlwaysAllowEcho": True,
            "DicomModalities": {"trocar": ["TROCAR", "127.0.0.1", receiver_port]}}
        (place / "orthanc.json").write_text(json.dumps(settings))
        self.log = open(place / "orthanc.log", "w")
        self.process = subprocess.Popen([ORTHANC, str(place / "orthanc.json")], stdout=self.log, stderr=self.log, cwd=place)
        wait_for(lambda: self.process.poll() is not None or dcmtk("echoscu", "-aec", "ORTHANC", "127.0.0.1", self.port).returncode == 0,
                 "Orthanc starts")
        assert self.process.poll() is None, (place / "orthanc.log").read_text()[-2000:]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(30)
        self.log.close()

    def ask(self, path, body=None):
        request = urllib.request.Request(f"http://127.0.0.1:{self.http}/{path}", data=body)
        with urllib.request.urlopen(request, timeout=60) as answer:
            return json.load(answer)


def test_orthanc(programs, work):
    studies = [study(work / "sent", k, slices=6, size=64) for k in (1, 2, 3)]
    collection, store = work / "collection.json", work / "store"
    with Receiver(programs, work / "pushed", "--then", collection, store, callers=["ORTHANC"]) as receiver, Orthanc(work, receiver.port) as orthanc:
        for _, files in studies:
            done = dcmtk("storescu", "-aec", "ORTHANC", "127.0.0.1", orthanc.port, *files)
            assert done.returncode == 0, done.stdout
        found = dcmtk("findscu", "-S", "-aec", "ORTHANC", "-k", "QueryRetrieveLevel=STUDY", "-k", "StudyInstanceUID", "127.0.0.1", orthanc.port).stdout
        assert all(uid in found for uid, _ in studies), found
        for uid, _ in studies:
            done = run(programs / "trocar-mesh", "fetch", "--from", f"ORTHANC@127.0.0.1:{orthanc.port}", "--study", uid, work / "fetched")
            assert "6 instances" in done.stdout and PATIENT not in done.stdout
            assert len(list((work / "fetched" / uid).glob("*.dcm"))) == 6
        missing = run(programs / "trocar-mesh", "fetch", "--from", f"ORTHANC@127.0.0.1:{orthanc.port}", "--study", "1.2.3", work / "fetched", expect=3)
        assert missing.stderr.count("\n") == 1
        for name in orthanc.ask("studies"):
            orthanc.ask("modalities/trocar/store", name.encode())
        for uid, _ in studies:
            receiver.wait_for_study(uid, 6)
        wait_for(lambda: receiver.printed().count("its assets are in") == 3, "three batches", 120)
        assert receiver.stop() == 0
    for uid, _ in studies:
        assets = list((store / "assets").glob(f"{uid}_*.glb"))
        assert len(assets) == 1
        run(programs / "trocar-mesh", "verify", assets[0])
        # What was pushed and what was fetched are the same scan.
        run(programs / "trocar-mesh", work / "fetched" / uid, "-o", work / f"{uid}.glb", "--quiet")
        assert (work / f"{uid}.glb").read_bytes() == assets[0].read_bytes()
