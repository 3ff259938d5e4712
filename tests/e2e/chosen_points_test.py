# SPDX-License-Identifier: Apache-2.0
"""`trocar-run new-scene ASSET --entry X,Y,Z --target X,Y,Z`: a scene through points that a person has chosen.

The scans are made here, so where a point of the patient lies in a scan, and in which voxels there is bone, is known without the programs.
A session with the scene must bring the tip to the target through the corridor, as its report says. (Ways that no needle can take: path_test.)
"""
import json
import subprocess

import numpy as np
import pytest

from new_scene_test import column
from programs import PROGRAMS, run

RUN, MESH = PROGRAMS / "trocar-run", PROGRAMS / "trocar-mesh"


def words_of(point):
    return ",".join(f"{x:.3f}" for x in point)


def lps(i, j, k, spacing):
    """The patient's position of a voxel of nifti(), whose axes are those of RAS."""
    return -i * spacing[0], -j * spacing[1], k * spacing[2]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("chosen_points")


@pytest.fixture(scope="module")
def bone(folder):
    """A column of bone, 24 mm across and 34.5 mm tall, in slices 1.5 mm apart."""
    run(MESH, column(folder / "bone.nii", 24, 1.5), "-o", folder / "bone.glb", "--quiet")
    return folder / "bone.glb"


def propose(asset, scene, *words):
    return subprocess.run([str(word) for word in (RUN, "new-scene", asset, "-o", scene, *words)], capture_output=True, text=True, check=False)


def made(asset, scene, *words):
    done = propose(asset, scene, *words)
    assert done.returncode == 0 and done.stdout.count("\n") == 1 and done.stderr == "", done
    return json.loads(scene.read_text()), done.stdout


def device_point(scene, i, j, k, spacing, levels):
    """The position in {B} of a voxel. Slices are turned so that u runs to the patient's left and v to the back, against both axes of nifti()."""
    u, v = scene["placement"]["anchor_mm"]
    i, j = SIDE - 1 - i, SIDE - 1 - j
    top = scene["body"]["top_z_m"] - levels[scene["body"]["to"]] / 1000
    return np.array([(i * spacing[0] - u) / 1000, (j * spacing[1] - v) / 1000, top + k * spacing[2] / 1000])


def goals_of_session(scene_file, folder):
    name = folder / f"{scene_file.stem}_report.html"
    run(RUN, scene_file, "--clock", "virtual", "--quiet", "--session-report", name)
    return {goal["goal"]: goal for goal in json.loads(name.with_suffix(".json").read_text())["goals"]}


SIDE = 48  # voxels of column()
SPACING = (1, 1, 1.5)
LEVELS = [1.5 * k for k in range(24)]
ENTRY, TARGET = (20, 27, 23), (26, 21, 9.4)  # voxels


def test_scripted_needle_gets_to_the_target(bone, folder):
    file = folder / "to_target.json"
    scene, said = made(bone, file, "--entry", words_of(lps(*ENTRY, SPACING)), "--target", words_of(lps(*TARGET, SPACING)))
    assert scene["force_law"]["kind"] == "cutting" and "the first" not in said and "no warning" in said, said
    entry, target = (device_point(scene, *voxel, SPACING, LEVELS) for voxel in (ENTRY, TARGET))
    assert np.allclose(scene["goals"]["line"]["entry_m"], entry, atol=1.1e-5), f"{scene['goals']}, {entry}"
    assert np.allclose(scene["goals"]["target"]["at_m"], target, atol=1.1e-5), f"{scene['goals']}, {target}"
    way = (target - entry) / np.linalg.norm(target - entry)
    tilt = np.degrees(np.arccos(-way[2]))
    assert f"tilted by {tilt:.1f} deg" in said and f"{1000 * np.linalg.norm(target - entry):.1f} mm from the entry" in said, said
    for key in scene["hand"]["trajectory"]:
        away = np.array(key["tip_m"]) - entry
        assert np.linalg.norm(away - away @ way * way) < 3e-5, f"the hand leaves the line: {key}"
        assert np.allclose(np.degrees(1) * np.cross([0, 0, -1], way) / np.linalg.norm(np.cross([0, 0, -1], way)) * np.radians(tilt), key["rotation_deg"], atol=2e-3), f"{key}"
    assert scene["body"] == {"from": 0, "to": 23, "top_z_m": scene["body"]["top_z_m"]}, f"bone is missing: {scene['body']}"
    assert abs(np.mean([entry[:2], target[:2]], axis=0)).max() < 1e-5, "the way is not over the middle of the device"
    run(RUN, "check", file, "--strict", "--quiet")
    goals = goals_of_session(file, folder)
    assert set(goals) == {"target", "entry", "corridor"} and all(goal["met"] for goal in goals.values()), goals
    assert goals["target"]["value"] < 0.002, goals["target"]


def test_entry_alone_goes_straight_down(bone, folder):
    scene, said = made(bone, folder / "down.json", "--entry", words_of(lps(18, 26, 12, SPACING)))
    assert "mm from the chosen point" in said, said  # it lies inside of the bone
    assert scene["goals"]["line"]["direction"] == [0, 0, -1] and "target" not in scene["goals"], scene["goals"]
    assert scene["placement"]["anchor_mm"] == [SIDE - 1 - 18, SIDE - 1 - 26], scene["placement"]
    tips = np.array([key["tip_m"] for key in scene["hand"]["trajectory"]])
    assert np.all(tips[:, :2] == 0) and "rotation_deg" not in scene["hand"]["trajectory"][0], tips
    assert tips[:, 2].max() - tips[:, 2].min() > 0.0345, "the needle does not go through"
    run(RUN, "check", folder / "down.json", "--strict", "--quiet")


def test_live_hand_begins_on_the_line(bone, folder):
    words = ("--entry", words_of(lps(*ENTRY, SPACING)), "--target", words_of(lps(*TARGET, SPACING)))
    scene, said = made(bone, folder / "live.json", *words, "--live-hand")
    scripted, _ = made(bone, folder / "scripted.json", *words)
    assert scene["hand"]["live"] and scene["hand"]["trajectory"] == scripted["hand"]["trajectory"][:1] and "the hand is now live" in said, said
    assert scene["goals"] == scripted["goals"] and scene["body"] == scripted["body"]
    run(RUN, "check", folder / "live.json", "--strict", "--quiet")
