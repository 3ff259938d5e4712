# SPDX-License-Identifier: Apache-2.0
"""Trocar-mesh as a user calls it: options in any order, no file of the user
overwritten, names of any bytes, parameters stored in the asset."""
import gzip
import json
import os
import shutil
import struct

import numpy as np
from exported import nifti
from programs import SANITIZED, run


def refuses(code, text, *command, **keys):
    """Expects this exit code, and one line on stderr that contains `text`."""
    said = run(*command, expect=code, **keys).stderr
    assert len(said.splitlines()) == 1 and text in said, f"{' '.join(map(str, command))}: {said!r} lacks {text!r}"


def warned(mesh, report, *words):
    """Runs the program; returns its warnings by code."""
    run(mesh, *words, "--quiet", "--report", report)
    return {w["code"]: w["where"] + ": " + w["sentence"] for w in json.loads(report.read_bytes())["warnings"]}


def label_map(scan, file, values):
    """Writes a label map of 20 x 20 pixels; slice k holds a square of each label in `values[k]`, side by side."""
    header = bytearray(gzip.decompress((scan / "sample.nii.gz").read_bytes())[:352])
    struct.pack_into("<4h", header, 40, 3, 20, 20, len(values))
    struct.pack_into("<2h", header, 70, 4, 16)  # int16
    struct.pack_into("<3f", header, 108, 352, 1, 0)  # first voxel, slope, intercept
    struct.pack_into("<3f", header, 80, 1, 1, 1)
    struct.pack_into("<2h", header, 252, 0, 1)
    struct.pack_into("<12f", header, 280, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0)  # sform
    voxels = [0] * (400 * len(values))
    for k, labels in enumerate(values):
        for i, label in enumerate(labels):
            for y in range(5, 15):
                for x in range(1 + 4 * i, 4 + 4 * i):
                    voxels[400 * k + 20 * y + x] = label
    file.write_bytes(bytes(header) + struct.pack(f"<{len(voxels)}h", *voxels))
    return file


def test_refuses_an_empty_asset(programs, scan, work):
    """No material in any slice: refused with the values and labels found, and what to try; nothing is written."""
    mesh, volume, out, report = programs / "trocar-mesh", scan / "sample.nii.gz", work / "empty.glb", work / "empty.json"
    whole = ("-o", out, "--report", report)
    low, high = -1024, 863  # HU of the sample
    found = f"the values found are {low} to {high} HU"
    labelled = label_map(scan, work / "labels.nii", ((), (20, 21), (22, 23), (24,), ()))
    nothing = label_map(scan, work / "nothing.nii", ((), ()))
    for words, texts in (
            ((volume, "--threshold", "30000"),
             ("sample.nii.gz, slices 0-34: nothing is at or above the threshold of 30000", found, "try --threshold 226")),
            ((labelled,), ("the threshold of 226", "the values found are 0 to 24, ", "labels 20-24", "try --labels 20-24 ")),
            ((labelled, "--labels", "99"), ("the label 99 is not there", "0 to 24", "labels 20-24", "try --labels 20-24 ")),
            ((labelled, "--labels", "20,24", "--slices", "2:2"), ("slice 2: ", "labels 20, 24 are not there", "labels 22-23")),
            ((labelled, "--labels", "20", "--crop", "0:19,0:3"), ("no label", "a larger --crop")),
            ((nothing, "--labels", "1"), ("slices 0-1: ", "the values found are all 0")),
            ((nothing, "--labels", "all"), ("there is no label",)),
            ((labelled, "--labels", "21,24", "--largest", "1", "--slices", "3:3"),
             ("left out by the option that keeps a part", "try it without this option, or other --slices")),
            ((labelled, "--labels", "22", "--min-region", "1000"), ("smaller than --min-region 1000 mm^2", "try a smaller --min-region")),
            ((scan / "png", "--spacing", "0.3125,0.3125,1", "--threshold", "32000"), ("the values found are 0 to 223 (grey levels)", "try a --threshold from 0 to 223")),
    ):
        said = run(mesh, *words, *whole, expect=3).stderr
        assert len(said.splitlines()) == 1 and all(text in said for text in texts), f"{words}: {said!r} lacks one of {texts}"
        assert not out.exists() and not report.exists(), f"{words}: something was written"
    # Slices without material beside others are fine.
    said = run(mesh, labelled, *whole, "--labels", "22").stderr
    assert "empty_slice" in said and out.exists() and report.exists(), f"some empty slices: {said!r}"


