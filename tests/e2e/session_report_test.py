# SPDX-License-Identifier: Apache-2.0
"""Every figure of `trocar-run --session-report` computed again: session_figures.py computes them from recording and scene. Sessions: the paper's
three slices, the phantom's vertebra cut through, the same three slices with goals that are met, with goals that are broken and with a coupling, one
slice that is punctured in the tick in which it is reached, a session that ends by a fault, one with two faults and recoveries, one beside the
material and back in its hole, one through soft layers, and one of 90 s whose samples are thinned. A replay and a session in real time give what
their recordings say, too. The page embeds the same report and refers to nothing outside; rendered in a browser it shows the figures, and text of
the scene stays text.
"""
import html.parser
import json
import re
import subprocess

import numpy as np

from e2e import check
from exported import rows_of
from html_pages import check_self_contained, embedded_json, rendered, texts_of
from programs import run
from schemas_e2e_test import Schema, mutations, planted
from session_figures import expected, read_rows

CLOSE = 1e-9


def compare(where, want, got):
    """Every figure of `want`; `got` may also have words."""
    if isinstance(want, dict):
        check(isinstance(got, dict) and set(want) <= set(got), f"{where}: {str(got)[:200]}")
        for key in want if isinstance(got, dict) else ():
            if key in got:
                compare(f"{where}/{key}", want[key], got[key])
    elif isinstance(want, list):
        check(isinstance(got, list) and len(want) == len(got), f"{where}: {len(got)} entries, not {len(want)}: {str(got)[:300]}")
        for i, pair in enumerate(zip(want, got)):
            compare(f"{where}/{i}", *pair)
    elif isinstance(want, (bool, str)) or want is None:
        check(want == got, f"{where}: {got!r}, not {want!r}")
    elif got is None or isinstance(got, (str, bool)):
        check(False, f"{where}: {got!r}, not {want!r}")
    else:  # a difference of two lengths is as exact as they are, 0.1 m
        check(abs(want - got) <= CLOSE * max(abs(want), abs(got)) + 1e-15, f"{where}: {got!r}, not {want!r}")


def check_csv(name, report, file):
    """The CSV has every number and text of the figures but the samples, under its path."""
    def leaves(value, path=""):
        if isinstance(value, (dict, list)):
            for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
                yield from leaves(inner, f"{path}/{key}" if path else str(key))
        else:
            yield path, value
    want = {path: value for path, value in leaves({key: value for key, value in report.items() if key != "samples"})}
    got = {row["figure"]: row["value"] for row in rows_of(file)}
    empty = {path for path, text in got.items() if text == "" and path not in want}  # empty lists
    check(set(got) - empty == set(want), f"{name}: csv: {sorted(set(got) ^ set(want))[:5]}")
    for path, value in want.items():
        text = got.get(path, "")
        if isinstance(value, bool) or value is None:
            is_same = text == {True: "true", False: "false", None: ""}[value]
        elif isinstance(value, str):
            is_same = text in (value, "'" + value)
        else:
            is_same = float(text) == value
        check(is_same, f"{name}: csv: {path} is {text!r}, not {value!r}")


