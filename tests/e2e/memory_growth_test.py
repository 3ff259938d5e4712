# SPDX-License-Identifier: Apache-2.0
"""The peak memory of trocar-mesh on 1,000 slices of 512 x 512 pixels is within 1.5 times that on 100: memory grows with
threads, not with slices. The slices are those of the sample scan, repeated. ctest runs `-k png` only, since `-k dicom` writes
half a gigabyte."""
import json
import shutil
import struct

import pytest
from programs import run


def pngs(scan, folder, count):
    files = sorted((scan / "png").glob("*.png"))
    for i in range(count):
        (folder / f"{i:04}.png").symlink_to(files[i % len(files)])


def dicoms(scan, folder, count):
    """Copies with different instance UIDs and positions, patched in place at the same length."""
    files = sorted((scan / "dicom").glob("*.dcm"))
    for i in range(count):
        data = bytearray(files[i % len(files)].read_bytes())
        for tag, edit in ((b"\x20\x00\x32\x00DS", lambda old: position(old, i)), (b"\x08\x00\x18\x00UI", lambda old: uid(old, i))):
            at = data.index(tag) + len(tag)
            size = struct.unpack_from("<H", data, at)[0]
            value = edit(bytes(data[at + 2:at + 2 + size]))
            assert len(value) == size, (value, size)
            data[at + 2:at + 2 + size] = value
        (folder / f"{i:04}.dcm").write_bytes(data)


def position(old, i):
    x, y, z = old.decode().rstrip(" ").split("\\")
    return "\\".join((x[:5], y[:5], str(i))).ljust(len(old)).encode()


def uid(old, i):
    head = old.rstrip(b"\0").decode()[:-5]
    return f"{head}1{i:04}".encode().ljust(len(old), b"\0")


@pytest.mark.parametrize("make, options", [(pngs, ("--spacing", "0.3125,0.3125,1", "--threshold", "95.2")), (dicoms, ())], ids=["png", "dicom"])
def test_memory_growth(programs, scan, work, make, options):
    for jobs in (1, 2):
        peaks = []
        for count in (100, 1000):
            folder = work / f"{make.__name__}_{count}"
            if not folder.exists():
                folder.mkdir(parents=True)
                make(scan, folder, count)
            report = work / "report.json"
            run(programs / "trocar-mesh", folder, "-o", work / "out.glb", "--quiet", "--jobs", jobs, "--report", report, *options)
            report = json.loads(report.read_text())
            assert len(report["slices"]) == count, f"{len(report['slices'])} of {count} slices"
            peaks.append(report["peak_rss_bytes"] / 1e6)
        ratio = peaks[1] / peaks[0]
        print(f"{jobs} thread(s): {peaks[0]:.1f} MB for 100 slices, {peaks[1]:.1f} MB for 1,000: {ratio:.2f}")
        assert ratio <= 1.5, f"{jobs} thread(s): {ratio:.2f} times the memory"
    for count in (100, 1000):
        shutil.rmtree(work / f"{make.__name__}_{count}")
