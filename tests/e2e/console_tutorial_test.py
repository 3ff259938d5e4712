# SPDX-License-Identifier: Apache-2.0
"""console_tutorial_test.py SOURCE PROGRAMS WORK: TUTORIAL.md's step in the console, in a headless Chromium (console/drive_tutorial.mjs), with
the asset and the scene of the tutorial. It leaves the step's pictures in WORK/pictures; copied to scripts/plots they are the tutorial's."""
import json
import pathlib
import re
import shutil
import sys

from chromium_page import drive, need_browser, page_of
from e2e import outcome
from programs import HEAD_CT, run

SOURCE, PROGRAMS, WORK = (pathlib.Path(word).resolve() for word in sys.argv[1:4])


def main():
    need_browser()
    if not HEAD_CT.is_file():
        print("skipped: TROCAR_HEAD_CT does not name the head CT (scripts/head-ct head.nii.gz fetches it)")
        return 77
    text = (SOURCE / "TUTORIAL.md").read_text(encoding="utf-8")
    folder = WORK / "folder"
    shutil.rmtree(WORK, ignore_errors=True)
    folder.mkdir(parents=True)
    words = re.search(r"^trocar-mesh head\.nii\.gz (.*) -o head\.glb$", text[text.index("## 3."):], re.M)[1].split()
    run(PROGRAMS / "trocar-mesh", HEAD_CT, *words, "-o", folder / "head.glb", "--quiet")
    scene = re.search(r"^```json puncture\.json\n(.*?)^```$", text, re.M | re.S)[1]
    (folder / "puncture.json").write_text(scene, encoding="utf-8")
    stay = json.loads(scene) | {"name": "The tool stays above the bone", "duration_s": 600}
    stay["hand"]["trajectory"] = stay["hand"]["trajectory"][:2]
    (folder / "stay.json").write_text(json.dumps(stay), encoding="utf-8")
    with page_of(PROGRAMS, folder, WORK) as (_, given):
        drive("drive_tutorial.mjs", given)
    return outcome()


sys.exit(main())
