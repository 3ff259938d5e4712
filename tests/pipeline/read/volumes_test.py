# SPDX-License-Identifier: Apache-2.0
"""Volumes and label maps as they come from other programs: label numbers up to 2^31 - 1, labels that are not quite whole, gzip files
that are not whole, two orientations in one NIfTI, NRRD, and TIFF label maps whose white is zero or that have transparency."""
import gzip
import itertools
import json
import re
import struct
import zlib

import nibabel
import numpy as np
import pytest
from programs import PROGRAMS, run

MESH = PROGRAMS / "trocar-mesh"
SIZE = (40, 32, 5)
AFFINE = np.diag([-1.25, -1.25, 2.0, 1.0])  # NIfTI's axes point to the right and to the front
MOST = 2**31 - 1


def two_blocks(first, second, kind, background=0):
    data = np.full(SIZE, background, kind)
    data[4:20, 4:28] = first
    data[20:36, 6:26] = second
    return data


def nifti(file, data, slope=None, affine=AFFINE, qform=None, codes=(2, 0)):
    """Values as they are stored; `codes` are those of sform and qform."""
    image = nibabel.Nifti1Image(data, affine, dtype=data.dtype)
    image.set_sform(affine, codes[0])
    image.set_qform(affine if qform is None else qform, codes[1])
    nibabel.save(image, file)
    if slope is not None:
        plain = file.name.endswith(".nii")
        raw = bytearray(file.read_bytes() if plain else gzip.decompress(file.read_bytes()))
        struct.pack_into("<2f", raw, 112, *slope)
        file.write_bytes(bytes(raw) if plain else gzip.compress(bytes(raw)))
    return file


def mesh(place, scan, *words, expect=0):
    """The report, the labels of the asset's materials, and what was said."""
    asset, report = place / "out.glb", place / "out.json"
    report.unlink(missing_ok=True)
    done = run(MESH, scan, "-o", asset, "--report", report, *words, expect=expect)
    if expect != 0:
        return None, None, done.stderr
    # The numbers as they are written, because a parser could round them.
    labels = [int(n) for n in re.findall(rb'"label":(\d+)', asset.read_bytes()[:4000])]
    return json.loads(report.read_bytes()), labels, done.stderr


def warning(report, code):
    return next((w for w in report["warnings"] if w["code"] == code), None)


KINDS = {"int32": np.int32, "uint32": np.uint32, "int64": np.int64, "uint64": np.uint64, "float64": np.float64, "float32": np.float32}
# A float32 holds only multiples of 64 here.
PAIRS = [(614454277, 614454280), (2**24, 2**24 + 1), (MOST - 1, MOST), (1, MOST)]


@pytest.mark.parametrize("kind", KINDS)
def test_label_numbers_are_exact(place, kind):
    pairs = PAIRS if kind != "float32" else [(614454272, 614454336), (1, 2**31 - 128)]
    for first, second in pairs:
        scan = nifti(place / "l.nii.gz", two_blocks(first, second, KINDS[kind]))
        report, labels, _ = mesh(place, scan, "--labels", "all")
        assert labels == [first, second] == report["parameters"]["labels"], f"{first} {second}: {labels}"
        assert report["labels"] == [{"label": n, "name": f"label {n}"} for n in (first, second)]
        assert len({s["area_mm2"] for s in report["slices"] if s["index"] == 2}) == 2, "both have the same area"
        report, labels, _ = mesh(place, scan, "--labels", str(second))
        assert report["parameters"]["labels"] == [second] and all(s["area_mm2"] < 600 for s in report["slices"])
    names = place / "names.json"
    names.write_text(json.dumps({str(first): "cortex", str(second): "marrow"}))
    report, _, _ = mesh(place, scan, "--labels", "all", "--names", names, "--axis", "coronal")
    assert report["labels"] == [{"label": first, "name": "cortex"}, {"label": second, "name": "marrow"}]
    run(MESH, "verify", "--private", place / "out.glb")
    page = place / "p.html"
    run(MESH, "preview", scan, "-o", page, "--labels", "all")
    assert f'"label":{second}'.encode() in page.read_bytes().replace(b" ", b""), "the preview's table"


def test_labels_beside_hu_and_as_mask(place):
    """--hu and --mask take the same numbers."""
    labels = nifti(place / "l.nii.gz", two_blocks(614454277, 614454280, np.int32))
    ct = nifti(place / "ct.nii.gz", two_blocks(500, 700, np.int16, -200))
    report, _, _ = mesh(place, labels, "--labels", "614454280", "--hu", ct)
    assert all(s["mean_hu"] == 700 for s in report["slices"])
    whole, _, _ = mesh(place, ct)
    report, _, _ = mesh(place, ct, "--mask", f"{labels}:614454280")
    assert 0 < report["solid"]["dropped_mm3"] < sum(s["area_mm2"] for s in whole["slices"]) * 2, "the mask keeps both"
    _, _, said = mesh(place, ct, "--mask", f"{labels}:614454272", expect=3)
    assert "holds none of the labels" in said


