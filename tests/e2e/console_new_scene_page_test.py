# SPDX-License-Identifier: Apache-2.0
"""console_new_scene_page_test.py SOURCE PROGRAMS SCAN WORK: a new scene by clicking on the bone, in a headless Chromium
(console/drive_new_scene.mjs). The points that the page showed are compared with the scene that was written."""
import json
import pathlib
import shutil
import sys

import numpy as np
from chromium_page import drive, need_browser, page_of
from console_client import container
from e2e import check, outcome, run

SOURCE, PROGRAMS, SCAN, WORK = (pathlib.Path(word).resolve() for word in sys.argv[1:5])


def make_folder(folder):
    (folder / "scenes").mkdir(parents=True)
    run(PROGRAMS / "trocar-mesh", SCAN / "dicom", "-o", folder / "sample.glb", "--surface", "--quiet")
    for source, name, apart_m in (("vertebra", "vertebra", 0), ("three_slices", "apart", 0.001)):
        scene = json.loads((SOURCE / "runtime/scenes" / f"{source}.json").read_text()) | {"asset": "../sample.glb"}
        for i, placed in enumerate(scene.get("slices", [])):
            placed["z_m"] -= i * apart_m
        (folder / "scenes" / f"{name}.json").write_text(json.dumps(scene))


def bone_of(console, scene):
    return container(console.request("GET", f"/api/bone?scene={scene}", raw=True)[1])


def largest_triangle(bone, arrays, below_m=0.0):
    """The middle of the largest triangle of the slice that lies so far below the topmost one, in {B}."""
    top = min(bone["slices"], key=lambda each: abs(each["z_m"] - bone["slices"][0]["z_m"] + below_m))
    numbers = lambda part, kind: np.frombuffer(arrays, kind, part[1], part[0])
    corners = numbers(top["vertices"], "<f4").reshape(-1, 2)[numbers(top["triangles"], "<u4").reshape(-1, 3)].astype(float)
    (a, b), (c, d) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    return [*corners[np.argmax(np.abs(a * d - b * c))].mean(axis=0), top["z_m"]]


def point(text):
    return np.array([float(word) for word in text.split(",")])


def main():
    need_browser()
    shutil.rmtree(WORK, ignore_errors=True)
    folder = WORK / "folder"
    make_folder(folder)
    with page_of(PROGRAMS, folder, WORK) as (console, given):
        bone, arrays = bone_of(console, "scenes/vertebra.json")
        entry = largest_triangle(bone, arrays)
        result = drive("drive_new_scene.mjs", {**given, "entry": entry, "beside": largest_triangle(bone, arrays, 0.018)})
        said = result["chosen"]
        there = np.array(bone["lps_mm_of_device"]) @ [*entry, 1]
        check(np.linalg.norm(point(said["section"]["entry"]) - there) < 0.4, f"the page says {said['section']}, the point is {there}")
        scene = json.loads((folder / "clicked.json").read_text())
        rows = np.array(bone_of(console, "clicked.json")[0]["lps_mm_of_device"])
        for name, at_m in (("entry", scene["goals"]["line"]["entry_m"]), ("target", scene["goals"]["target"]["at_m"])):
            away = np.linalg.norm(rows @ [*at_m, 1] - point(said["made"][name]))
            check(away < 0.1, f"{name}: the page says {said['made'][name]}, the scene has {rows @ [*at_m, 1]}")
        check(scene["hand"]["live"] and "live" not in json.loads((folder / "thickest.json").read_text())["hand"], "the hand is not the one that was chosen")
    return outcome()


sys.exit(main())
