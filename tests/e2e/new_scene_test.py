# SPDX-License-Identifier: Apache-2.0
"""`trocar-run new-scene` on assets of several kinds.

What it writes passes `check --strict` and runs to its punctures: for the phantom, solid bone, an asset without HU, a label map with
and without the HU of a CT, the real L3 (if there is TROCAR_REAL_CT) and a stack that is taller than the device's reach. Its place is
compared with the asset itself: the entry point is material in the slices it names, and slices stand at their true spacing. What cannot
give a scene is refused in one line, and nothing is written.
"""
import json
import os
import re
import subprocess

import numpy as np

from exported import nifti
from programs import L3_SCAN, REAL_CT, run

REACH_M = 0.18  # from the lowest to the highest place of the plate


class Maker:
    def __init__(self, programs, work):
        self.mesh, self.run, self.work = programs / "trocar-mesh", programs / "trocar-run", work

    def asset(self, name, *words):
        run(self.mesh, *words, "-o", self.work / f"{name}.glb", "--quiet")
        return self.work / f"{name}.glb"

    def propose(self, asset, law, least_punctures):
        name = asset.stem
        folder = self.work / f"scene of {name}"
        folder.mkdir()
        file = folder / "scene.json"
        done = run(self.run, "new-scene", os.path.relpath(asset, self.work), "-o", file.relative_to(self.work), cwd=self.work)
        assert done.stdout.count("\n") == 1 and done.stderr == "" and "thickest" in done.stdout, f"{name}: {done.stdout!r} {done.stderr!r}"
        scene, info = json.loads(file.read_text()), json.loads(run(self.mesh, "info", asset, "--json").stdout)
        assert scene["force_law"]["kind"] == law, f"{name}: {scene['force_law']}"
        assert (folder / scene["asset"]).resolve() == asset and not scene["asset"].startswith("/"), f"{name}: asset {scene['asset']}"
        self.check_places(name, scene, info)
        thick = float(re.search(r"([0-9.]+) mm thick", done.stdout)[1])
        planes = sorted({each["z_mm"] for each in info["slices"] if each["triangles"] > 0})
        assert 0 < thick <= planes[-1] - planes[0] + planes[1] - planes[0] + 0.06, f"{name}: {thick} mm thick"
        run(self.run, "check", file, "--strict", "--quiet")
        summary = folder / "summary.json"
        run(self.run, file, "--clock", "virtual", "--quiet", "--summary", summary)
        told = json.loads(summary.read_text())
        assert told["end"] == "done" and len(told["punctures"]) >= least_punctures and told["max_force_N"] > 1, f"{name}: {told['end']}, {len(told['punctures'])} punctures"
        return scene, done.stdout

    def check_again(self, asset, scene):
        again = self.work / "again.json"
        run(self.run, "new-scene", asset, "-o", again, "--quiet")
        assert {**json.loads(again.read_text()), "asset": 0} == {**scene, "asset": 0}, f"{asset}: the second proposal is another"

    def check_places(self, name, scene, info):
        planes = {each["index"]: each for each in info["slices"] if each["triangles"] > 0}
        u, v = scene["placement"]["anchor_mm"]
        if "slices" in scene:
            used = [each["index"] for each in scene["slices"]]
            tops = [each["z_m"] - planes[each["index"]]["z_mm"] / 1e3 for each in scene["slices"]]
            assert max(tops) - min(tops) < 1e-6, f"{name}: not the true spacing: {scene['slices']}"
        else:
            used = [index for index in range(scene["body"]["from"], scene["body"]["to"] + 1) if index in planes]
        assert all(index in planes for index in used), f"{name}: {used}"
        height = (max(planes[i]["z_mm"] for i in used) - min(planes[i]["z_mm"] for i in used)) / 1e3
        assert height < REACH_M, f"{name}: {height} m tall"
        for index in used:
            (u0, v0), (u1, v1) = planes[index]["box_mm"]
            assert u0 <= u <= u1 and v0 <= v <= v1, f"{name}: slice {index} is not at the entry point"

    def refuse(self, asset, said, *options):
        out = self.work / "refused.json"
        done = subprocess.run([str(w) for w in (self.run, "new-scene", asset, "-o", out, *options)], capture_output=True, text=True, check=False)
        assert done.returncode == 3 and said in done.stderr and done.stderr.count("\n") == 1 and str(asset) in done.stderr, f"{said}: {done}"
        assert not out.exists(), f"{said}: a scene was written"


def column(file, slices, spacing_mm, radius_mm=12, hu=400):
    """A round column of bone."""
    y, x = np.mgrid[0:48, 0:48]
    bone = np.hypot(x - 24, y - 24) < radius_mm
    return nifti(file, np.where(bone, hu, -200)[None].repeat(slices, axis=0), (1, 1, spacing_mm))


def test_new_scene(source, programs, scan, work):
    make = Maker(programs, work)

    scene, said = make.propose(sample := make.asset("sample", scan / "dicom"), "cutting", 10)
    make.check_again(sample, scene)
    assert scene["body"]["to"] - scene["body"]["from"] >= 20 and "HU" in said, f"sample: {scene['body']}, {said}"
    assert list(scene)[:4] == ["schema", "name", "asset", "placement"], f"the keys are not in the order for readers: {list(scene)}"
    make.propose(make.asset("solid", scan / "dicom", "--preset", "vertebra"), "cutting", 10)
    scene, said = make.propose(make.asset("no_hu", scan / "dicom", "--no-hu"), "hooke", 2)
    assert "since the asset has no HU" in said and len(scene["slices"]) >= 2, f"no_hu: {said}"
    y, x = np.mgrid[0:48, 0:48]
    halves = np.where(np.hypot(x - 24, y - 24) < 14, np.where(x < 24, 1, 2), 0)[None].repeat(14, axis=0)
    labels, ct = nifti(work / "labels.nii", halves, (1, 1, 1.5)), nifti(work / "ct.nii", np.where(halves > 0, 350, -100), (1, 1, 1.5))
    make.propose(make.asset("labels", labels, "--labels", "all"), "hooke", 1)
    make.propose(make.asset("labels_hu", labels, "--labels", "all", "--hu", ct), "cutting", 5)
    scene, _ = make.propose(make.asset("tall", column(work / "tall.nii", 200, 2)), "cutting", 10)
    assert scene["body"]["to"] - scene["body"]["from"] < 64, f"tall: {scene['body']}"
    _, said = make.propose(make.asset("apart", column(work / "apart.nii", 6, 12)), "hooke", 3)
    assert "more than 3 mm apart" in said, f"apart: {said}"

    if L3_SCAN.is_file():
        vertebrae = REAL_CT / "sub-ct_seg-vert_label-22_msk.nii.gz"
        make.propose(make.asset("l3", vertebrae, "--labels", "22", "--hu", L3_SCAN), "cutting", 5)
        make.propose(make.asset("l3_labels", vertebrae, "--labels", "22"), "hooke", 1)
    else:
        print("no TROCAR_REAL_CT: L3 is not tried")

    make.refuse(make.asset("thin", column(work / "thin.nii", 3, 5, radius_mm=2)), "nowhere as wide as the tool")