def verifies_several(mesh, good, broken):
    """Every file is looked at, whichever is invalid; CGAL confirms the good one."""
    said = run(mesh, "verify", "--independent", good, good)
    assert said.stdout.count(", confirmed by CGAL") == 2, f"verify --independent: {said.stdout}"
    said = run(mesh, "verify", broken, good, expect=3)
    assert "broken.glb" in said.stderr and "valid" in said.stdout, f"verify of two: {said.stdout} {said.stderr}"
    found = json.loads(run(mesh, "verify", good, broken, "--json", "--independent", expect=3).stdout)
    assert [f["valid"] for f in found] == [True, False] and "reason" in found[1], f"verify --json: {found}"
    assert [f["independent"] for f in found] == [True, False], f"verify --json --independent: {found}"


def test_presets_are_their_options(programs, scan, work):
    """What --explain prints of a preset gives the same asset; an option beside a preset replaces the preset's; wrong uses."""
    mesh, volume = programs / "trocar-mesh", scan / "sample.nii.gz"
    shown = run(mesh, "--explain").stdout.splitlines()
    presets = {line.split(":")[0]: line.split(":")[1].split() for line in shown if not line.startswith(" ")}
    assert set(presets) == {"bone", "solid-bone", "vertebra", "column", "skin", "paper"}, f"presets: {sorted(presets)}"
    made = {}
    for name, options in presets.items():
        one, other = work / f"{name}.glb", work / f"{name}_options.glb"
        run(mesh, volume, "-o", one, "--quiet", "--preset", name, "--slices", "14:20")
        run(mesh, volume, "-o", other, "--quiet", *options, "--slices", "14:20")
        made[name] = one.read_bytes()
        assert made[name] == other.read_bytes(), f"--preset {name} is not {' '.join(options)}"
    assert len(set(made.values())) == len(made), "two presets give the same asset"
    run(mesh, volume, "-o", work / "other.glb", "--quiet", "--preset=vertebra", "--threshold", "300", "--slices", "14:20")
    parameters = json.loads(run(mesh, "info", work / "other.glb", "--json").stdout)["parameters"]
    assert (parameters["threshold"] == 300 and parameters["close_mm"] == 3 and parameters["fill_mm2"] == 2500
          and parameters["min_volume_mm3"] == 100), f"parameters: {parameters}"
    out = ("-o", work / "never.glb")
    label_map(scan, work / "small.nii.gz", [[1]])
    refuses(3, "needs a label map on the scan's grid", mesh, volume, *out, "--mask", f"{work / 'small.nii.gz'}:1")
    aside = bytearray(gzip.decompress(volume.read_bytes()))
    struct.pack_into("<f", aside, 292, struct.unpack_from("<f", aside, 292)[0] + 0.01)  # the origin's x, mm
    (work / "aside.nii").write_bytes(aside)
    refuses(3, "its origin is (", mesh, volume, *out, "--mask", f"{work / 'aside.nii'}:1")


def test_warns(programs, scan, work):
    mesh, out, report = programs / "trocar-mesh", ("-o", work / "warned.glb"), work / "warned.json"
    picture, grey = scan / "png" / "slice_015.png", ("--spacing", "0.3125,0.3125,1")
    said = warned(mesh, report, picture, *out, *grey, "--threshold", "-5")
    assert "0..255" in said.get("threshold_out_of_range", ""), f"a threshold of another scale: {said}"
    said = warned(mesh, report, picture, *out, *grey, "--threshold", "0")
    assert set(said) == {"all_material"}, f"unexpected warnings: {said}"