class Elements(html.parser.HTMLParser):
    """Tags and attributes of a rendered page."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.values, self.links = [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.values += [value or "" for _, value in attrs]
        self.links += [value for name, value in attrs if name in ("src", "href", "srcset", "action", "data") or name.startswith("on")]


class WholeRows(Schema):
    """Mistakes are made in the first items of lists of objects; a row of samples stays whole."""

    def check(self, what, document, part=None):
        for error in list(self.validator.iter_errors(document))[:3]:
            check(False, f"{what}: {error.json_path}: {error.message[:300]}")
        few = {key: value[:3] if isinstance(value, list) else value for key, value in document.items()}
        few["samples"] = {**document["samples"], "rows": document["samples"]["rows"][:3]}
        for reason, changed in (*planted(few, few), *mutations(few, self.tree)):
            kind = re.sub(r"/\d+", "/N", reason)
            if kind not in self.changes:
                self.changes.add(kind)
                check(not self.validator.is_valid(changed), f"{what}: accepted although {reason}")


class Sessions:
    def __init__(self, source, programs, asset, work):
        self.programs, self.asset, self.work = programs, asset, work
        self.schema = WholeRows(source, "session_report")
        info = json.loads(run(programs / "trocar-mesh", "info", "--json", asset).stdout)
        self.planes = [(each["index"], each["z_mm"]) for each in info["slices"]]

    def run(self, name, scene, *options, expect=0, clock="virtual", layer_punctures=None):
        made = self.work / f"{name}.json.scene"
        made.write_text(json.dumps(scene))
        meshes = self.work / f"{name}.meshes.json"
        page, record, summary = self.work / f"{name}.html", self.work / f"{name}.csv", self.work / f"{name}.summary.json"
        run(self.programs / "trocar-run", made, "--asset", self.asset, "--clock", clock, "--quiet", "--session-report", page,
            "--black-box", self.work, "--record", record, "--summary", summary, "--meshes", meshes, *options, expect=expect)
        report, summed = json.loads(page.with_suffix(".json").read_text()), json.loads(summary.read_text())
        rows = read_rows(record)
        found = layer_punctures(rows) if layer_punctures else ()
        compare(name, expected(scene, rows, self.planes, summed["rate_Hz"], json.loads(meshes.read_text()), report["plunge_max_m"], found), report)
        check(report["trainee"] == summed["trainee"], f"{name}: trainee: {report['trainee']}, summary: {summed['trainee']}")
        check_csv(name, report, page.with_suffix(".figures.csv"))
        self.schema.check(name, report)
        check(report["scene"] == scene["name"] and report["end"] == summed["end"] and report["ticks_lost"] == 0, f"{name}: {report['end']}")
        check(abs(report["force"]["max_N"] - summed["max_force_N"]) <= CLOSE * summed["max_force_N"], f"{name}: largest force")
        slices = [(each["slice"], each["t_s"]) for each in report["punctures"] if each["layer"] is None]
        check(slices == [(each["slice"], each["t_s"]) for each in summed["punctures"]], f"{name}: punctures are not the summary's")
        for each, other in zip((each for each in report["punctures"] if each["layer"] is None), summed["punctures"]):
            # the tool that the tissue acts on, also if a coupling holds it away from the plate
            check(each["tip_z_m"] == other["tool_z_m"], f"{name}: report and summary have other tips: {each}, {other}")
            if "front_z_m" not in rows:
                apart_m = abs(each["depth_m"] - other["penetration_m"])
                check(apart_m < CLOSE, f"{name}: report and summary differ by {apart_m} m: {each}, {other}")
            check(each["tip_N"] == other["tip_N"] and abs(each["hand_N"] - other["hand_N"]) <= CLOSE * other["hand_N"], f"{name}: {each}, {other}")
        found_s = list(rows["t_s"][rows["break_through_N"] > 0])
        check(found_s == [each["t_s"] for each in report["break_throughs"]], f"{name}: break-throughs of the rows and of the report: {found_s}")
        check([each["message"] for each in report["faults"]] == [each["message"] for each in summed["faults"]], f"{name}: messages of faults")
        check(report["walls"]["side_cuts_count"] == summed.get("cutting", {}).get("side_cuts", 0), f"{name}: side cuts")
        self.check_page(name, page, report)
        return report, rows

    def check_page(self, name, file, report):
        text = file.read_text()
        check_self_contained(name, text)
        check(embedded_json(text, "report") == report, f"{name}: the page embeds another report")
        page = rendered(file)
        if page is None:
            return
        elements = Elements(page)
        check(not elements.links and not set(elements.tags) & {"img", "iframe", "link", "object", "base"}, f"{name}: page holds {elements.links}")
        check(elements.tags.count("script") == 3, f"{name}: page: {elements.tags.count('script')} scripts")
        has_hu = any(row[5] not in (None, 0) and row[5] > -1000 for row in report["samples"]["rows"])
        check(elements.tags.count("svg") == 5 + has_hu and elements.tags.count("circle") >= 2 * len(report["punctures"]), f"{name}: page: pictures")
        check(not any(re.search("NaN|Infinity|undefined|null", value) for value in elements.values), f"{name}: page: numbers of pictures")
        words = " ".join(" ".join(texts_of(page)).split())
        check(report["scene"] in words and not re.search(r"\b(NaN|Infinity|undefined|null)\b", words), f"{name}: page: {words[:300]}")
        for goal in report["goals"]:
            value = "none" if goal["value"] is None else f"{goal['value'] * 1e3:.2f} mm" if goal["unit"] == "m" else f"{goal['value']:.2f}"
            check(value in words, f"{name}: page lacks {goal['goal']} {value}")
        of_breaks = {(each["t_s"], each["layer"], each["slice"]) for each in report["break_throughs"]}
        for each in (each for each in report["punctures"] if (each["t_s"], each["layer"], each["slice"]) in of_breaks):
            check(f"{each['hand_N']:.2f} N" in words and f"{each['t_s']:.3f} s" in words, f"{name}: page lacks {each}")
        for each in report["break_throughs"]:
            check(f"{each['plunge_m'] * 1e3:.2f} mm" in words and f"{each['tip_N']:.2f} N" in words, f"{name}: page lacks {each}")
        integral, attempts = f"{report['force']['time_integral_N_s']:.2f} N s", f"{report['attempts']['count']}, {report['attempts']['reentries']}"
        check(integral in words and attempts in words, f"{name}: page lacks {integral} or {attempts}")
        final = report["walls"]["final"]
        check((f"Grade: {final['grade_is']}." if final else "there is no grade") in words, f"{name}: page lacks the grade of {final}")
        for known in ("10.52198/21.sti.38.os1365", "PMID 27085361", "RAPM 44:298", "PMC7882829", "no published validation known"):
            check(known in words, f"{name}: page lacks {known}")
        code = (report["trainee"] or {}).get("code")
        check(code is None or f"Trainee {code}" in words, f"{name}: page lacks {code}")
        for each in report["faults"]:
            check(" ".join(each["message"].split()) in words, f"{name}: page lacks {each}")
        for each in report["zones"]:
            check(each["name"] in words and f"{each['min_m'] * 1e3:.2f} mm" in words, f"{name}: page lacks {each}")


def descent(scene, *points, **fields):
    return {**scene, **fields, "hand": {**scene["hand"], "trajectory": [{"t_s": p[0], "tip_m": list(p[1:4])} for p in points]}}


def soft_layers(scene):
    """Two layers over the body, far apart, so that each is punctured on its own. At 5 kHz the rigid tool is passive in the bone below."""
    law = dict(scene["force_law"], axis="rigid")
    layers = [{"name": "skin <&\"'>", "top_z_m": 0.18, "thickness_m": 0.002, "stiffness_N_per_m": 400, "stiffening_N_per_m2": 50000,
               "puncture_N": 3, "cutting_N": 0.5},
              {"name": "fascia", "top_z_m": 0.168, "thickness_m": 0.001, "stiffness_N_per_m": 1000, "puncture_N": 4, "cutting_N": 0.2}]
    points = ((0, 0, 0, 0.185), (0.1, 0, 0, 0.185), (3.5, 0, 0, 0.1585), (3.8, 0, 0, 0.1585))
    return descent({**scene, "layers": layers, "force_law": law, "duration_s": 3.8, "rate_Hz": 5000}, *points)


def layer_rows(scene):
    """Of a rigid tool: a layer is punctured in the first tick in which its spring, without it, would exceed the puncture force."""
    def find(rows):
        found = []
        for layer in scene["layers"]:
            z = layer["top_z_m"] - rows["tool_z_m"]
            spring = np.where(z > 0, layer.get("stiffness_N_per_m", 0) * z + layer.get("stiffening_N_per_m2", 0) * z**2, 0)
            found.append((int(np.flatnonzero(spring > layer["puncture_N"])[0]), layer["name"]))
        return found
    return find


def goals(broken):
    """Of the three slices, along z at x = y = 0 from 0.202 to 0.088 m."""
    ring = [[0.002, -0.01], [0.02, -0.01], [0.02, 0.01], [0.008, 0], [0.002, 0.01]]
    zones = [{"name": "canal", "margin_m": 0.0015, "prism": {"outline_m": ring, "z_m": [0.09, 0.18]}},
             {"name": "vessel", "margin_m": 0.001, "capsule": {"from_m": [0.01, 0.02, 0.1], "to_m": [0.01, -0.02, 0.2], "radius_m": 0.004}},
             {"name": "lung", "box": {"min_m": [-0.05, -0.05, 0.02], "max_m": [0.05, 0.05, 0.08]}}]
    made = {"target": {"at_m": [0, 0, 0.1], "radius_m": 0.003}, "force_max_N": 60, "time_max_s": 8, "plunge_max_m": 0.02,
            "line": {"entry_m": [0.0005, 0, 0.195], "entry_radius_m": 0.002, "corridor_m": 0.003}, "zones": zones}
    if not broken:
        return made
    made.update({"target": {"at_m": [0.03, 0, 0.11], "radius_m": 0.001}, "force_max_N": 20, "time_max_s": 1, "plunge_max_m": 0.0005,
                 "line": {"entry_m": [0.004, 0.003, 0.195], "direction": [0.1, 0.2, -1], "entry_radius_m": 0.002, "corridor_m": 0.003}})
    made["zones"] = [{"name": "canal <b>", "prism": {"outline_m": [[x - 0.007, y] for x, y in ring], "z_m": [0.12, 0.16]}},
                     {"name": "vessel", "capsule": {"from_m": [0.002, 0.02, 0.15], "to_m": [0.002, -0.02, 0.15], "radius_m": 0.004}},
                     {"name": "lung", "box": {"min_m": [-0.05, -0.05, 0.02], "max_m": [0.05, 0.05, 0.11]}}]
    return made


def check_unreachable_target(sessions, scene):
    made, trocar_run = sessions.work / "options.json.scene", sessions.programs / "trocar-run"
    far = {**scene, "goals": {"target": {"at_m": [0.3, 0, 0.1], "radius_m": 0.003}}}
    made.write_text(json.dumps(far))
    done = subprocess.run([str(word) for word in (trocar_run, "check", made, "--asset", sessions.asset, "--strict")], capture_output=True, text=True, check=False)
    check(done.returncode == 3 and "the target at (0.3000, 0.0000, 0.1000) m cannot be reached" in done.stderr, f"target: {done}")


def test_session_report(source, programs, asset, work):
    sessions = Sessions(source, programs, asset, work)
    scenes = {path.stem: json.loads(path.read_text()) for path in (source / "runtime" / "scenes").glob("*.json")}
    three = scenes["three_slices"]

    report, _ = sessions.run("three", three)
    check(report["punctures_count"] == 3 and report["break_throughs_count"] == 3 and report["goals"] == [], "three: too little happened")
    who = ("--trainee", "A-17", "--course", "spine_2026", "--attempt", "3")
    report, _ = sessions.run("met", {**three, "goals": goals(False)}, *who)
    check(report["trainee"] == {"code": "A-17", "course": "spine_2026", "attempt": 3}, f"met: {report['trainee']}")
    check(report["goals_met"] == len(report["goals"]) == 9, f"met: {report['goals']}")
    report, _ = sessions.run("broken", {**three, "name": "<script>alert(1)</script> & 'x'", "goals": goals(True)})
    check(report["goals_met"] == 0 and len(report["goals"]) == 9, f"broken: {report['goals']}")
    check(all(zone["breaches_count"] > 0 for zone in report["zones"]), f"broken: {report['zones']}")
    check("<script>alert" not in (work / "broken.html").read_text(), "not escaped")
    page = rendered(work / "broken.html")
    check(page is None or "canal &lt;b&gt;" in page and "&lt;script&gt;alert(1)" in page, "not text in the rendered page")
    report, _ = sessions.run("vertebra", scenes["vertebra"])
    check(report["punctures_count"] >= 20 and report["path"]["straightness"] > 0.9, "vertebra: too little happened")
    sessions.run("network", scenes["network_rim"])
    report, _ = sessions.run("coupled", three, "--coupling", "5000")
    released_m = [each["release_m"] for each in report["break_throughs"]]
    check(len(released_m) >= 2 and all(abs(each - 0.007) < 5e-4 for each in released_m), f"coupled: 35 N relax by {released_m} m")
    # A slice that breaks 20 um deep, and a tip that moves by 0.3 mm in a tick.
    thin = {"tissue": {"stiffness_N_per_m": 500, "threshold_N": 0.01}, "goals": {"time_max_s": 1}, "duration_s": 0.6}
    report, _ = sessions.run("at_once", descent(scenes["one_slice"], (0, 0, 0, 0.132), (0.4, 0, 0, 0.108), **thin), "--rate", "200")
    check([each["t_s"] for each in report["punctures"]] == [report["time"]["first_contact_s"]] and report["time"]["contact_s"] == 0 and
          report["path"]["straightness"] is not None and report["goals_met"] == 1, f"at once: {report['time']}, {report['goals']}")
    grades = {}
    for x_mm in (0, 18, 20, 22):
        moved = [(p["t_s"], p["tip_m"][0] + x_mm / 1e3, p["tip_m"][1], max(p["tip_m"][2], 0.13)) for p in scenes["vertebra"]["hand"]["trajectory"]]
        report, _ = sessions.run(f"wall_{x_mm}", descent(scenes["vertebra"], *moved))
        grades[x_mm] = report["walls"]["final"] and report["walls"]["final"]["grade"]
    check(grades[0] == 0 and {1, 2} <= set(grades.values()), f"wall: {grades}")
    away = [(0, 0, 0, 0.13), (0.8, 0, 0, 0.109), (1.2, 0.09, 0, 0.13), (2.4, 0, 0, 0.13), (4.2, 0, 0, 0.13), (5.0, 0, 0, 0.108)]
    report, _ = sessions.run("fault", descent(scenes["one_slice"], *away, duration_s=3), expect=5)
    check(report["faults_count"] == 1 and report["faults"][0]["recovered_t_s"] is None and report["time"]["stopped_s"] > 0,
          f"fault: {report['faults']}")
    report, _ = sessions.run("recovered", descent(scenes["one_slice"], *away, duration_s=5), "--recover", "auto")
    check(report["faults_count"] >= 1 and report["faults"][0]["recovered_t_s"] is not None, f"recovered: {report['faults']}")
    hole = [(0, 0, 0, 0.124), (0.1, 0, 0, 0.124), (2, 0, 0, 0.1), (2.5, 0, 0, 0.13), (3, 0.0005, 0, 0.13), (3.5, 0.0005, 0, 0.11), (4, 0, 0, 0.13),
            (4.5, 0.029, -0.002, 0.13), (5, 0.029, -0.002, 0.112), (5.5, 0.029, -0.002, 0.13)]
    report, _ = sessions.run("beside", descent({**scenes["one_slice"], "hand": three["hand"]}, *hole, duration_s=5.6))
    check(report["walls"]["beside_count"] >= 1, f"beside: {report['walls']}")
    twice = [(0, 0, 0, 0.124), (0.1, 0, 0, 0.124), (1.5, 0, 0, 0.1), (2.2, 0, 0, 0.13), (2.8, 0.012, 0, 0.13), (4.2, 0.012, 0, 0.1), (5, 0.012, 0, 0.13)]
    report, _ = sessions.run("twice", descent({**scenes["one_slice"], "hand": three["hand"]}, *twice, duration_s=5))
    check(report["attempts"]["reentries"] == 1, f"twice: {report['attempts']}")
    layered = soft_layers(scenes["vertebra"])
    report, _ = sessions.run("layers", layered, layer_punctures=layer_rows(layered))
    check([each["layer"] for each in report["punctures"]] == [layer["name"] for layer in layered["layers"]], f"layers: {report['punctures']}")
    tilted = [(0, 0, 0, 0.162), (0.2, 0, 0, 0.162), (3, 0, 0, 0.13), (4, 0.012, 0.008, 0.13), (6, 0, 0, 0.162)]
    weak = json.loads(json.dumps(scenes["vertebra"]))
    weak["tissue"]["cut"].update(lateral_strength_MPa=0.3)
    report, _ = sessions.run("walls", descent(weak, *tilted, duration_s=6))
    check(report["walls"]["side_cuts_count"] > 0, f"walls: {report['walls']}")
    long = [(0, 0, 0, 0.124), (1, 0, 0, 0.124), (60, 0, 0, 0.1), (89, 0, 0, 0.13)]
    report, _ = sessions.run("long", descent({**scenes["one_slice"], "hand": three["hand"]}, *long, duration_s=90), "--rate", "500")
    check(report["samples"]["stride"] > 8, f"long: {report['samples']['stride']}")

    made = work / "met.json.scene"
    run(programs / "trocar-run", "replay", made, "--asset", asset, "--quiet", work / "met.csv", "--session-report", work / "again.html")
    for kind in ("html", "json"):
        check((work / f"again.{kind}").read_bytes() == (work / f"met.{kind}").read_bytes(), f"a replay's {kind} differs")
    sessions.run("real", descent(scenes["one_slice"], (0, 0, 0, 0.125), (0.6, 0, 0, 0.11), duration_s=0.8), clock="real")
    check_unreachable_target(sessions, three)
