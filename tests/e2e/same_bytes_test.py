# SPDX-License-Identifier: Apache-2.0
"""The same scan gives the same asset, byte by byte, with 1, 2 and 16 threads and from
the programs of another build, if TROCAR_OTHER_BIN names its folder. Scans: the sample as PNG, DICOM and NIfTI; L3 (folder
TROCAR_REAL_CT) and the head CT (file TROCAR_HEAD_CT) if available. With clang, for example:

    cmake -S . -B build/other -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_COMPILER=clang++-14
    ninja -C build/other trocar-mesh
    TROCAR_OTHER_BIN=$PWD/build/other/bin ctest --test-dir build/release -R same_bytes -V"""
import hashlib
import os
import pathlib

from programs import HEAD_CT, L3_SCAN, REAL_CT, run


def scans(sample):
    grey = ("--spacing", "0.3125,0.3125,1", "--threshold", "95.2")
    yield "sample, PNG", sample / "png", grey
    yield "sample, PNG, paper", sample / "png", (*grey[:2], "--preset", "paper")
    yield "sample, DICOM", sample / "dicom", ()
    yield "sample, DICOM, Douglas-Peucker", sample / "dicom", ("--simplify", "dp")
    yield "sample, NIfTI", sample / "sample.nii.gz", ()
    yield "L3", L3_SCAN, ()
    yield "L3, labels", REAL_CT / "sub-ct_seg-vert_label-22_msk.nii.gz", ("--labels", "22")
    yield "head", HEAD_CT, ()
    yield "head, Douglas-Peucker", HEAD_CT, ("--simplify", "dp")


def test_same_bytes(programs, scan, work):
    other = os.environ.get("TROCAR_OTHER_BIN")
    makers = [(f"{jobs} threads", programs, jobs) for jobs in (1, 2, 16)]
    if other:
        makers.append((other, pathlib.Path(other), 2))
    for name, file, options in scans(scan):
        if not file.exists():
            print(f"{name}: not available")
            continue
        digests = {}
        for maker, folder, jobs in makers:
            asset = work / "asset.glb"
            run(folder / "trocar-mesh", file, "-o", asset, "--quiet", "--jobs", jobs, *options)
            digests.setdefault(hashlib.sha256(asset.read_bytes()).hexdigest(), []).append(maker)
        assert len(digests) == 1, f"{name}: different bytes: {digests}"
        print(f"{name}: {len(makers)} runs, {next(iter(digests))[:16]}")
    print("compared with the programs of", other or "no other build")