def test_limits_its_memory(programs, scan, work):
    """An area bound that needs more vertices than a slice can have ends early, with a warning."""
    if SANITIZED:
        return  # sanitizers take far more memory
    said = warned("prlimit", work / "fine.json", "--as=3000000000", programs / "trocar-mesh", scan / "sample.nii.gz",
                  "-o", work / "fine.glb", "--slices", "3:3", "--jobs", "1", "--max-area", "1e-6")
    assert "slice 3: " in said.get("area_not_reached", ""), f"an area too small: {said}"
    made = json.loads((work / "fine.json").read_bytes())["slices"][0]
    assert made["max_area_mm2"] < 2e-6 * made["area_mm2"], f"not refined as far as possible: {made}"
    refuses(3, "sample.nii.gz slice 3: not enough memory", "prlimit", "--as=300000000", programs / "trocar-mesh",
            scan / "sample.nii.gz", "-o", work / "none.glb", "--slices", "3:3", "--jobs", "1", "--max-area", "0.001")


def test_material_at_the_border(programs, work):
    """Where material reaches the image's border, a wide tolerance lets its outline leave the image."""
    border = nifti(work / "border.nii", np.random.default_rng(2).choice((0, 1500), (3, 96, 96)), (0.3, 0.3, 1))
    for tolerance in ("0", "0.2", "1", "3", "1000"):
        run(programs / "trocar-mesh", border, "--tolerance", tolerance, "--quiet", "-o", work / "border.glb")


def test_outputs_complete_or_none(programs, scan, work):
    """A file beyond `ulimit -f` is an error. (Scans of trocar-sample-ct, signals: sample_writers_test, program_test.)"""
    mesh = programs / "trocar-mesh"
    # If a later file fails, the message names the asset, which is written.
    asset, stages = work / "written.glb", work / "stages.json"
    outputs = (scan / "dicom", "-o", asset, "--dump-stages", stages, "--dump-slice", "4", "--slices", "3:5", "--quiet")
    run(mesh, *outputs)
    limit, made = 2 * asset.stat().st_size, asset.read_bytes()
    assert limit < stages.stat().st_size, "the stages are too small for this test"
    asset.unlink()
    refuses(4, f"; {asset} is written", "prlimit", f"--fsize={limit}", mesh, *outputs)
    assert asset.read_bytes() == made, "the asset that the message names is another"


