# SPDX-License-Identifier: Apache-2.0
"""Trocar-mesh as a user calls it: options in any order, no file of the user
overwritten, names of any bytes, parameters stored in the asset."""
import gzip
import json
import os
import pathlib
import shutil
import signal
import struct
import subprocess
import time

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


def wait_until_caught(process, signal_number):
    """Waits until the program has installed its handler of the signal."""
    status = pathlib.Path(f"/proc/{process.pid}/status")
    while process.poll() is None:
        caught = next(int(line.split()[1], 16) for line in status.read_text().splitlines() if line.startswith("SigCgt"))
        if caught >> (signal_number - 1) & 1:
            return
        time.sleep(0.01)


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
            ((scan / "dicom", "--threshold", "30000", "--slices", "3:3"), (f"{scan / 'dicom'}, slice 3: ", "try --threshold 226")),
            ((volume, "--labels", "99"), ("which is no label", "try it without --labels")),
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


def test_verify_states_each_check_for_itself(programs, scan, work):
    """An asset with HU around the material is valid and confirmed, but not private."""
    mesh, asset = programs / "trocar-mesh", work / "context.glb"
    run(mesh, scan / "sample.nii.gz", "--slices", "10:12", "--context", "-o", asset, "--quiet")
    done = run(mesh, "verify", "--private", "--independent", "--json", asset, expect=3)
    found = json.loads(done.stdout)
    assert (found["valid"], found["independent"], found["private"]) == (True, True, False) and "--context" in found["reason"], f"{found}"
    assert len(done.stderr.splitlines()) == 1, done.stderr


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
    refuses(3, "which is no label, a whole number from 0 to 2147483647; --mask needs a label map", mesh, volume, *out, "--mask", f"{volume}:300")
    said = warned(mesh, work / "all.json", volume, "-o", work / "all.glb", "--threshold", "-5000", "--slices", "14:15")
    assert "every pixel is material" in said.get("all_material", ""), f"all_material: {said}"
    label_map(scan, work / "small.nii.gz", [[1]])
    refuses(3, "needs a label map on the scan's grid", mesh, volume, *out, "--mask", f"{work / 'small.nii.gz'}:1")
    aside = bytearray(gzip.decompress(volume.read_bytes()))
    struct.pack_into("<f", aside, 292, struct.unpack_from("<f", aside, 292)[0] + 0.01)  # the origin's x, mm
    (work / "aside.nii").write_bytes(aside)
    refuses(3, "its origin is (", mesh, volume, *out, "--mask", f"{work / 'aside.nii'}:1")


def test_warns(programs, scan, work):
    mesh, out, report = programs / "trocar-mesh", ("-o", work / "warned.glb"), work / "warned.json"
    labelled = label_map(scan, work / "warned.nii", ((22,), (23, 24)))
    said = warned(mesh, report, labelled, *out, "--labels", "22,99999")
    assert "99999" in said.get("label_absent", ""), f"an absent label: {said}"
    folder = work / "numbered"
    folder.mkdir()
    for k in (1, 2, 3, 4, 6, 7):
        shutil.copy(scan / "png" / "slice_015.png", folder / f"a1_{k:03}_x2.png")
    grey = ("--spacing", "0.3125,0.3125,1")
    said = warned(mesh, report, folder, *out, *grey, "--threshold", "95.2")
    assert "a1_004_x2.png" in said.get("missing_slice", "") and "a1_006_x2.png" in said["missing_slice"], f"{said}"
    said = warned(mesh, report, folder / "a1_001_x2.png", *out, *grey, "--threshold", "-5")
    assert "0..255" in said.get("threshold_out_of_range", ""), f"a threshold of another scale: {said}"
    said = warned(mesh, report, *sorted(folder.iterdir())[:3], *out, *grey, "--threshold", "0")
    assert set(said) == {"all_material"}, f"unexpected warnings: {said}"