@pytest.mark.parametrize(("kind", "value", "text"), [
    (np.int64, 2**31, "2147483648"), (np.uint32, 2**32 - 1, "4294967295"), (np.uint64, 2**40, "1099511627776"), (np.int16, -1, "-1"),
    (np.int32, -614454277, "-614454277"), (np.float32, 3.25, "3.25"), (np.float64, 3.002, "3.002"), (np.float32, -0.5, "-0.5"),
    (np.float64, 2**31, "2147483648"), (np.float32, np.inf, "inf")])
def test_what_is_no_label_is_refused(place, kind, value, text):
    data = two_blocks(3, 9, kind)
    data[7, 5, 0] = value
    scan = nifti(place / "l.nii", data)
    _, _, said = mesh(place, scan, "--labels", "3", expect=3)
    assert f"l.nii slice 0: voxel 7, 5 is {text}, which is no label" in said and len(said.splitlines()) == 1, said
    ct = nifti(place / "ct.nii", two_blocks(500, 700, np.int16, -200))
    _, _, said = mesh(place, ct, "--mask", f"{scan}:3", expect=3)
    assert f"is {text}, which is no label" in said and said.strip().endswith("; --mask needs a label map"), said
    run(MESH, "preview", scan, "-o", place / "p.png", "--labels", "all", expect=3)


def test_nearly_whole_labels_are_rounded(place):
    data = two_blocks(3, 9, np.float32)
    true, _, _ = mesh(place, nifti(place / "true.nii", data), "--labels", "3,9")
    for off in (0.0000457, -0.0009, 0.000999):
        moved = data + np.float32(off) * (data == 3)
        report, labels, said = mesh(place, nifti(place / "moved.nii", moved), "--labels", "3,9")
        found = warning(report, "labels_rounded")
        assert labels == [3, 9] and [s["area_mm2"] for s in report["slices"]] == [s["area_mm2"] for s in true["slices"]]
        assert found["sentence"].startswith(f"{(data == 3).sum()} voxels are not whole numbers") and "labels_rounded" in said, found
    for off in (0.0011, -0.0011, 0.5):
        mesh(place, nifti(place / "moved.nii", data + np.float32(off) * (data == 3)), "--labels", "3,9", expect=3)
    assert warning(true, "labels_rounded") is None
    # The slope is a 32-bit float: 20000 x 0.00015 is not 3.
    scan = nifti(place / "slope.nii", two_blocks(20000, 60000, np.uint16), slope=(0.00015, 0))
    report, labels, _ = mesh(place, scan, "--labels", "all")
    assert labels == [3, 9] and warning(report, "labels_rounded"), labels
    scan = nifti(place / "slope.nii", two_blocks(1, 4, np.uint8), slope=(3, 614454272))
    _, labels, _ = mesh(place, scan, "--labels", "614454275,614454284")
    assert labels == [614454275, 614454284]
    # The mask's, too.
    ct, soft = nifti(place / "ct.nii", two_blocks(500, 700, np.int16, -200)), nifti(place / "moved.nii", data + np.float32(0.0005))
    report, _, _ = mesh(place, ct, "--mask", f"{soft}:3")
    assert str(data.size) in warning(report, "labels_rounded")["sentence"]


def test_huge_labels_without_labels_are_recognised(place):
    scan = nifti(place / "l.nii", two_blocks(614454277, 614454280, np.int32))
    report, _, _ = mesh(place, scan)
    assert "try --labels all" in warning(report, "looks_like_labels")["sentence"], "and no merged numbers"


