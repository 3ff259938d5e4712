# SPDX-License-Identifier: Apache-2.0
"""The cutting law: speed against error of a tick, and its forces beside published ones.

Measured by the programs cutting_sweep and cutting_sweep_midpoint, which are one program with two Gauss points and with one
for the walls of each slab. Also writes cutting_pareto.csv, cutting_stability.csv and cutting_forces.csv beside the page."""
import csv
import json
import pathlib
import subprocess

import cutting_plots as plots

TITLE = "Cutting: speed, error and published forces"
ORDER = 55


def plan(context):
    return {"slabs": [8, 16, 32, 64, 128], "reference_slabs": 512, "most_steps": [1, 2, 3, 5, 8, 12],
            "stability": {"sessions": 100 if context.full else 30, "damping": [0, 0.25, 0.5, 0.75, 0.9, 1, 1.25, 1.5, 2],
                          "ratio": [0.01, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.67, 0.8, 1, 1.5, 2]},
            "ticks": 12000 if context.full else 2000, "repetitions": 4 if context.full else 3}


def measure(context):
    def run(program):
        done = subprocess.run([program], input=json.dumps(plan(context)), text=True, stdout=subprocess.PIPE, check=True)
        return json.loads(done.stdout)

    data = run(context.programs / "cutting_sweep")
    data["pareto"] += run(context.programs / "cutting_sweep_midpoint")["pareto"]
    folder = context.scratch.parent
    write_csv(data["pareto"], folder / "cutting_pareto.csv")
    write_csv(data["published_forces"]["rows"], folder / "cutting_forces.csv")
    data["published_forces"]["commit"] = commit_of_law()
    write_csv(data["stability"], folder / "cutting_stability.csv")
    return data


def write_csv(rows, path):
    with open(path, "w", newline="", encoding="utf-8") as file:
        out = csv.DictWriter(file, fieldnames=list(rows[0]))
        out.writeheader()
        out.writerows(rows)


LAW = ("tests/bench/published_forces.json", "tests/bench/published_forces.cpp", "runtime/bone_cutting/material")


def commit_of_law():
    """The last commit that changed the law, its constants or the inputs of the predictions; empty without a repository."""
    root = pathlib.Path(__file__).resolve().parents[4]
    done = subprocess.run(["git", "-C", root, "log", "-1", "--format=%h of %cs", "--", *LAW], text=True, capture_output=True, check=False)
    return done.stdout.strip()


def verdict(row):
    result = "hit" if row["is_hit"] else "missed"
    return result if row["standing"] == "counted" else f"{result}, {row['standing']}"


def number(value):
    return f"{value:.3g}"


def ranged(row, kind, middle):
    return f"{number(middle)} ({number(row[kind + '_low'])} to {number(row[kind + '_high'])})"


def score(parts):
    return ", ".join(f"{each['name']} {each['hits']} of {each['rows']}" for each in parts)


def show(data, page):
    rows, table = data["pareto"], data["published_forces"]
    default = next(row for row in rows if row["setting"] == "Newton steps" and row["value"] == 12 and row["points_a_slab"] == 2)
    page.text_block(f"With 64 slabs that the shaft fills and at most 12 Newton steps a tick takes {default['p50_us']:.1f} \N{MICRO SIGN}s "
                    f"(99.9 %: {default['p999_us']:.1f} \N{MICRO SIGN}s) and errs by {default['error_max']:.1g} of the peak force at worst.", verdict=True)
    page.plot(plots.pareto(rows), "Error against time. Left and middle: a push of 25 mm and then a sway in the hole, with fewer slabs against 512 "
              "converged ones. Strength is linear in a slab. Two Gauss points are exact for a slab that the "
              "shaft fills, which tells with few slabs; with more, the slab that it fills in part dominates and one point would do. Right: each tick of a tool that is pushed, dragged and turned, against a converged tick from the same state. "
              "Times are the least of some repetitions.")
    page.table(("setting", "value", "Gauss points a slab", "p50 \N{MICRO SIGN}s", "p99.9 \N{MICRO SIGN}s", "error, r.m.s.", "across, r.m.s.", "worst"),
               [(r["setting"], r["value"], r["points_a_slab"], r["p50_us"], r["p999_us"], r["error_rms"], r["side_error_rms"], r["error_max"])
                for r in rows], folded="all figures")
    page.heading("Stability")
    page.plot(plots.stability(data["stability"]), "The most energy that the tissue gave to a simulated hand, of random bodies and hands in one dimension; at the lower "
              "edge it gave none. Left, at K T\N{SUPERSCRIPT TWO} / M = 0.1: a device whose own damping is K T / 2 takes what holding the force for a tick leaks. Right: a device "
              "without damping.")
    page.heading("Published forces")
    counted = [row for row in table["rows"] if row["standing"] == "counted"]
    studies = table["by_study"]
    page.text_block(f"{sum(row['is_hit'] for row in counted)} of {len(counted)} counted rows are hits, and "
                    f"{sum(2 * each['hits'] > each['rows'] for each in studies)} of {len(studies)} studies hit in most of their rows. By mechanism: "
                    f"{score(table['by_mechanism'])}. By study: {score(studies)}.", verdict=True)
    page.text_block(f"Law, constants and inputs are those of the commit {table['commit'] or '(no repository)'}. One constant is fitted, on the row that says so: the wall "
                    f"presses on a shaft with {table['wall_pressure']:.2f} of the pressure under the tip. A hit overlaps the published range with its 5 to 95 % band, and its "
                    "median is within a factor of 1.5 of the mean. No full paper was read, and whoever chose the laws had seen the measured values, so this is not blind.")
    page.plot(plots.published_forces(table["rows"]), "Predicted against published forces.")
    page.table(("row", "by the law (5 to 95 %)", "published (range)", "", "ratio", "ratio, others fitted", "likely reason of a miss", "mechanism", "tool", "specimen",
                "assumed", "spread", "evidence", "source"),
               [(r["id"], ranged(r, "predicted", r["predicted"]), ranged(r, "published", r["published_mean"]), verdict(r), number(r["predicted"] / r["published_mean"]),
                 "" if r["left_one_out"] is None else number(r["left_one_out"]), "" if r["is_hit"] else r["miss"] or "not known", r["mechanism"], r["tool"], r["specimen"],
                 r["assumed"], r["spread"], r["evidence"], r["source"]) for r in table["rows"]])


def results(data):
    rows = data["published_forces"]["rows"]
    lines = ["| row | by the law (5 to 95 %) | published (range) | unit | | source |", "| --- | --- | --- | --- | --- | --- |"]
    lines += [f"| {r['id']} | {ranged(r, 'predicted', r['predicted'])} | {ranged(r, 'published', r['published_mean'])} | {r['unit']} | {verdict(r)} | {r['source']} |" for r in rows]
    return lines
