# SPDX-License-Identifier: Apache-2.0
"""trocar-mesh receive, with the programs of DCMTK as scanners, and with senders that break the rules."""
import json
import os
import shutil
import signal
import stat
import subprocess
import threading
import time

import pytest
from archive_peer import (CT, PATIENT, RELEASE, Association, Receiver, associate, dataset_bytes, data_pdus, dcmtk, image, save,
                          store_command, study, wait_for)
from programs import SANITIZED, run

OUT_OF_RESOURCES, MISMATCH, NOT_UNDERSTOOD, DUPLICATE, STORED = 0xA700, 0xA900, 0xC000, 0x0111, 0


@pytest.fixture
def receiver(programs, place):
    with Receiver(programs, place / "scans") as running:
        yield running


def test_push_appears_whole_and_private(receiver, place):
    uid, files = study(place / "sent", 1)
    assert receiver.echo().returncode == 0
    done = receiver.send(*files)
    assert done.returncode == 0, done.stdout
    receiver.wait_for_study(uid, 4)
    for path in [receiver.folder, *receiver.folder.rglob("*")]:
        mode = stat.S_IMODE(path.stat().st_mode)
        assert mode == (0o700 if path.is_dir() else 0o600), f"{path}: {mode:o}"
    for file in files:
        stored = receiver.folder / uid / (str(dcm_uid(file)) + ".dcm")
        assert dcmtk("dcmdump", stored).stdout.count("\n") > 30
        assert run("dcmftest", stored).stdout.startswith("yes")
        assert pixels(stored) == pixels(file)
    assert receiver.stop() == 0
    assert f"study {uid}: 4 instances" in receiver.printed()
    assert "until you remove them" in receiver.printed()
    assert PATIENT not in receiver.printed() + receiver.complained()
    assert receiver.is_tidy()


def dcm_uid(file):
    import pydicom
    return pydicom.dcmread(str(file), stop_before_pixels=True).SOPInstanceUID


def pixels(file):
    import pydicom
    return pydicom.dcmread(str(file)).PixelData


def test_listens_on_loopback_only(receiver):
    listening = run("ss", "-ltn").stdout if shutil.which("ss") else open("/proc/net/tcp").read()
    port = f":{receiver.port:04X}" if "sl" in listening.split()[:1] else f":{receiver.port} "
    lines = [line for line in listening.splitlines() if port in line]
    assert lines and all("127.0.0.1" in line or "0100007F" in line for line in lines), lines


def test_titles_that_are_not_named_are_rejected(receiver, place):
    uid, files = study(place / "sent", 1)
    assert receiver.send(*files, called="OTHER").returncode != 0
    assert receiver.send(*files, caller="STRANGER").returncode != 0
    assert "Called AE Title Not Recognized" in receiver.echo(called="OTHER").stdout
    assert "Calling AE Title Not Recognized" in receiver.echo(caller="STRANGER").stdout
    assert receiver.echo().returncode == 0
    time.sleep(1)
    assert receiver.studies() == [] and receiver.is_tidy()


def test_study_of_several_associations_is_published_once(programs, place):
    uid, first = study(place / "sent", 1, slices=2)
    _, second = study(place / "sent", 1, slices=2, first=2)
    with Receiver(programs, place / "scans", settle=2) as receiver:
        with Association(receiver.port) as open_one:  # carries the study: it is not complete
            data = image(uid, f"{uid}.1", 7)
            open_one.send(associate())
            assert open_one.read()[0] == 2
            assert open_one.store(CT, data.SOPInstanceUID, dataset_bytes(data)) == STORED
            for files in (first, second):
                assert receiver.send(*files).returncode == 0
            time.sleep(3)
            assert receiver.studies() == []
            open_one.send(RELEASE)
            assert open_one.read()[0] == 6
        receiver.wait_for_study(uid, 5)
        assert receiver.printed().count(f"study {uid}") == 1


