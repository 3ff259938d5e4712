# SPDX-License-Identifier: Apache-2.0
"""mesh_program_e2e_test.py PROGRAMS SCAN WORK: trocar-mesh as a user calls it: options in any order, nothing of the user's
written over, names of any bytes, and what an asset says of how it was made."""
import json
import os
import pathlib
import shutil
import sys

from e2e import check, outcome, run


def main():
    programs, scan, work = map(pathlib.Path, sys.argv[1:4])
    mesh = programs / "trocar-mesh"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    slices = []
    for k in (1, 2, 3):
        slices.append(work / f"s{k}.png")
        shutil.copy(sorted((scan / "png").glob("*.png"))[10 + k], slices[-1])
    grey = ("--spacing", "0.3125,0.3125,1", "--threshold", "95.2", "--quiet")
    before = [f.read_bytes() for f in slices]
    good = work / "good.glb"
    run(mesh, *slices, "-o", good, *grey)
    asset = good.read_bytes()

    # Nothing is written over that was read, or could be a scan, or is another output.
    for words in (("-o", *slices),  # the shell's  -o s*.png
                  (*slices, "-o", slices[0]),
                  (*slices, "-o", work / "new.png"),
                  (*slices, "-o", good, "--report", slices[1]),
                  (*slices, "-o", good, "--report", good),
                  (*slices, "-o", good, "--report", work / "." / "good.glb"),
                  (scan / "sample.nii.gz", "-o", scan / "sample.nii.gz"),
                  (scan / "dicom", "-o", sorted((scan / "dicom").iterdir())[0]),
                  (*slices, "-o", good, "--dump-stages", work / "stages.json"),
                  (*slices, "-o", good, "--dump-stages", work / "stages.json", "--dump-slice", "3")):
        said = run(mesh, *words, *grey, expect=2).stderr
        check(len(said.splitlines()) == 1 and ("-o " in said or "--" in said), f"{words}: {said}")
    check([f.read_bytes() for f in slices] == before, "a slice was written over")
    check(good.read_bytes() == asset, "the asset was written over")

    # Names of any bytes, in what is read and in what is written.
    odd = os.fsdecode(os.fsencode(work) + b"/Sch\xe4del.png")
    shutil.copy(slices[0], odd)
    run(mesh, odd, "-o", work / "odd.glb", *grey, "--report", work / "odd.json")
    report = json.loads((work / "odd.json").read_bytes())
    check("del.png" in report["input"]["paths"][0], f"{report['input']}")
    shutil.copy(work / "odd.glb", os.fsdecode(os.fsencode(work) + b"/\xff.glb"))
    answer = run(mesh, "verify", os.fsdecode(os.fsencode(work) + b"/\xff.glb"), "--json")
    check(json.loads(answer.stdout)["valid"], "verify of an odd name: " + answer.stdout)

    # Options before and after the input.
    for words in (("--labels", "1,2", scan / "sample.nii.gz"), (scan / "sample.nii.gz", "--labels", "1,2")):
        run(mesh, *words, "-o", work / "labels.glb", "--slices", "3:4", "--quiet")

    # How it was made: what was asked of the input, too.
    run(mesh, scan / "sample.nii.gz", "-o", work / "coronal.glb", "--axis", "coronal", "--slices", "60:62", "--quiet")
    for file, key, value in ((good, "spacing_mm", [0.3125, 0.3125, 1.0]), (work / "coronal.glb", "axis", "coronal")):
        info = json.loads(run(mesh, "info", file, "--json").stdout)
        check(info["parameters"].get(key) == value, f"{file.name}: {info['parameters']}")

    # The same folder, now with the asset in it.
    folder = work / "dicom"
    shutil.copytree(scan / "dicom", folder)
    made = []
    for _ in range(2):
        run(mesh, folder, "-o", folder / "bone.glb", "--slices", "3:5", "--quiet")
        made.append((folder / "bone.glb").read_bytes())
    check(made[0] == made[1], "an asset beside its slices changes what is made of them")

    # Exported is only what is proved: an outline whose first two points change places is not.
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
        check("broken.glb" in said and len(said.splitlines()) == 1, f"{words}: {said}")
    check(not (work / "export").exists(), "something of a broken asset was exported")

    shutil.rmtree(work)
    return outcome()


if __name__ == "__main__":
    sys.exit(main())
