# SPDX-License-Identifier: Apache-2.0
"""For the tests of trocar-mesh receive and fetch: studies to send, a running receiver, and the other side of an association."""
import os
import pathlib
import re
import selectors
import signal
import socket
import struct
import subprocess
import time

import numpy
import pydicom
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.uid import ExplicitVRLittleEndian

CT = "1.2.840.10008.5.1.4.1.1.2"
VERIFICATION = "1.2.840.10008.1.1"
GET = "1.2.840.10008.5.1.4.1.2.2.3"
EXPLICIT = "1.2.840.10008.1.2.1"
IMPLICIT = "1.2.840.10008.1.2"
PATIENT = "SECRET^NAME"
ROOT = "2.25.4711"


def image(study, series, number, size=32, seed=0):
    """One slice of a CT: a bone of 1000 HU in air."""
    out = Dataset()
    out.SOPClassUID, out.SOPInstanceUID = CT, f"{series}.{number + 1}"
    out.StudyInstanceUID, out.SeriesInstanceUID, out.FrameOfReferenceUID = study, series, f"{study}.99"
    out.PatientName, out.PatientID, out.Modality, out.SeriesNumber, out.InstanceNumber = PATIENT, "SECRET-ID", "CT", 1, number + 1
    out.StudyDate, out.StudyTime, out.StudyID, out.AccessionNumber = "20260101", "120000", "1", ""
    out.PatientBirthDate, out.PatientSex, out.ReferringPhysicianName = "", "", ""
    out.ImageType = ["ORIGINAL", "PRIMARY", "AXIAL"]
    out.Rows = out.Columns = size
    out.PixelSpacing, out.SliceThickness = [1, 1], 1
    out.ImagePositionPatient, out.ImageOrientationPatient = [0, 0, number], [1, 0, 0, 0, 1, 0]
    out.SamplesPerPixel, out.PhotometricInterpretation, out.PixelRepresentation = 1, "MONOCHROME2", 1
    out.BitsAllocated, out.BitsStored, out.HighBit = 16, 16, 15
    out.RescaleSlope, out.RescaleIntercept, out.RescaleType = 1, 0, "HU"
    pixels = numpy.full((size, size), -1000, numpy.int16)
    pixels[size // 4:3 * size // 4, size // 4:3 * size // 4] = 1000
    pixels[0, 0] = seed
    out.PixelData = pixels.tobytes()
    return out


def save(data, file, syntax=ExplicitVRLittleEndian):
    data.file_meta = FileMetaDataset()
    data.file_meta.MediaStorageSOPClassUID, data.file_meta.MediaStorageSOPInstanceUID = data.SOPClassUID, data.SOPInstanceUID
    data.file_meta.TransferSyntaxUID = syntax
    data.is_little_endian, data.is_implicit_VR = True, syntax == IMPLICIT
    pydicom.dcmwrite(str(file), data, write_like_original=False)
    return file


def study(folder, number, slices=4, size=32, first=0, seed=0):
    """Writes a study's slices; returns its UID and its files."""
    folder.mkdir(parents=True, exist_ok=True)
    uid = f"{ROOT}.{number}"
    return uid, [save(image(uid, f"{uid}.1", first + k, size, seed), folder / f"{number}_{first + k}.dcm") for k in range(slices)]


def free_port():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


def wait_for(condition, what, seconds=60):
    end = time.monotonic() + seconds
    while not (value := condition()):
        assert time.monotonic() < end, f"not within {seconds} s: {what}"
        time.sleep(0.05)
    return value


class Receiver:
    """A running trocar-mesh receive. Its output goes to files beside its folder."""

    def __init__(self, programs, folder, *options, ae="TROCAR", callers=("SENDER",), settle=0.3, environment=None, expect_start=True):
        self.folder = pathlib.Path(folder)
        self.folder.parent.mkdir(parents=True, exist_ok=True)
        self.out, self.err = self.folder.with_suffix(".out"), self.folder.with_suffix(".err")
        words = [programs / "trocar-mesh", "receive", "--port", 0, "--ae", ae, "--settle", settle]
        for caller in callers:
            words += ["--from", caller]
        with open(self.out, "w") as out, open(self.err, "w") as err:
            self.process = subprocess.Popen([str(word) for word in (*words, *options, self.folder)], stdout=out, stderr=err,
                                            env=dict(os.environ, **(environment or {})))
        if expect_start:
            wait_for(lambda: self.process.poll() is not None or "stay" in self.printed(), "the receiver starts")
            self.port = int(re.search(r"port (\d+)", self.printed())[1])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()

    def printed(self):
        return self.out.read_text()

    def complained(self):
        return self.err.read_text()

    def stop(self, number=signal.SIGTERM):
        self.process.send_signal(number)
        return self.process.wait(30)

    def studies(self):
        return sorted(path.name for path in self.folder.iterdir() if path.name != ".incoming")

    def wait_for_study(self, uid, instances):
        """Until the study has this many instances and a line says so. The line is printed after the folder has appeared."""
        wait_for(lambda: (self.folder / uid).is_dir() and len(list((self.folder / uid).glob("*.dcm"))) == instances
                 and f"study {uid}: {instances} instances" in self.printed(), f"{instances} instances of {uid}")

    def processes(self):
        """The process ids of its open associations."""
        return pathlib.Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()

    def memory_kb(self):
        status = pathlib.Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+)", status)[1])

    def waiting(self):
        """What is in .incoming besides locks and marks."""
        return [str(path) for part in ("associations", "released", "studies", "replaced") for path in (self.folder / ".incoming" / part).iterdir()]

    def is_tidy(self):
        """Waits until nothing is in .incoming any more."""
        return wait_for(lambda: self.waiting() == [], "nothing is left in .incoming", 20)

    def echo(self, caller="SENDER", called="TROCAR", options=()):
        return dcmtk("echoscu", "-aet", caller, "-aec", called, "-to", "20", *options, "127.0.0.1", self.port)

    def send(self, *files, caller="SENDER", called="TROCAR", options=()):
        return dcmtk("storescu", "-aet", caller, "-aec", called, "-to", "60", *options, "127.0.0.1", self.port, *files)


