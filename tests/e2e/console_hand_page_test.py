# SPDX-License-Identifier: Apache-2.0
"""console_hand_page_test.py SOURCE PROGRAMS SCAN WORK: the needle held in the console's page, in a headless Chromium (console/drive_hand.mjs):
by keys, mouse, gamepad and touch; two pages and an audience; a page that hangs, is closed, or loses its connection. Then the recordings
are checked: what the bar said is the recorded force, and a replay gives the same bytes. The test prints times; TROCAR_JUDGE_TIMES=1
checks them against their bounds."""
import bisect
import json
import os
import pathlib
import shutil
import sys

from chromium_page import drive, need_browser, page_of
from e2e import check, outcome, run
from exported import rows_of

SOURCE, PROGRAMS, SCAN, WORK = (pathlib.Path(word).resolve() for word in sys.argv[1:5])
SLICES, BONE = "slices_by_hand.json", "bone_by_hand.json"
BAR_N, BAR_FRACTION = 1, 0.03        # how far the bar may be from the recording
MOTION_ms = 25                       # from the target to the tip's first motion


def make_folder(folder):
    folder.mkdir(parents=True)
    run(PROGRAMS / "trocar-mesh", SCAN / "dicom", "-o", folder / "sample.glb", "--surface", "--quiet")
    for source, name in (("three_slices.json", SLICES), ("vertebra.json", BONE)):
        scene = json.loads((SOURCE / "runtime" / "scenes" / source).read_text())
        hand = {key: value for key, value in scene["hand"].items() if key != "trajectory"}
        scene |= {"asset": "sample.glb", "duration_s": 300, "hand": hand | {"live": True, "trajectory": scene["hand"]["trajectory"][:1]}}
        (folder / name).write_text(json.dumps(scene))


def check_bar(name, recording, samples):
    """What the bar said in each frame is the force of that tick in the recording."""
    rows = rows_of(recording)
    times = [float(row["t_s"]) for row in rows]
    worst = (0, 0, 0)
    for t_s, said_N, _ in samples:
        row = rows[min(bisect.bisect_left(times, t_s - 1e-9), len(rows) - 1)]
        check(abs(float(row["t_s"]) - t_s) < 1e-6, f"{name}: the recording has no tick at {t_s} s")
        force_N = sum(float(row[f"f{axis}_delivered_N"]) ** 2 for axis in "xyz") ** 0.5
        worst = max(worst, (abs(said_N - force_N), said_N, force_N))
        check(abs(said_N - force_N) <= max(BAR_N, BAR_FRACTION * force_N), f"{name}: at {t_s} s the bar said {said_N} N, the recording has {force_N} N")
    peak = max((said for _, said, _ in samples), default=0)
    print(f"{name}: {len(samples)} frames, {peak} N at most; the bar differs by {worst[0]:.3f} N at most ({worst[1]} N for {worst[2]:.3f} N)")
    check(len(samples) > 20 and peak > 5, f"{name}: {len(samples)} frames, {peak} N at most")


def check_replay(name, scene, recording):
    again = WORK / f"{name}_again.csv"
    run(PROGRAMS / "trocar-run", "replay", scene, recording, "--record", again, "--quiet", expect=5 if name == "keys" else 0)  # 5: it ends by an emergency stop
    check(again.read_bytes() == recording.read_bytes(), f"{name}: the replay differs")


def main():
    need_browser()
    shutil.rmtree(WORK, ignore_errors=True)
    folder = WORK / "folder"
    make_folder(folder)
    with page_of(PROGRAMS, folder, WORK) as (_, given):
        result = drive("drive_hand.mjs", {**given, "slices": SLICES, "bone": BONE})
    for name, session in result["sessions"].items():
        recording = folder / session["recording"]
        if session["samples"]:
            check_bar(name, recording, session["samples"])
        check_replay(name, folder / (BONE if name == "bone" else SLICES), recording)
    missing = {"keys", "mouse", "gamepad", "bone", "pages", "touch"} - set(result["sessions"])
    check(not missing, f"no recording of {missing}")
    figures = result["figures"]
    print(json.dumps(figures))
    if os.environ.get("TROCAR_JUDGE_TIMES"):
        check(figures["motion_ms"]["snapshot_median"] <= MOTION_ms, f"from the target to the tip's first motion: {figures['motion_ms']} ms")
    return outcome()


sys.exit(main())
