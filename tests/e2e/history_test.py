# SPDX-License-Identifier: Apache-2.0
"""`trocar-run history` over 50 short sessions of two trainees, damaged and foreign files among them. The order and each figure are compared with the
sessions' own reports; the page is rendered in a browser, and has a point for each session in each curve. (What origins and replays say of the
trainee: trainee_test, console_pages_test.py.)"""
import json
import os
import re
import shutil
import subprocess

from e2e import check
from exported import rows_of
from html_pages import check_self_contained, embedded_json, rendered, texts_of
from programs import PROGRAMS, SOURCE, run
from schemas_e2e_test import Schema

SESSIONS, ATTEMPTS = 50, 25
KEYS = {"goals_met": "/goals_met", "total_s": "/time/total_s", "contact_to_last_puncture_s": "/time/contact_to_last_puncture_s", "path_m": "/path/length_m",
        "reentries": "/attempts/reentries", "xray_shots": "/xray/shots", "xray_s": "/xray/screening_s", "force_max_N": "/force/max_N", "force_time_N_s": "/force/time_integral_N_s", "plunge_max_m": "/plunge_max_m",
        "wall_outside_m": "/walls/final/outside_m", "target_m": "/target/closest_m", "faults": "/faults_count"}


def at(document, pointer):
    for key in pointer.split("/")[1:]:
        document = None if document is None else document[key]
    return document


def expected_figures(report):
    made = {name: at(report, pointer) for name, pointer in KEYS.items()}
    made["zone_entries"] = sum(zone["breaches_count"] for zone in report["zones"]) if report["zones"] else None
    if not report["goals"]:
        made["goals_met"] = None
    return made