def test_later_instances_extend_a_study(receiver, place):
    uid, first = study(place / "sent", 1, slices=2)
    assert receiver.send(*first).returncode == 0
    receiver.wait_for_study(uid, 2)
    before = {path.name: path.read_bytes() for path in (receiver.folder / uid).iterdir()}
    _, more = study(place / "sent", 1, slices=2, first=2)
    _, changed = study(place / "changed", 1, slices=1, seed=5)
    assert receiver.send(*more, *changed).returncode == 0
    receiver.wait_for_study(uid, 4)
    after = {path.name: path.read_bytes() for path in (receiver.folder / uid).iterdir()}
    assert before.items() <= after.items()
    wait_for(lambda: "1 instances left out" in receiver.complained(), "the changed instance is reported")
    assert receiver.is_tidy()
    assert "4 instances, 2 of them new" in receiver.printed()


def test_dropped_association_leaves_nothing(receiver, place):
    data = image("2.25.4711.1", "2.25.4711.1.1", 0)
    whole = dataset_bytes(data)
    for cut in ("in a dataset", "between instances", "by an abort"):
        with Association(receiver.port) as sender:
            sender.send(associate())
            assert sender.read()[0] == 2
            assert sender.store(CT, data.SOPInstanceUID, whole) == STORED
            if cut == "in a dataset":
                other = image("2.25.4711.1", "2.25.4711.1.1", 1)
                sender.send(data_pdus(3, True, store_command(CT, other.SOPInstanceUID)) + data_pdus(3, False, dataset_bytes(other))[:900])
                time.sleep(0.2)
            if cut == "by an abort":
                sender.send(b"\x07\0\0\0\0\x04\0\0\0\0")
    wait_for(lambda: receiver.complained().count("dropped") == 3, "three dropped associations")
    time.sleep(1)
    assert receiver.studies() == [] and receiver.is_tidy()
    assert receiver.echo().returncode == 0


def test_storescu_killed_in_the_middle(receiver, place):
    uid, files = study(place / "sent", 1, slices=200, size=256)
    sender = subprocess.Popen([str(word) for word in ("storescu", "-aet", "SENDER", "-aec", "TROCAR", "127.0.0.1", receiver.port, *files)])
    wait_for(lambda: len(list(receiver.folder.glob(f".incoming/associations/*/{uid}/*.dcm"))) > 20, "the first instances", 30)
    sender.kill()
    sender.wait()
    assert receiver.is_tidy()
    time.sleep(1)
    assert receiver.studies() == []
    assert receiver.send(*files).returncode == 0
    receiver.wait_for_study(uid, 200)


HOSTILE = {
    "path in the instance": (lambda d: None, "../../../escaped", NOT_UNDERSTOOD),
    "absolute path": (lambda d: None, "/tmp/escaped", NOT_UNDERSTOOD),
    "path in the study": (lambda d: setattr(d, "StudyInstanceUID", "../../escaped"), None, NOT_UNDERSTOOD),
    "dots as study": (lambda d: setattr(d, "StudyInstanceUID", ".."), None, NOT_UNDERSTOOD),
    "hidden folder as study": (lambda d: setattr(d, "StudyInstanceUID", ".incoming"), None, NOT_UNDERSTOOD),
    "no study": (lambda d: delattr(d, "StudyInstanceUID"), None, NOT_UNDERSTOOD),
    "path in the series": (lambda d: setattr(d, "SeriesInstanceUID", "a/b"), None, NOT_UNDERSTOOD),
    "other instance than announced": (lambda d: None, "1.2.3", MISMATCH),
    "other class than announced": (lambda d: setattr(d, "SOPClassUID", "1.2.840.10008.5.1.4.1.1.4"), None, MISMATCH),
    "no pixels": (lambda d: delattr(d, "PixelData"), None, MISMATCH),
}


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.filterwarnings("ignore")
def test_hostile_instance_is_refused(receiver, place, name):
    change, announced, status = HOSTILE[name]
    good, bad = image("2.25.4711.1", "2.25.4711.1.1", 0), image("2.25.4711.1", "2.25.4711.1.1", 1)
    change(bad)
    with Association(receiver.port) as sender:
        sender.send(associate())
        assert sender.read()[0] == 2
        assert sender.store(CT, announced or bad.SOPInstanceUID, dataset_bytes(bad)) == status
        assert sender.store(CT, good.SOPInstanceUID, dataset_bytes(good)) == STORED
        sender.send(RELEASE)
        assert sender.read()[0] == 6
    receiver.wait_for_study("2.25.4711.1", 1)
    assert receiver.studies() == ["2.25.4711.1"] and receiver.is_tidy()
    assert not any("escaped" in str(path) for path in place.rglob("*")) and not os.path.exists("/tmp/escaped.dcm")
    assert "refused" in receiver.complained()