def damaged(whole):
    """What the reader finds is gzip_reader_test's; here the program reads to the end."""
    yield "its trailer is missing", whole[:-8], 3
    yield "cut in the middle", whole[:len(whole) // 2], 3
    other = bytearray(whole)
    other[-8] ^= 1
    yield "checksum", bytes(other), 3
    yield "garbage behind it", whole + b"garbage", 3
    half = len(gzip.decompress(whole)) // 2
    members = [gzip.compress(part) for part in (gzip.decompress(whole)[:half], gzip.decompress(whole)[half:])]
    yield "two members", b"".join(members), 0


def test_gzip_is_verified_to_its_end(place):
    data = two_blocks(500, 700, np.int16, -200)
    whole = gzip.compress(nifti(place / "ct.nii", data).read_bytes())
    for name, raw, code in damaged(whole):
        (place / "ct.nii.gz").write_bytes(raw)
        for words in ((), ("--preset", "solid-bone")):  # read once, and at once
            _, _, said = mesh(place, place / "ct.nii.gz", *words, expect=code)
            assert code == 0 or ("ct.nii.gz: " in said and len(said.splitlines()) == 1), f"{name}: {said}"
    # One volume of several: the others are verified, too.
    four = nifti(place / "four.nii.gz", np.stack([data, data, data], 3))
    whole = four.read_bytes()
    mesh(place, four, "--volume", "0")
    four.write_bytes(whole[:-8])
    _, _, said = mesh(place, four, "--volume", "0", expect=3)
    assert "truncated" in said
    labels = gzip.compress(nifti(place / "l.nii", two_blocks(3, 9, np.uint8)).read_bytes())
    (place / "l.nii.gz").write_bytes(labels[:-8])
    _, _, said = mesh(place, place / "ct.nii", "--mask", f"{place / 'l.nii.gz'}:3", expect=3)
    assert "l.nii.gz: truncated" in said


def turned(axis, degrees, around=(0, 0, 0)):
    a, c = np.radians(degrees), np.array(around, float)
    u = np.array(axis, float) / np.linalg.norm(axis)
    k = np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
    out = np.eye(4)
    out[:3, :3] = np.eye(3) + np.sin(a) * k + (1 - np.cos(a)) * k @ k
    out[:3, 3] = c - out[:3, :3] @ c
    return out


def shifted(x, y, z):
    out = np.eye(4)
    out[:3, 3] = x, y, z
    return out


CENTRE = (AFFINE @ [(SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2, (SIZE[2] - 1) / 2, 1])[:3]


@pytest.mark.parametrize(("name", "change", "texts"), [
    ("left_right", np.diag([-1.0, 1, 1, 1]), ("mirrored from left to right",)),
    ("front_back", np.diag([1.0, -1, 1, 1]), ("mirrored from front to back",)),
    ("head_feet", np.diag([1.0, 1, -1, 1]), ("mirrored from head to feet",)),
    ("all", np.diag([-1.0, -1, -1, 1]), ("mirrored", "rotated by 180 degrees")),
    ("half_turn", turned((0, 0, 1), 180, CENTRE), ("rotated by 180 degrees",)),
    ("thirty", turned((1, 2, 3), 30, CENTRE), ("rotated by 30 degrees",)),
    ("five", turned((0, 1, 0), 5, CENTRE), ("rotated by 5 degrees",)),
    ("shift", shifted(0, 7, 0), ("shifted by 7 mm", "moves by up to 7 mm")),
    ("scale", np.diag([1.1, 1.1, 1, 1]), ("1.375 x 1.375 x 2 mm instead of 1.25 x 1.25 x 2 mm",)),
    ("little", shifted(0.6, 0.6, 0.9), None), ("same", np.eye(4), None)])
def test_qform_and_sform(place, name, change, texts):
    data = two_blocks(500, 700, np.int16, -200)
    plain, _, _ = mesh(place, nifti(place / "plain.nii", data))
    scan = nifti(place / f"{name}.nii", data, qform=change @ AFFINE, codes=(1, 1))
    report, _, said = mesh(place, scan)
    found = warning(report, "qform_differs")
    assert [s["area_mm2"] for s in report["slices"]] == [s["area_mm2"] for s in plain["slices"]], "the sform is used"
    assert (found is None) == (texts is None), f"{found}"
    if texts:
        assert all(text in found["sentence"] for text in texts) and found["where"].endswith(scan.name), found
        assert "qform_differs" in said
        assert ("mirrored" in found["sentence"]) == ("mirrored" in texts[0]), found
    # Without a code, a qform is not stated.
    report, _, _ = mesh(place, nifti(place / "one.nii", data, qform=change @ AFFINE, codes=(1, 0)))
    assert warning(report, "qform_differs") is None


# NRRD


def nrrd(file, data, fields, endian="<", packed=False, detached=None, version=4):
    """`data` with the fastest axis first; the fields are lines of the header besides those that follow from it."""
    kinds = {np.dtype(k): n for k, n in ((np.int8, "signed char"), (np.uint8, "uchar"), (np.int16, "short"), (np.uint16, "ushort"), (np.int32, "int"),
                                         (np.uint32, "unsigned int"), (np.int64, "longlong"), (np.uint64, "uint64_t"), (np.float32, "float"), (np.float64, "double"))}
    raw = data.astype(data.dtype.newbyteorder(endian)).tobytes(order="F")
    lines = [f"NRRD000{version}", "# a comment", f"type: {kinds[data.dtype]}", f"dimension: {data.ndim}", "sizes: " + " ".join(map(str, data.shape)),
             f"encoding: {'gzip' if packed else 'raw'}", f"endian: {'little' if endian == '<' else 'big'}", *fields]
    raw = gzip.compress(raw) if packed else raw
    if detached:
        (file.parent / detached).write_bytes(raw)
        file.write_text("\n".join([*lines, f"data file: {detached}"]) + "\n")
    else:
        file.write_bytes("\n".join([*lines, "", ""]).encode() + raw)
    return file


ORIGIN = AFFINE[:3, 3]
LPS = ["space: left-posterior-superior", "space directions: (1.25,0,0) (0,1.25,0) (0,0,2)", "space origin: (0,0,0)", "kinds: domain domain domain"]


def placed(report):
    return [{k: v for k, v in s.items() if k not in ("ms", "index")} for s in report["slices"]]


@pytest.mark.parametrize("kind", [np.int16, np.uint16, np.int32, np.uint32, np.int64, np.uint64, np.float32, np.float64, np.uint8, np.int8])
def test_nrrd_gives_what_the_equal_nifti_gives(place, kind):
    small = kind in (np.uint8, np.int8)
    data = two_blocks(100 if small else 500, 120 if small else 700, kind)
    words = ("--threshold", "90" if small else "226")
    want, _, _ = mesh(place, nifti(place / "ct.nii", data), *words)
    asset = (place / "out.glb").read_bytes()
    for endian, packed, detached in itertools.product("<>", (False, True), (None, "ct.raw")):
        scan = nrrd(place / ("ct.nhdr" if detached else "ct.nrrd"), data, LPS, endian, packed, detached)
        report, _, said = mesh(place, scan, *words)
        assert placed(report) == placed(want) and [w["code"] for w in report["warnings"]] == [w["code"] for w in want["warnings"]], f"{endian} {packed} {detached}: {said}"
        assert (place / "out.glb").read_bytes() == asset, f"{endian} {packed} {detached}"


def test_nrrd_orientation(place):
    """The same patient in other spaces, and with axes in another order."""
    data = two_blocks(500, 700, np.int16, -200)
    data[30:, 20:, 2] = 900  # no symmetry
    mesh(place, nrrd(place / "lps.nrrd", data, LPS))
    asset = (place / "out.glb").read_bytes()
    for name, array, fields in (
            ("ras", data, ["space: right-anterior-superior", "space directions: (-1.25,0,0) (0,-1.25,0) (0,0,2)", "space origin: (0,0,0)"]),
            ("las", data, ["space: LAS", "space directions: (1.25,0,0) (0,-1.25,0) (0,0,2)", "space origin: (-0,0,0)"]),
            ("blanks", data, ["space: LPS", "space directions:  ( 1.25 , 0,0 ) (0,+1.25,0)   (0,0,2e0)", "space origin: (0, 0, 0)"]),
            ("permuted", data.transpose(2, 0, 1), ["space: LPS", "space directions: (0,0,2) (1.25,0,0) (0,1.25,0)", "space origin: (0,0,0)"]),
            ("flipped", data[::-1], ["space: LPS", "space directions: (-1.25,0,0) (0,1.25,0) (0,0,2)", f"space origin: ({1.25 * (SIZE[0] - 1)},0,0)"]),
            ("size_1", data[None], ["space: LPS", "space directions: none (1.25,0,0) (0,1.25,0) (0,0,2)", "kinds: vector domain domain domain"])):
        report, _, said = mesh(place, nrrd(place / f"{name}.nrrd", array, fields))
        assert (place / "out.glb").read_bytes() == asset and said == "", f"{name}: {said}"
        report = json.loads(run(MESH, "list", place / f"{name}.nrrd", "--json").stdout)["scans"]
        assert [(s["kind"], s["slices"], s["spacing_mm"], s["usable"]) for s in report] == [("nrrd", 5, [1.25, 1.25, 2.0], True)], name
    report, _, _ = mesh(place, nrrd(place / "spacings.nrrd", data, ["spacings: 1.25 1.25 2"]))
    assert warning(report, "no_orientation") and (place / "out.glb").read_bytes() == asset
    _, _, said = mesh(place, nrrd(place / "none.nrrd", data, ["spacings: nan nan NaN"]), expect=2)
    assert "carries no voxel size" in said
    given, _, _ = mesh(place, place / "none.nrrd", "--spacing", "1.25,1.25,2")
    assert placed(given) == placed(report)
    # Volumes, and voxels of several values.
    four = nrrd(place / "four.nrrd", np.stack([data, data // 2], 3), ["space: LPS", "space directions: (1.25,0,0) (0,1.25,0) (0,0,2) none", "kinds: domain domain domain list"])
    assert "--volume" in mesh(place, four, expect=2)[2]
    mesh(place, four, "--volume", "0")
    vector = nrrd(place / "vector.nrrd", np.stack([data, data]), ["space: LPS", "space directions: none (1.25,0,0) (0,1.25,0) (0,0,2)"])
    assert "2 values each" in mesh(place, vector, expect=3)[2]
    assert "right angles" in mesh(place, nrrd(place / "shear.nrrd", data, ["space: LPS", "space directions: (1.25,0,0) (0.2,1.25,0) (0,0,2)"]), expect=3)[2]


def test_nrrd_in_every_place_of_a_nifti(place):
    folder = place / "in"
    folder.mkdir()
    data = two_blocks(500, 700, np.int16, -200)
    ct = nrrd(folder / "ct.nhdr", data, LPS, packed=True, detached="ct.raw.gz")
    labels = nrrd(place / "l.nrrd", two_blocks(614454277, 614454280, np.uint32),
                  [*LPS, "Segment0_Name:=cortex", "Segment0_LabelValue:=614454277", "Segment1_Name:=mar\x1brow", "Segment1_LabelValue:=614454280"], packed=True)
    report, numbers, _ = mesh(place, labels, "--labels", "all", "--hu", ct)
    assert numbers == [614454277, 614454280] and {s["mean_hu"] for s in report["slices"]} == {500.0, 700.0}
    assert report["labels"][0] == {"label": 614454277, "name": "cortex"} and "\x1b" not in report["labels"][1]["name"]
    report, _, _ = mesh(place, ct, "--mask", f"{labels}:614454280")
    assert report["solid"]["dropped_mm3"] > 0
    mesh(place, folder)  # a folder with the header and its data
    run(MESH, "preview", ct, "-o", place / "p.html")
    assert b'"NRRD"' in (place / "p.html").read_bytes().replace(b" ", b"")
    assert "nrrd" in run(MESH, "list", folder).stdout
    # A batch makes the scan again if the data change, although the header stays.
    collection, store = place / "c.json", place / "store"
    collection.write_text(json.dumps({"schema": "trocar.collection/1", "scans": [{"name": "a", "input": str(ct)}]}))
    assert "1 made" in run(MESH, "batch", collection, "-o", store).stdout
    assert "1 unchanged" in run(MESH, "batch", collection, "-o", store).stdout
    nrrd(ct, data + 10, LPS, packed=True, detached="ct.raw.gz")
    assert "1 made" in run(MESH, "batch", collection, "-o", store).stdout


def header(**changes):
    fields = {"type": "short", "dimension": "3", "sizes": "4 4 2", "encoding": "raw", "endian": "little", "space": "LPS",
              "space directions": "(1,0,0) (0,1,0) (0,0,1)", "space origin": "(0,0,0)"}
    fields.update({k.replace("_", " "): v for k, v in changes.items()})
    return "NRRD0004\n" + "".join(f"{k}: {v}\n" for k, v in fields.items() if v is not None) + "\n"


@pytest.mark.parametrize(("changes", "text"), [
    ({"sizes": "99999999999999999999 4 2"}, "sizes"), ({"sizes": "-4 4 2"}, "sizes"), ({"sizes": "4 4"}, "sizes"), ({"sizes": "4 4 2 2"}, "sizes"), ({"sizes": "0 4 2"}, "sizes"),
    ({"sizes": "32769 4 2"}, "sizes"), ({"sizes": "32768 32768 32768"}, "slices of 32768 x 32768"), ({"sizes": "4 4 2x"}, "sizes"), ({"sizes": "1e1 4 2"}, "sizes"), ({"sizes": None}, "sizes"),
    ({"dimension": "-1"}, "dimension"), ({"dimension": "1000000"}, "dimension"), ({"dimension": None}, "dimension"), ({"type": "block"}, "type"), ({"type": None}, "type"),
    ({"encoding": "bzip2"}, "bzip2"), ({"encoding": "ascii"}, "ascii"), ({"encoding": None}, "encoding"), ({"endian": None}, "endian"), ({"endian": "middle"}, "endian"),
    ({"space": "scanner-xyz"}, "scanner-xyz"), ({"space_directions": "(1,0,0) (0,1,0)"}, "space directions"), ({"space_directions": "(1,0,0) (0,1,0) (0,0,inf)"}, "space directions"),
    ({"space_directions": "(1,0,0) (0,1,0) (0,0,1"}, "space directions"), ({"space_directions": "(1,0) (0,1,0) (0,0,1)"}, "space directions"),
    ({"space_directions": "(1,0,0) (0,1,0) (1,0,0)"}, "no volume"), ({"space_directions": "(0,0,0) (0,1,0) (0,0,1)"}, "voxel size of zero"),
    ({"space_directions": "none (0,1,0) (0,0,1)"}, "values each"), ({"space_origin": "(1e300,0,0)"}, "space origin"), ({"space_origin": "1 2 3"}, "space origin"),
    ({"space_units": '"m" "m" "m"'}, "space units"), ({"kinds": "domain domain"}, "kinds"), ({"byte_skip": "-2"}, "byte skip"), ({"byte_skip": "9999999999999"}, "byte skip"),
    ({"line_skip": "1"}, "line skip"), ({"data_file": "../secret.raw"}, "in its own folder"), ({"data_file": "/etc/passwd"}, "in its own folder"), ({"data_file": "LIST"}, "several files"),
    ({"data_file": "nowhere.raw"}, "nowhere.raw"), ({"data_file": "."}, "in its own folder"), ({"old_min": "0"}, "quantised"), ({}, "truncated")])
def test_hostile_nrrd_headers_are_refused(place, changes, text):
    file = place / "bad.nrrd"
    file.write_bytes(header(**changes).encode() + bytes(63))  # a byte less than 4 x 4 x 2 x 2
    said = mesh(place, file, expect=3)[2].replace(str(place), "")
    assert text in said and "bad.nrrd" in said and len(said.splitlines()) == 1, said


def test_other_damage_of_nrrd(place):
    file, good = place / "bad.nrrd", header().encode()
    for raw in (b"", b"NRRD", b"NRRD0009\n" + good[9:] + bytes(64), good[:-1], b"NRRD0004\n" + b"a" * 5000, b"NRRD0004\n" + b"# " + b"a" * (2 << 20) + b"\n" + good[9:] + bytes(64),
                good.replace(b"type: short\n", b"type: short\ntype: short\n") + bytes(64), good.replace(b"type: short", b"type short") + bytes(64),
                zlib.compress(good), gzip.compress(good + bytes(64))):
        file.write_bytes(raw)
        said = mesh(place, file, expect=3)[2]
        assert "bad.nrrd" in said and len(said.splitlines()) == 1, said
    packed = gzip.compress(np.full(32, 500, np.int16).tobytes())
    for name, raw, code in (("whole", packed, 0), ("no trailer", packed[:-8], 3), ("cut", packed[:-12], 3), ("garbage", packed + b"x", 3), ("not packed", bytes(64), 3)):
        file.write_bytes(header(encoding="gzip").encode() + raw)
        said = mesh(place, file, "--min-region", "0", expect=code)[2]
        assert code == 0 or "bad.nrrd" in said, f"{name}: {said}"
    # The data are the last bytes of the file; CR and LF.
    file.write_bytes(header(byte_skip="-1").replace("\n", "\r\n").encode() + b"junk" + np.full(32, 500, np.int16).tobytes())
    mesh(place, file, "--min-region", "0")


# TIFF


def tiff(file, pixels, photometric, extra=None, bits=8):
    """An uncompressed TIFF of one strip; pixels[y][x] or pixels[y][x][channel]."""
    pixels = np.asarray(pixels, "<u2" if bits == 16 else np.uint8)
    height, width = pixels.shape[:2]
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    raw = np.packbits(pixels, axis=1).tobytes() if bits == 1 else pixels.tobytes()
    tags = [(256, 3, [width]), (257, 3, [height]), (258, 3, [bits] * channels), (259, 3, [1]), (262, 3, [photometric]), (273, 4, [8]),
            (277, 3, [channels]), (278, 3, [height]), (279, 4, [len(raw)])]
    if extra is not None:
        tags.append((338, 3, [extra]))
    at, more, entries = 8 + len(raw) + len(raw) % 2, b"", b""
    end = at + 2 + 12 * len(tags) + 4
    for tag, kind, values in tags:
        packed = struct.pack(f"<{len(values)}{'H' if kind == 3 else 'I'}", *values)
        if len(packed) > 4:
            packed, more = struct.pack("<I", end + len(more)), more + packed
        entries += struct.pack("<HHI", tag, kind, len(values)) + packed.ljust(4, b"\0")
    file.write_bytes(b"II*\0" + struct.pack("<I", at) + raw.ljust(at - 8, b"\0") + struct.pack("<H", len(tags)) + entries + bytes(4) + more)
    return file


BLACK_IS_ZERO, WHITE_IS_ZERO, RGB = 1, 0, 2
ASSOCIATED, UNASSOCIATED = 1, 2


def labels_of(place, file, expect=0):
    report, labels, said = mesh(place, file, "--spacing", "1,1,1", "--labels", "all", "--min-region", "0", expect=expect)
    return labels if expect == 0 else said


def with_alpha(grey, channels, alpha):
    return np.stack([grey] * (channels - 1) + [alpha], 2)


def test_labels_of_tiffs(place):
    file, grey = place / "l.tif", np.zeros((20, 30), int)
    grey[2:8, 2:8], grey[2:8, 12:18], grey[10:18, 5:25] = 3, 7, 9
    for photometric in (BLACK_IS_ZERO, WHITE_IS_ZERO):
        assert labels_of(place, tiff(file, grey, photometric)) == [3, 7, 9]
        assert labels_of(place, tiff(file, grey * 1000, photometric, bits=16)) == [3000, 7000, 9000]
    assert run(MESH, tiff(file, grey > 0, WHITE_IS_ZERO, bits=1), "--spacing", "1,1,1", "--labels", "1", "-o", place / "o.glb")
    half, full = np.full(grey.shape, 128), np.full(grey.shape, 255)
    for channels, photometric in ((2, BLACK_IS_ZERO), (2, WHITE_IS_ZERO), (4, RGB)):
        assert labels_of(place, tiff(file, with_alpha(grey, channels, half), photometric, UNASSOCIATED)) == [3, 7, 9]
        assert labels_of(place, tiff(file, with_alpha(grey, channels, full), photometric, ASSOCIATED)) == [3, 7, 9]
        for extra in (ASSOCIATED, 0):
            assert "transparency" in labels_of(place, tiff(file, with_alpha(grey, channels, half), photometric, extra), expect=3)
    assert labels_of(place, tiff(file, np.stack([grey] * 3, 2), RGB)) == [3, 7, 9]
    assert "colours" in labels_of(place, tiff(file, np.stack([grey, grey, grey // 2], 2), RGB), expect=3)


def test_grey_levels_of_tiffs(place):
    """White is zero turns pictures round, in 16 bits as in 8, and transparency does not darken them."""
    file, grey = place / "g.tif", np.zeros((20, 30), int)
    grey[4:16, 4:16], grey[4:16, 16:26] = 200, 90

    def areas(scan):
        return [mesh(place, scan, "--spacing", "1,1,1", "--threshold", t)[0]["slices"][0]["area_mm2"] for t in ("150", "50")]

    want, half = areas(tiff(file, grey, BLACK_IS_ZERO)), np.full(grey.shape, 128)
    assert want[1] > 1.5 * want[0] > 0
    assert areas(tiff(file, 255 - grey, WHITE_IS_ZERO)) == want
    assert areas(tiff(file, 65535 - grey * 257, WHITE_IS_ZERO, bits=16)) == want
    assert areas(tiff(file, with_alpha(grey, 2, half), BLACK_IS_ZERO, UNASSOCIATED)) == want
    assert areas(tiff(file, with_alpha(255 - grey, 2, half), WHITE_IS_ZERO, UNASSOCIATED)) == want
    assert areas(tiff(file, with_alpha(grey, 4, half), RGB, UNASSOCIATED)) == want
    assert areas(tiff(file, with_alpha(grey * 257, 4, half), RGB, UNASSOCIATED, bits=16)) == want


def png(file, pixels, colour_type, bits, chunks=()):
    """A PNG of samples as given; `chunks` stand before the pixels."""
    pixels = np.asarray(pixels, ">u2" if bits == 16 else np.uint8)
    height, width = pixels.shape[:2]
    rows = np.packbits(np.unpackbits(pixels[..., None], axis=2)[..., 8 - bits:].reshape(height, -1), axis=1) if bits < 8 else pixels.reshape(height, -1)
    raw = b"".join(b"\0" + np.ascontiguousarray(row).tobytes() for row in rows)

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    file.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">2I5B", width, height, bits, colour_type, 0, 0, 0)) +
                     b"".join(chunk(n, d) for n, d in chunks) + chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b""))
    return file


def test_labels_of_pngs(place):
    """Transparency of any kind, palettes and 16 bits leave the stored numbers."""
    file, grey = place / "l.png", np.zeros((20, 30), int)
    grey[2:8, 2:8], grey[2:8, 12:18], grey[10:18, 5:25] = 3, 7, 9
    half = np.full(grey.shape, 128)
    palette, clear = (b"PLTE", bytes(range(48))), (b"tRNS", bytes([128] * 16))
    for name, made in (
            ("grey", (grey, 0, 8)), ("4 bits", (grey, 0, 4)), ("grey, clear 3", (grey, 0, 8, [(b"tRNS", struct.pack(">H", 3))])),
            ("4 bits, clear 3", (grey, 0, 4, [(b"tRNS", struct.pack(">H", 3))])), ("16 bits, clear 3", (grey, 0, 16, [(b"tRNS", struct.pack(">H", 3))])),
            ("16 bits", (grey, 0, 16)), ("palette", (grey, 3, 8, [palette])), ("palette of 4 bits", (grey, 3, 4, [palette, clear])), ("clear palette", (grey, 3, 8, [palette, clear])),
            ("grey and alpha", (with_alpha(grey, 2, half), 4, 8)), ("16 bits and alpha", (with_alpha(grey, 2, half), 4, 16)),
            ("RGB, clear 3", (np.stack([grey] * 3, 2), 2, 8, [(b"tRNS", struct.pack(">3H", 3, 3, 3))])),
            ("RGBA", (with_alpha(grey, 4, half), 6, 8)), ("16 bits RGBA", (with_alpha(grey, 4, half), 6, 16)), ("gamma", (grey, 0, 8, [(b"gAMA", struct.pack(">I", 100000))]))):
        assert labels_of(place, png(file, *made)) == [3, 7, 9], name
    whole = png(file, grey, 0, 8).read_bytes()
    for cut in (*range(1, 30), len(whole) - 60):
        file.write_bytes(whole[:-cut])
        labels_of(place, file, expect=3)


# What reaches the terminal


EVIL = {"escape": "a\x1b[2Jb", "newline": "a\nb", "return": "a\rb", "override": "a\u202etxt.b", "isolate": "a\u2066b", "bell": "a\x07b", "c1": "a\x9bb",
        "joiner": "a\u200db", "tag": "a\U000e0041b", "broken": "a\udcffb"}


@pytest.mark.parametrize("kind", EVIL)
def test_names_are_escaped_on_the_terminal(place, kind):
    name = EVIL[kind]
    data = two_blocks(500, 700, np.int16, -200)
    good = nifti(place / "ct.nii", data)
    evil = place / f"{name}.nii"
    evil.write_bytes(good.read_bytes())
    folder = place / f"d{name}"
    folder.mkdir()
    (folder / f"{name}.nii").write_bytes(good.read_bytes())
    (folder / f"{name}.png").write_bytes(b"x")
    twisted = nifti(place / f"q{name}.nii", data, qform=np.diag([-1.0, 1, 1, 1]) @ AFFINE, codes=(1, 1))
    out = place / f"o{name}.glb"
    collection = place / f"c{name}.json"
    collection.write_bytes(b'{"schema": "trocar.collection/1", "scans": [{"name": "a", "input": "gone\\u202e\\u001b.nii"}]}')
    scene = place / f"s{name}.json"
    scene.write_text('{"asset": "\\u202egone\\u001b.glb"}')
    commands = [("trocar-mesh", evil, "-o", out), ("trocar-mesh", "list", folder), ("trocar-mesh", "list", folder, "--json"), ("trocar-mesh", folder, "-o", out),
                ("trocar-mesh", twisted, "-o", out), ("trocar-mesh", "verify", out), ("trocar-mesh", "verify", "--json", out), ("trocar-mesh", "info", out),
                ("trocar-mesh", "preview", evil, "-o", place / f"p{name}.png"), ("trocar-mesh", f"n{name}", "-o", out), ("trocar-mesh", evil, "-o", out, f"--{name}"),
                ("trocar-mesh", "verify", evil), ("trocar-mesh", "batch", collection, "-o", place / f"st{name}"), ("trocar-mesh", "export", out, "-o", place / f"x{name}"),
                ("trocar-run", scene), ("trocar-run", f"n{name}.json"), ("trocar-run", scene, "--device", f"udp:{name}"), ("trocar-run", "check", scene),
                ("trocar-console", f"no{name}"), ("trocar-console", f"--{name}")]
    for program, *words in commands:
        done = run_raw(PROGRAMS / program, *words)
        for said in (done.stdout, done.stderr):
            text = said.decode()  # which is UTF-8
            odd = [c for c in text if c != "\n" and not c.isprintable()]
            assert not odd, f"{program} {words}: {odd} in {text!r}"
            if kind == "newline":
                assert not re.search(r"^b", text, re.MULTILINE), f"{program} {words}: a line of its own in {text!r}"


def run_raw(*command):
    import os
    import subprocess
    return subprocess.run([os.fsencode(str(word)) for word in command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, check=False, timeout=60)