def test_groups_its_warnings(programs, scan, work):
    """Warnings of one kind are one line with ranges, and one entry with its slices."""
    mesh, report = programs / "trocar-mesh", work / "grouped.json"
    file = label_map(scan, work / "gaps.nii", ((), (), (22,), (), (24,), (), ()))
    said = run(mesh, file, "-o", work / "grouped.glb", "--labels", "20,22-24", "--report", report).stderr.splitlines()
    assert (said == ["trocar-mesh: warning (empty_slice): slices 0-1, 3, 5-6: without material",
                   "trocar-mesh: warning (label_absent): labels 20, 23: not in the slices that were meshed"]), f"grouped: {said}"
    entries = json.loads(report.read_bytes())["warnings"]
    assert (entries == [{"code": "empty_slice", "where": "slices 0-1, 3, 5-6", "sentence": "without material", "slices": [0, 1, 3, 5, 6]},
                      {"code": "label_absent", "where": "labels 20, 23", "sentence": "not in the slices that were meshed",
                       "labels": [20, 23]}]), f"entries: {entries}"
    folder = work / "stray"
    folder.mkdir()
    for k, source in enumerate(sorted((scan / "dicom").iterdir())[3:8]):
        shutil.copy(source, folder / f"{k}.dcm")
        (folder / f"note{k}.txt").write_text("a note")
    said = run(mesh, folder, "-o", work / "grouped.glb", "--report", report).stderr.splitlines()
    where = ", ".join(str(folder / f"note{k}.txt") for k in range(3)) + " and 2 more"
    assert said == [f"trocar-mesh: warning (not_dicom): {where}: not a DICOM image; left out"], f"files grouped: {said}"
    entry = json.loads(report.read_bytes())["warnings"][0]
    assert entry.get("places") == [f"input/note{k}.txt" for k in range(5)], f"files of a warning: {entry}"
    # Values that differ are a range.
    said = run(mesh, scan / "sample.nii.gz", "-o", work / "grouped.glb", "--slices", "3:5", "--lattice-bits", "5").stderr.splitlines()
    codes = [line.split("(")[1].split(")")[0] for line in said]
    assert len(codes) == len(set(codes)), f"two lines of a kind: {said}"


def test_reports_to_be_shared(programs, scan, work):
    """A report says which program wrote it and what it is, and holds no absolute paths."""
    mesh, report = programs / "trocar-mesh", work / "shared.json"
    version = run(mesh, "--version").stdout.split()[1]
    folder = work / "shared"
    shutil.copytree(scan / "dicom", folder)
    (folder / "note.txt").write_text("a note")
    for scanned in (str(folder), f"{folder}/", str(scan / "sample.nii.gz"), *([str(folder / "CT_004.dcm")],)):
        words = scanned if isinstance(scanned, list) else [scanned]
        run(mesh, *words, "-o", work / "shared.glb", "--report", report, "--quiet")
        text = report.read_text()
        made = json.loads(text)
        assert made.get("schema") == "trocar.report/1" and made.get("program") == f"trocar-mesh {version}", f"{made.get('schema')}"
        assert str(work) not in text and str(scan) not in text, f"{words}: a path in the report: {made['input']} {made['warnings']}"
        name = "input" if pathlib.Path(words[0]).is_dir() else pathlib.Path(words[0]).name
        assert made["input"]["paths"] == [name] and made["asset"]["file"] == "shared.glb", f"{made['input']}"
    run(mesh, "shared", "-o", "shared.glb", "--report", report, "--quiet", cwd=work)
    made = json.loads(report.read_bytes())
    assert made["input"]["paths"] == ["input"] and made["warnings"][0]["where"] == "input/note.txt", f"relative: {made['warnings']}"


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