def test_truncated_dataset_is_refused(receiver):
    data = image("2.25.4711.1", "2.25.4711.1.1", 0)
    with Association(receiver.port) as sender:
        sender.send(associate())
        assert sender.read()[0] == 2
        assert sender.store(CT, data.SOPInstanceUID, dataset_bytes(data)[:-500]) == NOT_UNDERSTOOD
        assert sender.store(CT, data.SOPInstanceUID, b"no dicom" * 100) == NOT_UNDERSTOOD
        sender.send(RELEASE)
    time.sleep(1)
    assert receiver.studies() == [] and receiver.is_tidy()


def test_limits(programs, place):
    small = image("2.25.4711.1", "2.25.4711.1.1", 0)
    large = image("2.25.4711.1", "2.25.4711.1.1", 1, size=800)  # 1.3 MB
    huge = image("2.25.4711.1", "2.25.4711.1.1", 2, size=1200)  # 2.9 MB: more than twice the limit
    with Receiver(programs, place / "scans", "--max-instance-mb", 1, "--max-instances", 3) as receiver:
        with Association(receiver.port) as sender:
            sender.send(associate())
            assert sender.read()[0] == 2
            assert sender.store(CT, large.SOPInstanceUID, dataset_bytes(large)) == OUT_OF_RESOURCES
            for k in (0, 3, 4):
                one = image("2.25.4711.1", "2.25.4711.1.1", k)
                assert sender.store(CT, one.SOPInstanceUID, dataset_bytes(one)) == STORED
            changed = image("2.25.4711.1", "2.25.4711.1.1", 0, seed=3)
            assert sender.store(CT, small.SOPInstanceUID, dataset_bytes(small)) == STORED  # sent twice
            assert sender.store(CT, small.SOPInstanceUID, dataset_bytes(changed)) == DUPLICATE
            excess = image("2.25.4711.1", "2.25.4711.1.1", 5)
            assert sender.store(CT, excess.SOPInstanceUID, dataset_bytes(excess)) == OUT_OF_RESOURCES
            sender.send(RELEASE)
            assert sender.read()[0] == 6
        receiver.wait_for_study("2.25.4711.1", 3)
        with Association(receiver.port) as sender:  # the limit counts what is published
            sender.send(associate())
            assert sender.read()[0] == 2
            assert sender.store(CT, excess.SOPInstanceUID, dataset_bytes(excess)) == OUT_OF_RESOURCES
            try:
                assert sender.store(CT, huge.SOPInstanceUID, dataset_bytes(huge)) is None  # it is cut off
            except ConnectionError:
                pass
        assert receiver.echo().returncode == 0


