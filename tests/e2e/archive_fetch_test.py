# SPDX-License-Identifier: Apache-2.0
"""trocar-mesh fetch, with DCMTK's archive, and with archives that break off or break the rules."""
import shutil
import socket
import stat
import struct
import subprocess
import sys
import threading
import time

import pytest
from archive_peer import CT, GET, PATIENT, answer_get, data_pdus, dcmtk, free_port, get_response, image, store_command, study, wait_for
from programs import run


class Archive:
    """dcmqrscp, DCMTK's archive, with the studies of the given files."""

    def __init__(self, place, *files, options=()):
        self.port = free_port()
        database = place / "archive"
        database.mkdir()
        (place / "archive.cfg").write_text(
            f'NetworkTCPPort = {self.port}\nMaxPDUSize = 16384\nMaxAssociations = 16\nHostTable BEGIN\nHostTable END\n'
            f'VendorTable BEGIN\nVendorTable END\nAETable BEGIN\nARCHIVE {database} RW (200, 1024mb) ANY\nAETable END\n')
        self.process = subprocess.Popen([str(word) for word in ("dcmqrscp", "-c", place / "archive.cfg", *options)],
                                        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wait_for(lambda: dcmtk("echoscu", "-aec", "ARCHIVE", "127.0.0.1", self.port).returncode == 0, "the archive starts")
        done = dcmtk("storescu", "-aec", "ARCHIVE", "127.0.0.1", self.port, *files)
        assert done.returncode == 0, done.stdout

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()


def fetch(programs, folder, study_uid, port, *options, title="ARCHIVE", expect=0):
    return run(programs / "trocar-mesh", "fetch", "--from", f"{title}@127.0.0.1:{port}", "--study", study_uid, folder, *options, expect=expect)


def test_fetch(programs, place):
    uid, files = study(place / "sent", 1)
    other, more = study(place / "sent", 2)
    with Archive(place, *files, *more) as archive:
        done = fetch(programs, place / "got", uid, archive.port)
        assert "4 instances" in done.stdout and PATIENT not in done.stdout
        assert sorted(path.name for path in (place / "got").iterdir()) == [".incoming", uid]
        assert len(list((place / "got" / uid).glob("*.dcm"))) == 4
        run(programs / "trocar-mesh", place / "got" / uid, "-o", place / "bone.glb", "--quiet")
        for path in (place / "got").rglob("*"):
            assert stat.S_IMODE(path.stat().st_mode) == (0o700 if path.is_dir() else 0o600)
        assert "0 of them new" in fetch(programs, place / "got", uid, archive.port).stdout
        # What is stored already does not count twice.
        assert "0 of them new" in fetch(programs, place / "got", uid, archive.port, "--max-instances", 4).stdout
        missing = fetch(programs, place / "none", "1.2.3", archive.port, expect=3)
        assert missing.stderr.count("\n") == 1 and "no images of study 1.2.3" in missing.stderr
        wrong = fetch(programs, place / "none", uid, archive.port, title="NOBODY", expect=3)
        assert wrong.stderr.count("\n") == 1
        limited = fetch(programs, place / "none", uid, archive.port, "--max-instances", 2, expect=3)
        assert "--max-instances" in limited.stderr
        (place / "file").write_text("")
        assert fetch(programs, place / "file", uid, archive.port, expect=4).stderr.count("\n") == 1
    gone = fetch(programs, place / "none", uid, archive.port, expect=3)
    assert gone.stderr.count("\n") == 1 and f"127.0.0.1:{archive.port}: no association" in gone.stderr
    assert not (place / "none").exists()


@pytest.mark.parametrize("after", [0, 2000, 20000])
def test_fetch_from_an_archive_that_breaks_off(programs, place, after):
    """A proxy before the archive cuts the connection after some bytes."""
    uid, files = study(place / "sent", 1, slices=8, size=64)
    with Archive(place, *files) as archive, socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()

        def proxy():
            ours, _ = listening.accept()
            theirs = socket.create_connection(("127.0.0.1", archive.port))
            threading.Thread(target=copy, args=(ours, theirs, None), daemon=True).start()
            copy(theirs, ours, after)
            for one in (ours, theirs):
                one.shutdown(socket.SHUT_RDWR)

        def copy(source, target, most):
            passed = 0
            try:
                while data := source.recv(1024):
                    if most is not None and passed + len(data) > most:
                        return
                    target.sendall(data)
                    passed += len(data)
            except OSError:
                pass

        threading.Thread(target=proxy, daemon=True).start()
        done = fetch(programs, place / "got", uid, listening.getsockname()[1], "--acse-timeout", 5, "--idle-timeout", 5, expect=3)
        assert done.stderr.count("\n") == 1
        assert not (place / "got").exists()


@pytest.mark.parametrize("status, code", [(0, 0), (0xB000, 3)])
def test_fetch_from_an_archive_that_counts_nothing(programs, place, status, code):
    """The status B000 means that instances failed or were sent with warnings. Without a number of failed instances, some may be missing."""
    uid = "2.25.4711.7"
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        threading.Thread(target=answer_get, args=(listening, image(uid, f"{uid}.1", 0), status), daemon=True).start()
        done = fetch(programs, place / "got", uid, listening.getsockname()[1], "--acse-timeout", 5, "--idle-timeout", 5, expect=code)
    assert (place / "got" / uid).exists() == (code == 0)
    assert code == 0 or "does not say whether it has sent all instances (status B000)" in done.stderr, done.stderr


def dribble(association, contexts):
    """Begins an instance, of which a byte comes now and then."""
    association.send(data_pdus(contexts[CT], True, store_command(CT, "2.25.4711.8.1.1")))
    association.send(struct.pack(">BBI", 4, 0, 10_006) + struct.pack(">IBB", 10_002, contexts[CT], 2))
    send_for_ever(association, b"\0")


def promise(association, contexts):
    """Says again and again that the instances will come."""
    send_for_ever(association, get_response(contexts[GET], 0xFF00))


def send_for_ever(association, data):
    try:
        while True:
            association.send(data)
            time.sleep(0.2)
    except OSError:
        sys.exit()  # ends this thread


def test_fetch_waits_for_the_first_instance(programs, place):
    """An archive that first gets the study from slow storage is silent for longer than --idle-timeout."""
    uid = "2.25.4711.9"
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        threading.Thread(target=answer_get, args=(listening, image(uid, f"{uid}.1", 0), 0, 1, lambda *_: time.sleep(4)), daemon=True).start()
        fetch(programs, place / "got", uid, listening.getsockname()[1], "--idle-timeout", 2, "--dimse-timeout", 60, expect=0)
    assert (place / "got" / uid).exists()


@pytest.mark.parametrize("before", [dribble, promise])
def test_fetch_from_an_archive_that_never_sends_a_whole_instance(programs, place, before):
    """It is never silent for as long as --idle-timeout."""
    uid = "2.25.4711.8"
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        threading.Thread(target=answer_get, args=(listening, image(uid, f"{uid}.1", 0), 0, 1, before), daemon=True).start()
        done = fetch(programs, place / "got", uid, listening.getsockname()[1], "--dimse-timeout", 2, expect=3)
    assert "no instance was complete within 2 s; --dimse-timeout" in done.stderr and done.stderr.count("\n") == 1, done.stderr
    assert not (place / "got").exists()


def test_fetch_from_an_archive_that_repeats_an_instance(programs, place):
    uid = "2.25.4711.9"
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        threading.Thread(target=answer_get, args=(listening, image(uid, f"{uid}.1", 0), 0, 5), daemon=True).start()
        done = fetch(programs, place / "got", uid, listening.getsockname()[1], "--max-instances", 2, expect=3)
    assert "more than 2 instances (--max-instances)" in done.stderr and done.stderr.count("\n") == 1, done.stderr
    assert not (place / "got").exists()


def test_fetch_is_interrupted(programs, place):
    with socket.socket() as listening:  # it accepts the connection and says nothing
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        done = fetch(programs, place / "got", "1.2.3", listening.getsockname()[1], "--acse-timeout", 2, expect=3)
        assert done.stderr.count("\n") == 1


USAGES = [
    (("fetch", "--from", "A@192.0.2.1:104", "--study", "1.2", "scans"), "--insecure"),
    (("fetch", "--from", "A:104", "--study", "1.2", "scans"), "AE@HOST:PORT"),
    (("fetch", "--from", "A@localhost:104", "--study", "../x", "scans"), "must be a UID"),
]


@pytest.mark.parametrize("words, message", USAGES)
def test_wrong_usage(programs, place, words, message):
    done = run(programs / "trocar-mesh", *words, expect=2, cwd=place)
    assert message in done.stderr and done.stderr.count("\n") == 1
    assert list(place.iterdir()) == []


def test_missing_program_is_named(programs, place):
    copy = place / "bin" / "trocar-mesh"
    copy.parent.mkdir()
    shutil.copy(programs / "trocar-mesh", copy)
    done = run(copy, "fetch", place / "scans", "--from", "PACS@localhost:104", "--study", "1.2", expect=1)
    assert done.stderr == (f"trocar-mesh: {place}/libexec/trocar/trocar-archive: cannot be run (No such file or directory); "
                           "reinstall or rebuild trocar-mesh\n")