def dcmtk(*words):
    """Runs a program of DCMTK; the result has its exit code and its output."""
    return subprocess.run([str(word) for word in words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False, timeout=300)


# The other side of an association, byte by byte (DICOM PS3.8, 9.3).


def item(kind, body):
    return struct.pack(">BBH", kind, 0, len(body)) + body


def pdu(kind, body):
    return struct.pack(">BBI", kind, 0, len(body)) + body


def associate(called="TROCAR", caller="SENDER", contexts=((1, VERIFICATION), (3, CT))):
    """An A-ASSOCIATE-RQ."""
    body = struct.pack(">HH", 1, 0) + called.ljust(16).encode() + caller.ljust(16).encode() + bytes(32)
    body += item(0x10, b"1.2.840.10008.3.1.1.1")
    for number, syntax in contexts:
        body += item(0x20, bytes([number, 0, 0, 0]) + item(0x30, syntax.encode()) + item(0x40, EXPLICIT.encode()))
    body += item(0x50, item(0x51, struct.pack(">I", 16384)) + item(0x52, b"1.2.3.4") + item(0x55, b"TEST"))
    return pdu(1, body)


def element(group, number, value):
    return struct.pack("<HHI", group, number, len(value)) + value


def even(text):
    return text.encode() + b"\0" * (len(text) % 2)


def store_command(sop_class, sop_instance, message=1):
    """The command set of a C-STORE-RQ."""
    body = element(0, 2, even(sop_class)) + element(0, 0x100, struct.pack("<H", 1)) + element(0, 0x110, struct.pack("<H", message))
    body += element(0, 0x700, struct.pack("<H", 0)) + element(0, 0x800, struct.pack("<H", 1)) + element(0, 0x1000, even(sop_instance))
    return element(0, 0, struct.pack("<I", len(body))) + body


def data_pdus(context, command, data, last=True):
    """P-DATA-TF PDUs with a command, or a dataset, in fragments."""
    out, size = b"", 8192
    for at in range(0, max(len(data), 1), size):
        fragment = data[at:at + size]
        ends = last and at + size >= len(data)
        out += pdu(4, struct.pack(">IBB", len(fragment) + 2, context, (1 if command else 0) | (2 if ends else 0)) + fragment)
    return out


RELEASE = pdu(5, bytes(4))


def dataset_bytes(data):
    """The dataset as it is sent, explicit and little endian, without a file's header."""
    from pydicom.filebase import DicomBytesIO
    from pydicom.filewriter import write_dataset
    buffer = DicomBytesIO()
    buffer.is_little_endian, buffer.is_implicit_VR = True, False
    write_dataset(buffer, data)
    return buffer.getvalue()


class Association:
    """A connection that sends bytes and reads PDUs."""

    def __init__(self, port, seconds=20):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=seconds)

    @classmethod
    def of(cls, connection):
        """The side of an association that has accepted the connection."""
        out = cls.__new__(cls)
        out.socket = connection
        return out

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()

    def send(self, data):
        self.socket.sendall(data)

    def read(self):
        """(kind, body) of the next PDU; (None, b"") at the end."""
        head = self.exactly(6)
        if head is None:
            return None, b""
        kind, _, size = struct.unpack(">BBI", head)
        return kind, self.exactly(size) or b""

    def exactly(self, size):
        out = b""
        while len(out) < size:
            try:
                got = self.socket.recv(size - len(out))
            except ConnectionError:
                return None
            if not got:
                return None
            out += got
        return out

    def store(self, sop_class, sop_instance, data, context=3):
        """Sends a C-STORE and returns the status of its answer; None if the association ends."""
        self.send(data_pdus(context, True, store_command(sop_class, sop_instance)) + data_pdus(context, False, data))
        kind, body = self.read()
        if kind != 4:
            return None
        at = body.index(struct.pack("<HHI", 0, 0x900, 2)) + 8
        return struct.unpack_from("<H", body, at)[0]