def test_slow_senders_are_dropped(programs, place):
    with Receiver(programs, place / "scans", "--acse-timeout", 2, "--idle-timeout", 2, "--dimse-timeout", 3, "--max-associations", 2) as receiver:
        request = associate()
        silent, dribbling = Association(receiver.port), Association(receiver.port)
        for k in range(30):  # a byte every 0.1 s must not hold the association
            try:
                dribbling.send(request[k:k + 1])
            except ConnectionError:
                break
            time.sleep(0.1)
        wait_for(lambda: receiver.processes() == [], "both are dropped", 10)
        with Association(receiver.port) as idle:
            idle.send(request)
            assert idle.read()[0] == 2
            assert idle.read()[0] in (7, None)
        with Association(receiver.port) as slow:  # an instance that never ends
            slow.send(request)
            assert slow.read()[0] == 2
            slow.send(data_pdus(3, True, store_command(CT, "1.2.3")))
            try:
                for _ in range(80):
                    slow.send(data_pdus(3, False, bytes(100), last=False))
                    time.sleep(0.1)
                raise AssertionError("the sender was not dropped")
            except ConnectionError:
                pass
        silent.socket.close()
        dribbling.socket.close()
        assert receiver.echo().returncode == 0
        assert receiver.studies() == [] and "took too long" in receiver.complained()


def test_200_associations_at_once(programs, place):
    uid, files = study(place / "sent", 1, slices=2)
    with Receiver(programs, place / "scans", "--max-associations", 16) as receiver:
        receiver.echo()
        before = receiver.memory_kb()
        most, statuses, over = [0], [], threading.Event()

        def count():
            while not over.is_set():
                most[0] = max(most[0], len(receiver.processes()))
                time.sleep(0.01)

        counter = threading.Thread(target=count)
        counter.start()
        senders = [Association(receiver.port, 120) for _ in range(200)]

        def send(k):
            data = image(f"2.25.4711.{k}", f"2.25.4711.{k}.1", 0)
            try:
                senders[k].send(associate())
                assert senders[k].read()[0] == 2
                status = senders[k].store(CT, data.SOPInstanceUID, dataset_bytes(data))
                senders[k].send(RELEASE)
                assert senders[k].read()[0] == 6
                statuses.append(status)
            except Exception as error:  # counted below
                statuses.append(repr(error))
            senders[k].socket.close()

        threads = [threading.Thread(target=send, args=(k,)) for k in range(200)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        over.set()
        counter.join()
        assert statuses == [STORED] * 200, [one for one in statuses if one != STORED][:3]
        assert 1 <= most[0] <= 16, most
        wait_for(lambda: len(receiver.studies()) == 200, "200 studies")
        after = receiver.memory_kb()
        print(f"memory {before} kB, after 200 associations {after} kB; at most {most[0]} at once")
        if not SANITIZED:
            assert after < before + 4096
        assert receiver.echo().returncode == 0


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can mount a small file system")
def test_full_disk(programs, place):
    disk = place / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(disk)], check=False).returncode != 0:
        pytest.skip("no file system can be mounted here")
    try:
        uid, files = study(place / "sent", 1, slices=10, size=400)  # 3.2 MB
        small, few = study(place / "sent", 2, slices=2)
        receiver = Receiver(programs, disk / "scans")
        with receiver:
            with Association(receiver.port) as sender:
                sender.send(associate())
                assert sender.read()[0] == 2
                statuses = []
                for k in range(10):
                    data = image(uid, f"{uid}.1", k, size=400)
                    statuses.append(sender.store(CT, data.SOPInstanceUID, dataset_bytes(data)))
                assert OUT_OF_RESOURCES in statuses and STORED in statuses
            assert receiver.is_tidy()
            receiver.send(*files)  # storescu goes on or stops
            time.sleep(1)
            assert "No space left" in receiver.complained()
            shutil.rmtree(receiver.folder / uid, ignore_errors=True)
            wait_for(lambda: receiver.send(*few).returncode == 0, "it stores again")
            receiver.wait_for_study(small, 2)
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=False)


def test_signal_soon_after_a_failed_attempt_publishes(receiver, place):
    """An attempt to take a released association is repeated after 5 s, and at the end of the program in any case."""
    uid, files = study(place / "sent", 1, slices=2)
    studies = receiver.folder / ".incoming" / "studies"
    studies.rename(studies.with_name("aside"))
    assert receiver.send(*files).returncode == 0
    wait_for(lambda: uid in receiver.complained(), "an attempt has failed")
    studies.with_name("aside").rename(studies)
    assert receiver.stop() == 0
    assert f"study {uid}: 2 instances" in receiver.printed()
    assert len(list((receiver.folder / uid).glob("*.dcm"))) == 2