def make_sessions(asset, folder):
    """{file: report} of 50 sessions. The attempts of each trainee are run in an order that is not theirs."""
    scene = json.loads((SOURCE / "runtime" / "scenes" / "one_slice.json").read_text())
    scene["goals"] = {"force_max_N": 30, "target": {"at_m": [0, 0, 0.11], "radius_m": 0.004}}
    made = {}
    for i in range(SESSIONS):
        trainee, attempt = ("A-17", "B_02")[i % 2], (i * 7 // 2) % ATTEMPTS + 1 if i % 2 else ATTEMPTS - i // 2
        low_m = 0.117 - 0.0002 * attempt
        scene["hand"]["trajectory"] = [{"t_s": 0, "tip_m": [0, 0, 0.123]}, {"t_s": 0.3, "tip_m": [0, 0, low_m]}]
        file = folder / f"{i:02}" / "session.html"
        file.parent.mkdir(parents=True)
        (folder / "scene.scene").write_text(json.dumps(scene))
        run(PROGRAMS / "trocar-run", folder / "scene.scene", "--asset", asset, "--clock", "virtual", "--quiet", "--duration", "0.4", "--session-report", file,
            "--summary", file.with_suffix(".summary.json"), "--trainee", trainee, "--course", "spine_2026", "--attempt", str(attempt))
        name = f"{i:02}/session.json"
        made[name] = json.loads(file.with_suffix(".json").read_text())
        check(made[name]["trainee"] == {"code": trainee, "course": "spine_2026", "attempt": attempt}, f"{name}: {made[name]['trainee']}")
        os.utime(folder / name, (1.6e9 + 1000 * (SESSIONS - i),) * 2)
    return made


def spoil(folder, good):
    """Files that are no sessions. {name: words of the line that says why}."""
    text = json.dumps(good)
    wrong = {"cut.json": text[:2000], "empty.json": "", "scene.json": '{"schema": "trocar.scene/1"}', "list.json": "[1, 2]", "deep.json": "[" * 100000,
             "text.json": json.dumps({**good, "force": {"max_N": "12"}}), "huge.json": json.dumps({**good, "plunge_max_m": 1e300}), "scene2.json": json.dumps({**good, "scene": 5}),
             "code.json": json.dumps({**good, "trainee": {"code": "../x", "course": None, "attempt": 1}}), "bytes.json": None,
             "attempt.json": json.dumps({**good, "trainee": {"code": "A", "course": None, "attempt": 0}}),
             "half.json": json.dumps({**good, "trainee": {"code": "A", "course": None, "attempt": 1.5}}), "lines\n<b>.json": "{",
             "killed.csv.partial": "t_s,x_m\n0,0\n0.001"}
    for name, words in wrong.items():
        if words is None:
            (folder / name).write_bytes(bytes(range(256)))
        else:
            (folder / name).write_text(words)
    (folder / "loop").symlink_to(folder)
    (folder / "link.json").symlink_to(folder / "00" / "session.json")
    (folder / "fifo").mkdir()
    os.mkfifo(folder / "fifo" / "pipe.json")
    return wrong


def check_history(name, history, made, extra):
    """Each series has its sessions in the order of attempts, with the figures of their reports."""
    found = {session["file"]: (series, session) for series in history["series"] for session in series["sessions"]}
    check(set(found) == set(made) | extra, f"{name}: {sorted(set(found) ^ (set(made) | extra))}")
    for file, report in made.items():
        if file not in found:
            continue
        series, session = found[file]
        check((series["trainee"], series["course"], session["attempt"]) == tuple(report["trainee"][key] for key in ("code", "course", "attempt")), f"{name}: {file}: {series['trainee']}")
        check(session["figures"] == expected_figures(report), f"{name}: {file}: {session['figures']}, not {expected_figures(report)}")
        check(session["goals"] == (len(report["goals"]) or None), f"{name}: {file}: goals")
    for series in history["series"]:
        order = [(10**6 if session["attempt"] is None else session["attempt"], session["time"]) for session in series["sessions"]]
        check(order == sorted(order), f"{name}: {series['trainee']}: order {order}")


def check_page(name, file, history):
    check_self_contained(name, file.read_text())
    page = rendered(file)
    if page is None:
        return
    points = sum(1 for series in history["series"] for session in series["sessions"] for value in session["figures"].values() if value is not None)
    check(page.count("<circle") == points, f"{name}: {page.count('<circle')} points, not {points}")
    words = " ".join(texts_of(page))
    check(not re.search(r"\b(NaN|Infinity|undefined|null)\b", words.partition("Files that were skipped")[0]), f"{name}: {words[:300]}")
    for wanted in ("Trainee A-17, course spine_2026", "Trainee B_02", "force-time integral, N s", "Files that were skipped"):
        check(wanted in words, f"{name}: the page lacks {wanted}")
    check("<b>.json" not in re.sub(r"<script.*?</script>", "", page, flags=re.S), f"{name}: a file's name became HTML")


def test_history(asset, work):
    folder = work / "sessions"
    folder.mkdir()
    made = make_sessions(asset, folder)
    wrong = spoil(folder, made["00/session.json"])
    (folder / "only").mkdir()  # a summary without a report
    alone = json.loads((folder / "03" / "session.summary.json").read_text())
    alone.update({"faults": [{"fault": fault} for fault in ("paused", "link_lost", "forces_off", "paused")], "faults_count": 4})
    (folder / "only" / "summary.json").write_text(json.dumps(alone))

    (folder / "device-test").mkdir()  # of the console: no session, and nothing that was skipped
    (folder / "device-test" / "test.json").write_text('{"schema": "trocar.device-test/1"}')

    page = work / "history.html"
    done = subprocess.run([PROGRAMS / "trocar-run", "history", folder, "-o", page], capture_output=True, text=True, check=True)
    skipped = done.stderr.splitlines()
    check(len(skipped) == len(wrong) and all(line.startswith("trocar-run: skipped: ") for line in skipped), f"skipped: {done.stderr}")
    for name in wrong:
        check(sum(name.replace("\n", "?") in line for line in skipped) == 1, f"{name} is not named once: {skipped}")
    history = embedded_json(page.read_text(), "history")
    Schema(SOURCE, "history").check("history", history)
    check_history("history", history, made, {"only/summary.json"})
    summary = json.loads((folder / "only" / "summary.json").read_text())
    alone = next(session for series in history["series"] for session in series["sessions"] if session["file"] == "only/summary.json")
    check(alone["figures"]["force_max_N"] == summary["max_force_N"] and alone["figures"]["path_m"] is None and alone["figures"]["total_s"] == summary["ticks"] / summary["rate_Hz"], f"summary: {alone}")
    check(alone["figures"]["faults"] == 1, f"pauses are no faults: {alone}")
    check_page("history", page, history)
    table = rows_of(page.with_suffix(".history.csv"))
    check(len(table) == SESSIONS + 1, f"csv: {len(table)} lines")
    for row in table:
        report = made.get(row["file"])
        for figure, value in (expected_figures(report) if report else {}).items():
            check((None if row[figure] == "" else float(row[figure])) == value, f"csv: {row['file']}: {figure} is {row[figure]}, not {value}")
    check(sum(re.match(r" *\d+  \d{4}-", line) is not None for line in done.stdout.splitlines()) == SESSIONS + 1, f"table: {done.stdout[:500]}")
    again = work / "again_history.html"
    run(PROGRAMS / "trocar-run", "history", folder, "-o", again, "--quiet")
    check(again.read_bytes() == page.read_bytes(), "a second history differs")
    deep = work / "deep"
    deep.joinpath(*"abcdefg").mkdir(parents=True)
    shutil.copy(next(folder.glob("*/session.json")), deep / "session.json")
    few = subprocess.run(["prlimit", "--nofile=8", PROGRAMS / "trocar-run", "history", deep, "-o", work / "deep.html"], capture_output=True, text=True, check=False)
    named = re.search(r"not all of its folders can be read, (a[b-g/]*) or what follows it: Too many open files", few.stderr)
    check(few.returncode == 3 and named is not None and deep.joinpath(named[1]).is_dir() and not (work / "deep.html").exists(),
          f"folders that cannot be read: {few}")
