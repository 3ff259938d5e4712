# SPDX-License-Identifier: Apache-2.0
"""console_imaging_page_test.py SOURCE PROGRAMS SCAN WORK: X-ray and planes of the CT in the console's page, in a headless Chromium
(console/drive_imaging.mjs). Then the counts of the page are compared with the recording, the summary, the session report and a replay. The
test prints times; TROCAR_JUDGE_TIMES=1 checks them against their bounds."""
import json
import os
import pathlib
import re
import shutil
import sys

from chromium_page import drive, need_browser, page_of
from e2e import check, outcome, run
from exported import rows_of

SOURCE, PROGRAMS, SCAN, WORK = (pathlib.Path(word).resolve() for word in sys.argv[1:5])
PICTURE_ms, PICTURES_PER_S = 1500, 30
FOREIGN = "foreign.csv"


def make_folder(folder):
    folder.mkdir(parents=True)
    run(PROGRAMS / "trocar-mesh", SCAN / "dicom", "-o", folder / "sample.glb", "--surface", "--context", "2", "--quiet")
    for source, name, change in (("vertebra.json", "vertebra.json", {}), ("three_slices.json", "apart.json", {"z_m": 0.03})):
        scene = json.loads((SOURCE / "runtime" / "scenes" / source).read_text())
        scene |= {"asset": "sample.glb", "duration_s": 300}
        for i, placed in enumerate(scene.get("slices", [])):
            placed["z_m"] -= i * change["z_m"]
        (folder / name).write_text(json.dumps(scene))
    scene = json.loads((folder / "vertebra.json").read_text())  # another scene, of which only the recording is in the folder
    (folder.parent / "foreign.json").write_text(json.dumps(scene | {"asset": "folder/sample.glb", "duration_s": 8.4}))
    run(PROGRAMS / "trocar-run", folder.parent / "foreign.json", "--clock", "virtual", "--record", folder / FOREIGN, "--quiet")


def check_counts(name, folder, session):
    """The counts of the page, recording, summary and replay are the same."""
    recording = folder / session["recording"]
    flags = [int(row["xray"]) for row in rows_of(recording)]
    shots, beams = sum(flag & 1 for flag in flags), sum(flag >> 1 for flag in flags)
    check(shots == session["shots"], f"{name}: the page counts {session['shots']} shots, the recording has {shots}")
    check(abs(beams / 1000 - session["screening_s"]) < 1e-6, f"{name}: the page counts {session['screening_s']} s, the recording has {beams} ticks")
    summary = json.loads((recording.parent / "session.summary.json").read_text())
    check(summary["xray"] == {"shots": shots, "screening_s": beams / 1000}, f"{name}: the summary says {summary['xray']}")
    page = (recording.parent / "session.html").read_text()
    report = json.loads(re.search(r'<script type="application/json" id="report">(.*?)</script>', page, re.S)[1])
    check(report["xray"] == summary["xray"], f"{name}: the report does not say {summary['xray']}")
    again, said = WORK / f"{name}_again.csv", WORK / f"{name}_again.json"
    scene = folder / ("apart.json" if name == "apart" else "vertebra.json")
    run(PROGRAMS / "trocar-run", "replay", scene, recording, "--record", again, "--summary", said, "--quiet")
    check(again.read_bytes() == recording.read_bytes(), f"{name}: the replay differs")
    check(json.loads(said.read_text())["xray"] == summary["xray"], f"{name}: the replay counts {json.loads(said.read_text())['xray']}")
    print(f"{name}: {shots} shots, {beams / 1000} s; {summary['missed_deadlines']} missed deadlines, tick p99.9 {summary['tick_us']['p999']:.1f} us")
    return shots


def main():
    need_browser()
    shutil.rmtree(WORK, ignore_errors=True)
    folder = WORK / "folder"
    make_folder(folder)
    with page_of(PROGRAMS, folder, WORK) as (_, given):
        result = drive("drive_imaging.mjs", {**given, "scene": "vertebra.json", "apart": "apart.json", "foreign": FOREIGN})
    shots = {name: check_counts(name, folder, session) for name, session in result["sessions"].items()}
    check(shots.get("hundred") == 100 and shots.get("vertebra", 0) >= 5 and "apart" in shots, f"{shots}")
    figures = result["figures"]
    print(json.dumps(figures))
    if os.environ.get("TROCAR_JUDGE_TIMES"):
        for what in ("ap_ms", "lateral_ms"):
            check(figures[what] <= PICTURE_ms, f"{what}: {figures[what]:.0f} ms from the key to the picture")
        check(figures["pictures_per_s"] >= PICTURES_PER_S, f"{figures['pictures_per_s']:.1f} pictures a second")
    return outcome()


sys.exit(main())