def test_files_and_parameters(programs, scan, work):
    mesh = programs / "trocar-mesh"
    run(mesh, scan / "sample.nii.gz", "-o", work / "x.GLB", "--slices", "3:3", "--quiet")
    (work / "verfy").write_text("no scan")  # a file with the name of a mistyped command
    refuses(3, "trocar-mesh: verfy: ", mesh, "verfy", "-o", work / "x.glb", cwd=work)
    slices = []
    for k in (1, 2, 3):
        slices.append(work / f"s{k}.png")
        shutil.copy(sorted((scan / "png").glob("*.png"))[10 + k], slices[-1])
    grey = ("--spacing", "0.3125,0.3125,1", "--threshold", "95.2", "--quiet")
    good = work / "good.glb"
    run(mesh, *slices, "-o", good, *grey)
    asset = good.read_bytes()

    # File names of any bytes, for input and output.
    odd = os.fsdecode(os.fsencode(work) + b"/Sch\xe4del.png")
    shutil.copy(slices[0], odd)
    run(mesh, odd, "-o", work / "odd.glb", *grey, "--report", work / "odd.json")
    report = json.loads((work / "odd.json").read_bytes())
    assert "del.png" in report["input"]["paths"][0], f"{report['input']}"
    shutil.copy(work / "odd.glb", os.fsdecode(os.fsencode(work) + b"/\xff.glb"))
    answer = run(mesh, "verify", os.fsdecode(os.fsencode(work) + b"/\xff.glb"), "--json")
    assert json.loads(answer.stdout)["valid"], "verify of an odd name: " + answer.stdout

    # The same folder, now with the asset in it.
    folder = work / "dicom"
    shutil.copytree(scan / "dicom", folder)
    made = []
    for _ in range(2):
        run(mesh, folder, "-o", folder / "bone.glb", "--slices", "3:5", "--quiet")
        made.append((folder / "bone.glb").read_bytes())
    assert made[0] == made[1], "an asset beside its slices changes the result"

    # An invalid asset is not exported: the first two points of an outline are swapped.
    run(mesh, *slices, "-o", work / "lines.glb", *grey, "--lines")
    asset = (work / "lines.glb").read_bytes()
    broken = bytearray(asset)
    length = int.from_bytes(asset[12:16], "little")
    gltf = json.loads(asset[20:20 + length])
    lines = next(p for m in gltf["meshes"] for p in m["primitives"] if p.get("mode") == 1)
    accessor = gltf["accessors"][lines["attributes"]["POSITION"]]
    at = 28 + length + gltf["bufferViews"][accessor["bufferView"]]["byteOffset"] + accessor.get("byteOffset", 0)
    broken[at:at + 12], broken[at + 12:at + 24] = asset[at + 12:at + 24], asset[at:at + 12]
    (work / "broken.glb").write_bytes(broken)
    for words in (("verify", work / "broken.glb"), ("export", work / "broken.glb", "-o", work / "export")):
        said = run(mesh, *words, expect=3).stderr
        assert "broken.glb" in said and len(said.splitlines()) == 1, f"{words}: {said}"
    assert not (work / "export").exists(), "a part of an invalid asset was exported"
    verifies_several(mesh, good, work / "broken.glb")


def test_export_complete_and_of_one_asset(programs, scan, work):
    """An export writes all files of one asset or none."""
    mesh, folder = programs / "trocar-mesh", work / "exported"
    for name, slices in (("few", "3:4"), ("more", "3:6"), ("one", "5:5")):
        run(mesh, scan / "sample.nii.gz", "-o", work / f"{name}.glb", "--slices", slices, "--quiet")
    run(mesh, "export", work / "few.glb", "-o", folder)
    run(mesh, "export", work / "few.glb", "-o", folder)
    (folder / "notes.txt").write_text("the user's own")
    run(mesh, "export", work / "more.glb", "-o", folder)
    there = {f.name: f.read_bytes() for f in folder.iterdir()}
    assert len(there) == 4 * 3 + 1, f"exported: {sorted(there)}"
    done = run(mesh, "export", work / "one.glb", "-o", folder)
    assert "still holds slice_0003.obj and 8 more files of another export" in done.stderr, f"exported over another: {done.stderr!r}"
    there = {f.name: f.read_bytes() for f in folder.iterdir()}
    biggest = max(len(content) for content in there.values())
    refuses(4, "File too large", "prlimit", f"--fsize={biggest - 1}", mesh, "export", work / "more.glb", "-o", folder)
    assert {f.name: f.read_bytes() for f in folder.iterdir()} == there, "a failed export left traces"
    refuses(4, "File too large", "prlimit", f"--fsize={biggest - 1}", mesh, "export", work / "more.glb", "-o", work / "new")
    assert not (work / "new").exists(), "a failed export left a folder"
    # The last file cannot be moved to its place after those before it have replaced others.
    blocked = folder / "slice_0006.svg"
    blocked.unlink()
    blocked.mkdir()
    (folder / "slice_0004.obj").unlink()
    (folder / "slice_0003.obj").write_text("the user's own")
    there = {f.name: f.read_bytes() for f in folder.iterdir() if f.is_file()}
    refuses(4, "Is a directory", mesh, "export", work / "more.glb", "-o", folder)
    assert {f.name: f.read_bytes() for f in folder.iterdir() if f.is_file()} == there, "a failed export replaced some files"
    assert [f for f in folder.iterdir() if f.is_dir()] == [blocked], "a failed export left or removed a folder"
