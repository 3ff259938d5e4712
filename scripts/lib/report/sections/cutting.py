# SPDX-License-Identifier: Apache-2.0
"""The cutting law: speed against error of a tick, and named procedures beside published forces.

Measured by the programs cutting_sweep and cutting_sweep_midpoint, which are one program with two Gauss points and with one
for the walls of each slab. Also writes cutting_pareto.csv, cutting_stability.csv and cutting_procedures.csv beside the page."""
import csv
import json
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
    write_csv(data["procedures"]["rows"], folder / "cutting_procedures.csv")
    write_csv(data["stability"], folder / "cutting_stability.csv")
    return data


def write_csv(rows, path):
    with open(path, "w", newline="", encoding="utf-8") as file:
        out = csv.DictWriter(file, fieldnames=list(rows[0]))
        out.writeheader()
        out.writerows(rows)


def published(row):
    low, high = row["published_low"], row["published_high"]
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def verdict(row):
    return row["standing"] if row["standing"] != "predicted" else "within" if row["is_hit"] else "missed"


def show(data, page):
    rows, table = data["pareto"], data["procedures"]
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
    page.heading("Named procedures")
    missed = [row for row in table["rows"] if verdict(row) == "missed"]
    predicted = [row for row in table["rows"] if row["standing"] == "predicted"]
    page.text_block(f"Two constants of bone are fitted, each on the row that says so: the pressure on a tool is {table['pressure_over_yield']:.2f} of the "
                    f"yield strength, its friction {table['friction']:.2f}. Of {len(predicted)} rows that are predicted {len(missed)} miss. "
                    "Densities and shapes that the sources do not give are assumed; the table says which.", verdict=True)
    page.plot(plots.procedures(table["rows"]), "The force along the tool.")
    page.table(("procedure", "by the law", "published", "", "tool", "tissue", "conditions of the measurement", "source"),
               [(r["id"], r["predicted"], f"{published(r)} {r['unit']}", verdict(r), r["tool"], r["tissue"], r["conditions"], r["source"])
                for r in table["rows"]])


def results(data):
    lines = ["| procedure | by the law | published | | source |", "| --- | --- | --- | --- | --- |"]
    for row in data["procedures"]["rows"]:
        lines.append(f"| {row['id']} | {row['predicted']:.{0 if row['predicted'] >= 100 else 2}f} {row['unit']} | {published(row)} {row['unit']} | {verdict(row)} | {row['source']} |")
    return lines
