# SPDX-License-Identifier: Apache-2.0
"""console_page_test.py SOURCE PROGRAMS SCAN WORK: the console's page in a headless Chromium (console/drive.mjs): lists, three slices and
a vertebra, holes, faults, recovery, emergency stop, playback, report; then its recordings and pictures are checked. The test prints
times and frame rates, and how loaded the machine was; TROCAR_JUDGE_TIMES=1 checks them against their bounds."""
import json
import os
import pathlib
import shutil
import sys

import numpy
from PIL import Image

from chromium_page import drive, need_browser, page_of
from e2e import check, outcome, run
from machine_stalls import MachineStalls, share_of_processors

SOURCE, PROGRAMS, SCAN, WORK = (pathlib.Path(word).resolve() for word in sys.argv[1:5])
BONE_ms, FPS_SURFACE, FPS_SLICES = 2000, 30, 10


def make_folder(folder):
    folder.mkdir(parents=True)
    run(PROGRAMS / "trocar-mesh", SCAN / "dicom", "-o", folder / "sample.glb", "--surface", "--quiet")
    names = ["three_slices.json", "vertebra.json", "network_middle.json"]
    for name in names:
        scene = json.loads((SOURCE / "runtime" / "scenes" / name).read_text())
        scene["asset"] = "sample.glb"
        (folder / name).write_text(json.dumps(scene))
        if name == "three_slices.json":  # and one in which the tool stays above the slices: a recovery needs that
            scene |= {"name": "Waiting", "duration_s": 60}
            scene["hand"]["trajectory"] = scene["hand"]["trajectory"][:1] + [{"t_s": 60, "tip_m": [0, 0, 0.202]}]
            (folder / "waiting.json").write_text(json.dumps(scene))
        elif name == "vertebra.json":  # and the same needle 4 mm beside
            for frame in scene["hand"]["trajectory"]:
                frame["tip_m"][0] += 0.004
            (folder / "beside.json").write_text(json.dumps(scene))
        else:  # and the first one of the list, which the page does not choose, because it has no whole bone
            (folder / "alone.json").write_text(json.dumps(scene))
    hostile = '<img src="x" onerror="document.title=1"><b>.json'
    (folder / hostile).write_text(json.dumps({"schema": "trocar.scene/1", "name": "<b>bold</b>"}))
    return [*names, "waiting.json", "beside.json", "alone.json", hostile]


def check_bone(picture):
    """The pixels of the bone differ from the plain background and from each other: they show HU as colours."""
    pixels = numpy.asarray(Image.open(picture).convert("RGB")).astype(int)
    height, width = pixels.shape[:2]
    middle = pixels[int(0.3 * height):int(0.8 * height), int(0.25 * width):int(0.75 * width)]
    background = pixels[height // 2, int(0.02 * width)]
    is_bone = numpy.abs(middle - background).sum(2) > 30
    colours = len(numpy.unique(middle[is_bone].reshape(-1, 3), axis=0)) if is_bone.any() else 0
    print(f"{picture.name}: bone on {100 * is_bone.mean():.0f} % of the middle, {colours} colours")
    check(is_bone.mean() > 0.05, f"{picture.name}: no bone")
    check(colours > 100, f"{picture.name}: only {colours} colours")


def check_start(folder):
    """With --start, a session starts when the operator's page is opened: not before, not for the audience, and once."""
    with page_of(PROGRAMS, folder, WORK, "--start", "waiting.json") as (_, given):
        drive("drive_start.mjs", given)


def main():
    need_browser()
    pictures = WORK / "pictures"
    shutil.rmtree(WORK, ignore_errors=True)
    scenes = make_folder(WORK / "folder")
    share = share_of_processors()
    with page_of(PROGRAMS, WORK / "folder", WORK, "--device", "inproc", "--device", "sim") as (console, given):
        with MachineStalls() as machine:
            result = drive("drive.mjs", {**given, "console_pid": console.process.pid, "scenes": scenes})
        share = min(share, share_of_processors())
    check_start(WORK / "folder")
    figures = result["figures"]
    if not figures:
        return outcome()
    print(f"two programs got {share:.2f} of 1 s; {machine};", json.dumps(figures))
    check(figures.get("fps_surface", 0) > 0 and figures.get("fps_slices", 0) > 0, "no frame was drawn while frames were counted")
    if os.environ.get("TROCAR_JUDGE_TIMES"):
        check(figures.get("bone_shown_ms", 1e9) <= BONE_ms, f"the bone was shown after {figures.get('bone_shown_ms')} ms")
        check(figures.get("fps_surface", 0) >= FPS_SURFACE, f"{figures.get('fps_surface')} frames a second with surface and near slices")
        check(figures.get("fps_slices", 0) >= FPS_SLICES, f"{figures.get('fps_slices')} frames a second with 35 slices")
    for name in ("bone_three_slices.png", "bone_vertebra.png"):
        check_bone(pictures / name)
    return outcome()


sys.exit(main())