def test_spacing_of_a_file_without_one(programs, scan, work):
    """A NIfTI without voxel sizes needs --spacing, and then gives the same mesh as one with them."""
    mesh, out = programs / "trocar-mesh", work / "sized.glb"
    given = ("--spacing", "0.3125,0.3125,1", "--slices", "3:4", "--quiet")
    header = bytearray(gzip.decompress((scan / "sample.nii.gz").read_bytes()))
    header[252:256] = struct.pack("<2h", 0, 0)  # neither qform nor sform
    made = {}
    for name, sizes in (("with", (0.3125, 0.3125, 1)), ("without", (0, 0, 0)), ("nan", (float("nan"), 1, 1))):
        header[80:92] = struct.pack("<3f", *sizes)
        (work / f"{name}.nii").write_bytes(header)
        if name != "with":
            refuses(2, f"{name}.nii: carries no voxel size: give --spacing", mesh, work / f"{name}.nii", "-o", out)
        run(mesh, work / f"{name}.nii", "-o", out, *given)
        slices = json.loads(run(mesh, "info", out, "--json").stdout)["slices"]
        made[name] = [(s["z_mm"], s["area_mm2"], s["triangles"]) for s in slices]
    assert made["with"] == made["without"] == made["nan"], f"--spacing: {made}"


def test_material_at_the_border(programs, work):
    """Where material reaches the image's border, a wide tolerance lets its outline leave the image."""
    border = nifti(work / "border.nii", np.random.default_rng(2).choice((0, 1500), (3, 96, 96)), (0.3, 0.3, 1))
    for tolerance in ("0", "0.2", "1", "3", "1000"):
        run(programs / "trocar-mesh", border, "--tolerance", tolerance, "--quiet", "-o", work / "border.glb")


def test_small_pixels(programs, work):
    """Defaults, and a preset's values, follow the pixel; given values do not, and what they cost is said."""
    mesh, side, pixel, report = programs / "trocar-mesh", 85, 0.05, work / "small.json"
    y, x = np.mgrid[:side, :side]
    walls = np.where((x % 20 < 5) | (y % 20 < 5), 1500, -20)
    grid = nifti(work / "grid.nii", np.stack(8 * [walls]), (pixel, pixel, pixel))

    def made(*words):
        said = warned(mesh, report, grid, "-o", work / "grid.glb", *words)
        document = json.loads(report.read_bytes())
        return document["parameters"], document["changes"], said

    used, changes, said = made()
    assert (abs(used["tolerance_mm"] - 0.02) < 1e-6 and abs(used["min_region_mm2"] - 0.01) < 1e-6
            and used["lattice_bits"] == 11 and not said), f"defaults: {used}, {said}"
    assert changes["filled_mm2"] == changes["dropped_mm2"] == changes["moved_mm2"] == 0, f"changes: {changes}"
    thin_mm2 = changes["area_mm2"]
    used, changes, said = made("--min-region", "1", "--tolerance", "0.2", "--lattice-bits", "8")
    assert (used["tolerance_mm"], used["min_region_mm2"], used["lattice_bits"]) == (0.2, 1, 8), f"given: {used}"
    assert changes["area_mm2"] > 1.5 * thin_mm2 and "--min-region 1 mm^2" in said.get("holes_filled", ""), f"{changes}: {said}"
    used, changes, said = made("--preset", "solid-bone")
    assert abs(used["close_mm"] - 0.5) < 1e-6 and abs(used["min_volume_mm3"] - 100 / 216) < 1e-5, f"preset: {used}"
    assert changes["solid_filled_mm2"] > 0, f"solid: {changes}"
    used, _, _ = made("--preset", "solid-bone", "--close", "3", "--min-volume", "0.1")
    assert (used["close_mm"], used["min_volume_mm3"]) == (3, 0.1), f"beside a preset: {used}"
    refuses(3, "--min-volume leaves none", mesh, grid, "-o", work / "never.glb", "--preset", "solid-bone", "--min-volume", "100")