def items_in(data):
    """(kind, body) of the items in a part of a PDU."""
    out, at = [], 0
    while at < len(data):
        kind, _, size = struct.unpack_from(">BBH", data, at)
        out.append((kind, data[at + 4:at + 4 + size]))
        at += 4 + size
    return out


def accept(request):
    """The A-ASSOCIATE-AC to the body of an A-ASSOCIATE-RQ, and the number of the first context of each kind that it accepts: those with
    explicit representation, in the roles that were proposed."""
    body, contexts, roles = request[:68] + item(0x10, b"1.2.840.10008.3.1.1.1"), {}, b""
    for kind, data in items_in(request[68:]):
        if kind == 0x20:
            of = [value.rstrip(b"\0").decode() for part, value in items_in(data[4:]) if part == 0x30][0]
            syntaxes = [value.rstrip(b"\0").decode() for part, value in items_in(data[4:]) if part == 0x40]
            is_accepted = EXPLICIT in syntaxes
            if is_accepted:
                contexts.setdefault(of, data[0])
            body += item(0x21, bytes([data[0], 0, 0 if is_accepted else 4, 0]) + item(0x40, EXPLICIT.encode()))
        elif kind == 0x50:
            roles = b"".join(item(0x54, value) for part, value in items_in(data) if part == 0x54)
    return pdu(2, body + item(0x50, item(0x51, struct.pack(">I", 16384)) + item(0x52, b"1.2.3.4") + roles)), contexts


def read_message(association):
    """Reads a command with its dataset to the end."""
    ended = set()
    while len(ended) < 2:
        kind, body = association.read()
        assert kind == 4, f"PDU {kind}"
        at = 0
        while at < len(body):
            size, _, control = struct.unpack_from(">IBB", body, at)
            if control & 2:
                ended.add(control & 1)
            at += 4 + size


def get_response(context, status):
    """The answer to a C-GET, without any number of instances."""
    body = element(0, 2, even(GET)) + element(0, 0x100, struct.pack("<H", 0x8010)) + element(0, 0x120, struct.pack("<H", 1))
    body += element(0, 0x800, struct.pack("<H", 0x101)) + element(0, 0x900, struct.pack("<H", status))
    return data_pdus(context, True, element(0, 0, struct.pack("<I", len(body))) + body)


def answer_get(listening, data, status, times=1, before=None):
    """The archive's side of one C-GET: it calls `before`, sends one CT slice this many times, then the status."""
    connection, _ = listening.accept()
    connection.settimeout(20)
    with Association.of(connection) as association:
        answer, contexts = accept(association.read()[1])
        association.send(answer)
        read_message(association)
        if before:
            before(association, contexts)
        for _ in range(times):
            if association.store(CT, data.SOPInstanceUID, dataset_bytes(data), contexts[CT]) is None:
                return
        association.send(get_response(contexts[GET], status))
        if association.read()[0] == 5:  # a request to release
            association.send(pdu(6, bytes(4)))


def read_all(sockets, seconds):
    """Reads from all sockets until each is closed by the other side; returns how many were not within the time."""
    waiting = selectors.DefaultSelector()
    for one in sockets:
        waiting.register(one, selectors.EVENT_READ)
    end = time.monotonic() + seconds
    while waiting.get_map() and time.monotonic() < end:
        for key, _ in waiting.select(0.1):
            try:
                if key.fileobj.recv(65536):
                    continue
            except OSError:
                pass
            waiting.unregister(key.fileobj)
    return len(waiting.get_map())
