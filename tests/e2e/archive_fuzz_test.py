# SPDX-License-Identifier: Apache-2.0
"""Mutated PDUs against trocar-mesh receive: it must go on answering, store nothing that is not whole, and need no more memory.

TROCAR_FUZZED_PDUS sets their number (2000), TROCAR_FUZZ_SEED the seed. A process of the receiver that crashes ends only its
association; the receiver then reports a signal or an exit code, which fails this test.
"""
import os
import random
import re
import struct
import threading
import time

import pydicom
from archive_peer import CT, RELEASE, VERIFICATION, Association, Receiver, associate, data_pdus, dataset_bytes, even, image, element, pdu, store_command, study, wait_for
from programs import SANITIZED

PDUS = int(os.environ.get("TROCAR_FUZZED_PDUS", 2000))
SEED = int(os.environ.get("TROCAR_FUZZ_SEED", 1))
PDUS_OF_A_CONNECTION, SENDERS = 40, 4
DATASET = dataset_bytes(image("2.25.66", "2.25.66.1", 0, size=16))
UNUSUAL_LENGTHS = (0, 1, 2, 5, 6, 0x7FFF, 0xFFFF, 0x10000, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFE, 0xFFFFFFFF)


def echo_command(message):
    body = element(0, 2, even(VERIFICATION)) + element(0, 0x100, struct.pack("<H", 0x30)) + element(0, 0x110, struct.pack("<H", message))
    body += element(0, 0x800, struct.pack("<H", 0x101))
    return element(0, 0, struct.pack("<I", len(body))) + body


def mutated(random_, data):
    """The bytes with one to eight changes: bytes, lengths, cuts, copies."""
    out = bytearray(data)
    for _ in range(random_.randint(1, 8)):
        at = random_.randrange(len(out)) if out else 0
        kind = random_.randrange(7)
        if kind == 0 and out:
            out[at] = random_.randrange(256)
        elif kind == 1 and out:
            out[at] ^= 1 << random_.randrange(8)
        elif kind == 2 and len(out) >= 4:  # a length, of either byte order
            at = random_.randrange(len(out) - 3)
            out[at:at + 4] = struct.pack(random_.choice("<>") + "I", random_.choice(UNUSUAL_LENGTHS))
        elif kind == 3 and len(out) >= 2:
            at = random_.randrange(len(out) - 1)
            out[at:at + 2] = struct.pack(random_.choice("<>") + "H", random_.choice(UNUSUAL_LENGTHS) & 0xFFFF)
        elif kind == 4:
            del out[at:at + random_.randint(1, 64)]
        elif kind == 5:
            out[at:at] = out[at:at + random_.randint(1, 64)]
        else:
            out[at:at] = random_.randbytes(random_.randint(1, 16))
    return bytes(out)


def whole(random_, data):
    """The PDU with the length in its header that its body has, most of the time, so that what is in it is read."""
    if len(data) < 6 or random_.random() < 0.1:
        return data
    return data[:2] + struct.pack(">I", len(data) - 6) + data[6:]


def seeds(random_):
    number = random_.randint(1, 65535)
    return random_.choice((
        lambda: associate(),
        lambda: data_pdus(1, True, echo_command(number)),
        lambda: data_pdus(3, True, store_command(CT, "2.25.66.1.1", number)),
        lambda: data_pdus(3, False, DATASET),
        lambda: RELEASE,
        lambda: pdu(7, bytes(4)),
        lambda: pdu(random_.randrange(256), random_.randbytes(random_.randrange(64))),
    ))()


def connection(port, random_, budget):
    """Sends mutated PDUs until the receiver ends the association or `budget` is spent; returns how many were sent."""
    sent = 0
    try:
        with Association(port, 5) as sender:
            if random_.random() < 0.15:  # the request itself is mutated
                sender.send(whole(random_, mutated(random_, associate())))
                sent += 1
            else:
                sender.send(associate())
                if sender.read()[0] != 2:
                    return sent
            sender.socket.settimeout(0.002)
            while sent < budget:
                one = seeds(random_)
                sender.send(whole(random_, mutated(random_, one)) if random_.random() < 0.7 or one == RELEASE else one)
                sent += 1
                try:
                    if not sender.socket.recv(65536):
                        break
                except TimeoutError:
                    pass
    except OSError:
        pass
    return sent


def test_mutated_pdus(programs, work):
    good, files = study(work / "sent", 1, slices=2)
    environment = {"ASAN_OPTIONS": "detect_leaks=0:exitcode=99:quarantine_size_mb=4", "UBSAN_OPTIONS": "halt_on_error=1:print_stacktrace=1:exitcode=98"}
    with Receiver(programs, work / "scans", "--idle-timeout", 2, "--dimse-timeout", 5, "--acse-timeout", 2, environment=environment) as receiver:
        assert receiver.echo().returncode == 0
        memory = [receiver.memory_kb()]
        sent, connections, start = [0] * SENDERS, [0] * SENDERS, time.monotonic()

        def send(k):
            random_ = random.Random(SEED * SENDERS + k)
            while sent[k] < PDUS / SENDERS and receiver.process.poll() is None:
                sent[k] += connection(receiver.port, random_, PDUS_OF_A_CONNECTION)
                connections[k] += 1

        senders = [threading.Thread(target=send, args=(k,)) for k in range(SENDERS)]
        for sender in senders:
            sender.start()
        while any(sender.is_alive() for sender in senders):
            memory.append(receiver.memory_kb())
            time.sleep(0.5)
        assert receiver.process.poll() is None
        wait_for(lambda: receiver.processes() == [], "all associations end")
        assert receiver.echo().returncode == 0
        memory.append(receiver.memory_kb())
        print(f"{sum(sent)} PDUs in {sum(connections)} connections, {time.monotonic() - start:.0f} s; "
              f"memory {memory[0]} kB at first, {max(memory)} kB at most, {memory[-1]} kB at last")
        crashes = re.findall(r".*(?:by signal|exit code|Sanitizer|runtime error).*", receiver.complained())
        assert not crashes, crashes[:5]
        assert max(memory) < memory[0] + (65536 if SANITIZED or "asan" in str(programs) else 4096), memory
        assert receiver.is_tidy()
        # A few of the mutated PDUs are a whole instance and a release. What they have stored must be whole.
        for file in receiver.folder.glob("2*/*"):
            assert len(pydicom.dcmread(file).PixelData) == 16 * 16 * 2, file
        stored = len(receiver.studies())
        print(f"{stored} studies stored")
        assert stored <= 1 + sum(sent) // 10000
        assert receiver.send(*files).returncode == 0
        receiver.wait_for_study(good, 2)
