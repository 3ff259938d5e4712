# SPDX-License-Identifier: Apache-2.0
"""console_training_page_test.py SOURCE PROGRAMS ASSET WORK: the trainee of a session, live goals, verdict, history and ghost in the console's
page, in a headless Chromium (console/drive_training.mjs). The verdict of the page is compared with the session report's, and what the page
has seen of a recording with the report's values."""
import json
import math
import pathlib
import sys

from chromium_page import drive, need_browser, page_of
from console_server_test import make_folder
from e2e import check, outcome
from exported import rows_of
from html_pages import embedded_json
from session_report_test import goals

SOURCE, PROGRAMS, ASSET, WORK = (pathlib.Path(word).resolve() for word in sys.argv[1:5])


def make_scenes(folder):
    scene = json.loads((folder / "scenes/three_slices.json").read_text(encoding="utf-8"))
    for name, is_broken in (("met", False), ("broken", True)):
        scene |= {"name": name, "goals": goals(is_broken)}
        (folder / f"scenes/{name}.json").write_text(json.dumps(scene), encoding="utf-8")


def check_goals(folder, scene, shown, recording):
    """`shown`: what the page showed of one scene: live, and in the middle, at the end and after going back in playback."""
    report = json.loads((folder / recording).with_suffix(".json").read_text())
    for when in ("live", "playback"):
        for goal, row in zip(report["goals"], shown[when]["list"]):
            check((row["goal"], row["zone"], row["state"] == "met") == (goal["goal"], goal["zone"], goal["met"]), f"{scene} {when}: {row}, the report: {goal}")
            check(row["value"] == goal["value"], f"{scene} {when}: {row}, the report: {goal}")
        check(len(shown[when]["list"]) == len(report["goals"]) and f"{report['goals_met']} of {len(report['goals'])} goals met" in shown[when]["verdict"],
              f"{scene} {when}: {shown[when]['verdict']}")
    for goal, row in zip(report["goals"], shown["playback"]["seen"]):  # computed in the page from all rows of the recording
        if goal["goal"] == "plunge":
            continue
        if goal["value"] is None:
            check(row["value"] is None, f"{scene}: {row}, the report: {goal}")
        else:
            check(row["value"] is not None and math.isclose(row["value"], goal["value"], rel_tol=1e-9, abs_tol=1e-12), f"{scene}: {row}, the report: {goal}")
        is_met = row["state"] in ("met", "kept")
        check(is_met == goal["met"], f"{scene}: {row}, the report: {goal}")
    for when in ("middle", "back"):
        check(shown[when]["verdict"].startswith("Goals so far") and len(shown[when]["list"]) == len(report["goals"]), f"{scene} {when}: {shown[when]}")
        check(all(row["words"] and "NaN" not in row["words"] for row in shown[when]["list"]), f"{scene} {when}: {shown[when]}")
    target = {when: next(row["value"] for row in shown[when]["list"] if row["goal"] == "target") for when in ("middle", "back")}
    check(target["back"] > target["middle"], f"{scene}: going back does not forget what came later: {target}")


def check_session(folder, recording, attempt):
    origin = rows_of(folder / recording)[0]["origin"]
    check(f"trainee=A-17;course=spine_2026;attempt={attempt}" in origin, f"{recording}: {origin}")
    report = json.loads((folder / recording).with_suffix(".json").read_text())
    check(report["trainee"] == {"code": "A-17", "course": "spine_2026", "attempt": attempt}, f"{recording}: {report['trainee']}")


def main():
    need_browser()
    folder = make_folder(SOURCE, ASSET, WORK)
    make_scenes(folder)
    with page_of(PROGRAMS, folder, WORK) as (console, given):
        check(console.get("/api/history")[0] == 404, "a history without sessions")
        for said in ({"trainee": "Jane Doe"}, {"trainee": "x" * 33}, {"trainee": ""}, {"course": "../x"}, {"attempt": 0}, {"attempt": 1.5}, {"attempt": "1"}, {"attempt": 10000}, {"trainee": 7}):
            status, answer = console.post("/api/start", {"scene": "scenes/met.json", **said})
            check(status == 400 and next(iter(said)) in answer["error"], f"{said}: {status} {answer}")
        result = drive("drive_training.mjs", given)
        for attempt, (scene, recording) in enumerate(result["sessions"].items(), 1):
            check_goals(folder, scene, result["goals"][scene], recording)
            check_session(folder, recording, attempt)
        for token in (console.token, console.view):
            status, page = console.request("GET", "/api/history", token=token, raw=True)
            check(status == 200 and "sandbox" in console.headers["Content-Security-Policy"], f"history: {status}")
            history = embedded_json(page.decode(), "history")
            check(sorted(each["attempt"] for series in history["series"] for each in series["sessions"]) == [1, 2, 3] and not history["skipped"], f"history: {history['series']}, {history['skipped']}")
        check(console.get("/api/history", token=None)[0] == 401, "a history without a token")
    return outcome()


sys.exit(main())