def test_killed_receiver_leaves_nothing_half(programs, place):
    done_uid, done = study(place / "sent", 1, slices=2)
    data = image("2.25.4711.2", "2.25.4711.2.1", 0)
    with Receiver(programs, place / "scans", settle=1000) as receiver:
        assert receiver.send(*done).returncode == 0  # released, but not settled
        wait_for(lambda: (receiver.folder / ".incoming/studies" / done_uid).is_dir(), "the instances are taken")
        sender = Association(receiver.port)
        sender.send(associate())
        assert sender.read()[0] == 2
        assert sender.store(CT, data.SOPInstanceUID, dataset_bytes(data)) == STORED  # never released
        children = receiver.processes()
        receiver.process.kill()
        receiver.process.wait()
        sender.socket.close()
        wait_for(lambda: not any(os.path.exists(f"/proc/{child}/exe") for child in children), "its processes end with it")
        assert receiver.studies() == []
    with Receiver(programs, place / "scans") as receiver:
        receiver.wait_for_study(done_uid, 2)  # its association had ended properly
        assert receiver.studies() == [done_uid] and receiver.is_tidy()


def test_what_a_release_has_acknowledged_survives_a_kill(programs, place):
    """The receiver is killed as soon as a sender has the answer to its release."""
    for k in range(20):
        study_uid = f"2.25.4712.{k + 1}"
        data = image(study_uid, f"{study_uid}.1", 0)
        with Receiver(programs, place / "scans", settle=1000) as receiver, Association(receiver.port) as sender:
            sender.send(associate())
            assert sender.read()[0] == 2
            assert sender.store(CT, data.SOPInstanceUID, dataset_bytes(data)) == STORED
            sender.send(RELEASE)
            assert sender.read()[0] == 6  # the answer to a release
            receiver.process.kill()
            receiver.process.wait()
    with Receiver(programs, place / "scans") as receiver:
        receiver.wait_for_study("2.25.4712.20", 1)
        wait_for(lambda: len(receiver.studies()) == 20, f"all studies are kept; {receiver.studies()} are")


def test_one_receiver_for_a_folder(receiver, programs):
    other = subprocess.run([str(word) for word in (programs / "trocar-mesh", "receive", "--port", 0, "--ae", "A", "--from", "B", receiver.folder)],
                           stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=30, check=False)
    assert other.returncode == 4 and "another receiver stores its studies here" in other.stderr


def test_keep_removes_old_studies_only(programs, place):
    uid, files = study(place / "sent", 1, slices=2)
    with Receiver(programs, place / "scans", "--keep", 3 / 3600) as receiver:
        (receiver.folder / "2.25.1").mkdir()  # not received
        (receiver.folder / "notes").mkdir()
        assert receiver.send(*files).returncode == 0
        receiver.wait_for_study(uid, 2)
        time.sleep(1.5)
        assert uid in receiver.studies()
        wait_for(lambda: uid not in receiver.studies(), "the study is removed", 10)
        assert receiver.studies() == ["2.25.1", "notes"] and receiver.is_tidy()
        assert "hours, then they are removed" in receiver.printed() and f"study {uid}: removed" in receiver.printed()


def test_signals_end_it(programs, place):
    uid, files = study(place / "sent", 1, slices=2)
    for number in (signal.SIGINT, signal.SIGTERM):
        with Receiver(programs, place / f"scans{number}", settle=1000) as receiver:
            assert receiver.send(*files).returncode == 0
            assert receiver.stop(number) == 0
            assert receiver.studies() == [uid] and receiver.is_tidy()