def test_outputs_complete_or_none(programs, scan, work):
    """A file beyond `ulimit -f`, a signal: an error, and no file is left."""
    mesh, sample_ct = programs / "trocar-mesh", programs / "trocar-sample-ct"
    for limit in (5_000, 20_000, 100_000):  # less than a PNG, a DICOM file, the NIfTI
        folder = work / f"full_{limit}"
        folder.mkdir()
        refuses(4, "File too large", "prlimit", f"--fsize={limit}", sample_ct, folder, "--slices", "8", "--size",
                "128", "--quiet")
        assert list(folder.iterdir()) == [], f"left behind: {list(folder.iterdir())}"
    # If a later file fails, the message names the asset, which is written.
    asset, stages = work / "written.glb", work / "stages.json"
    outputs = (scan / "dicom", "-o", asset, "--dump-stages", stages, "--dump-slice", "4", "--slices", "3:5", "--quiet")
    run(mesh, *outputs)
    limit, made = 2 * asset.stat().st_size, asset.read_bytes()
    assert limit < stages.stat().st_size, "the stages are too small for this test"
    asset.unlink()
    refuses(4, f"; {asset} is written", "prlimit", f"--fsize={limit}", mesh, *outputs)
    assert asset.read_bytes() == made, "the asset that the message names is another"
    for signal_number in (signal.SIGINT, signal.SIGTERM):
        for seconds in (0, 1):
            folder = work / f"stopped_{int(signal_number)}_{seconds}"
            folder.mkdir()
            with subprocess.Popen([sample_ct, folder, "--quiet", "--jobs", "1", "--slices", "61"],
                                  stderr=subprocess.PIPE, text=True) as process:
                wait_until_caught(process, signal_number)
                time.sleep(seconds)
                process.send_signal(signal_number)
                said = process.communicate()[1]
            assert process.returncode == 4 and "interrupted" in said, f"stopped: {process.returncode} {said!r}"
            assert list(folder.iterdir()) == [], f"left behind: {list(folder.iterdir())}"


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

    # An input is not overwritten under a name that does not say what it is.
    mask = label_map(scan, work / "mask.nii", ((1, 2), (1,)))
    os.link(mask, work / "mask.json")  # a name that does not say it is a scan
    kept = mask.read_bytes()
    refuses(2, f"would write over the input {mask}", mesh, scan / "sample.nii.gz", "-o", good, "--mask", f"{mask}:1", "--report", work / "mask.json")
    assert mask.read_bytes() == kept and good.read_bytes() == asset, "the mask or the asset was overwritten"

    # File names of any bytes, for input and output.
    odd = os.fsdecode(os.fsencode(work) + b"/Sch\xe4del.png")
    shutil.copy(slices[0], odd)
    run(mesh, odd, "-o", work / "odd.glb", *grey, "--report", work / "odd.json")
    report = json.loads((work / "odd.json").read_bytes())
    assert "del.png" in report["input"]["paths"][0], f"{report['input']}"
    shutil.copy(work / "odd.glb", os.fsdecode(os.fsencode(work) + b"/\xff.glb"))
    answer = run(mesh, "verify", os.fsdecode(os.fsencode(work) + b"/\xff.glb"), "--json")
    assert json.loads(answer.stdout)["valid"], "verify of an odd name: " + answer.stdout

    # Options before and after the input; labels as a list, a range, all, and one by one.
    labelled, made = label_map(scan, work / "order.nii", ((20, 21, 22), (23, 24, 41), (42,))), set()
    for words in (("20,21,22,23,24,41,42",), ("20-24,41-42",), ("all",), ("20-24", "--labels", "41,42")):
        for order in ((labelled, "--labels", *words), ("--labels", *words, labelled)):
            run(mesh, *order, "-o", work / "labels.glb", "--quiet")
            made.add((work / "labels.glb").read_bytes())
    assert len(made) == 1, "different assets of the same labels"

    # The parameters in the asset include those of the input.
    run(mesh, scan / "sample.nii.gz", "-o", work / "coronal.glb", "--axis", "coronal", "--slices", "250:252", "--quiet")
    for file, key, value in ((good, "spacing_mm", [0.3125, 0.3125, 1.0]), (work / "coronal.glb", "axis", "coronal")):
        info = json.loads(run(mesh, "info", file, "--json").stdout)
        assert info["parameters"].get(key) == value, f"{file.name}: {info['parameters']}"

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