def test_a_study_that_is_being_sent_does_not_appear_at_the_end(programs, place):
    uid, files = study(place / "sent", 1)
    data = image(uid, f"{uid}.1", 7)
    with Receiver(programs, place / "scans", settle=1000) as receiver:
        with Association(receiver.port) as open_one:
            open_one.send(associate())
            assert open_one.read()[0] == 2
            assert open_one.store(CT, data.SOPInstanceUID, dataset_bytes(data)) == STORED
            assert receiver.send(*files).returncode == 0
            assert receiver.stop() == 0
        assert receiver.studies() == [], "a part of a study was published"
        assert f"study {uid}: not complete" in receiver.complained()
    with Receiver(programs, place / "scans") as receiver:
        receiver.wait_for_study(uid, 4)
        assert receiver.studies() == [uid] and receiver.is_tidy()


def test_then_meshes_each_complete_study(programs, place):
    collection, store = place / "collection.json", place / "store"
    collection.write_text(json.dumps({"schema": "trocar.collection/1", "defaults": {"tolerance": 0.5},
                                      "scans": [{"name": "mine", "input": "nowhere.nii.gz"}]}))
    sent = [study(place / "sent", k) for k in (1, 2, 3)]
    with Receiver(programs, place / "scans", "--then", collection, store) as receiver:
        assert receiver.send(*(file for _, files in sent for file in files)).returncode == 0
        wait_for(lambda: receiver.printed().count("its assets are in") == 3, "three batches", 120)
        assert receiver.stop() == 0
    made = json.loads(collection.read_text())
    assert made["defaults"] == {"tolerance": 0.5} and made["scans"][0]["name"] == "mine" and len(made["scans"]) == 4
    assert collection.read_text().find("SECRET") < 0
    for uid, _ in sent:
        assets = list((store / "assets").glob(f"{uid}_*.glb"))
        assert len(assets) == 1
        run(programs / "trocar-mesh", "verify", assets[0])


def test_then_goes_on_after_a_failure_and_a_restart(programs, place):
    collection, store = place / "new/collection.json", place / "store"
    collection.parent.mkdir()
    empty = image("2.25.4711.5", "2.25.4711.5.1", 0)
    empty.PixelData = bytes(len(empty.PixelData))  # nothing to mesh
    uid, files = study(place / "sent", 1)
    with Receiver(programs, place / "scans", "--then", collection, store) as receiver:
        assert receiver.send(save(empty, place / "empty.dcm")).returncode == 0
        wait_for(lambda: "its batch failed (exit code 3)" in receiver.complained() or "no scan that can be meshed" in receiver.complained(), "a failure")
        assert receiver.send(*files).returncode == 0
        receiver.wait_for_study(uid, 4)
        receiver.process.kill()  # its batch may not have begun
        receiver.process.wait()
    with Receiver(programs, place / "scans", "--then", collection, store) as receiver:
        wait_for(lambda: list((store / "assets").glob(f"{uid}_*.glb")), "the asset is made after the restart", 120)


USAGES = [
    (("receive", "--port", 0, "--ae", "A", "scans"), "--from is required"),
    (("receive", "--port", 0, "--from", "B", "scans"), "--ae is required"),
    (("receive", "--port", 0, "--ae", "A" * 17, "--from", "B", "scans"), "--ae"),
    (("receive", "--port", 0, "--ae", "A", "--from", "B", "--listen", "0.0.0.0", "scans"), "--insecure"),
    (("receive", "--port", 0, "--ae", "A", "--from", "B", "--listen", "::", "scans"), "--insecure"),
    (("receive", "--port", 0, "--ae", "A", "--from", "B", "--tls-key", "a.pem", "scans"), "must be given together"),
]


@pytest.mark.parametrize("words, message", USAGES)
def test_wrong_usage(programs, place, words, message):
    done = run(programs / "trocar-mesh", *words, expect=2, cwd=place)
    assert message in done.stderr and done.stderr.count("\n") == 1
    assert list(place.iterdir()) == []
