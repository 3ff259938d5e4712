# SPDX-License-Identifier: Apache-2.0
"""Re-meshing: a cut of the tool's outline, stage by stage, against CGAL's triangulation of what it replaces.

Measured by the program cut_bench, in CPU time of its thread, in one run."""
import json
import subprocess

import remeshing_plots as plots

TITLE = "Re-meshing: cutting a hole"
ORDER = 25

CUT, READY, CAVITY, SLICE = "cut and re-triangulation, proved", "ready to hand over", "CGAL: the cavity", "CGAL: the slice with the hole"


def measure(context):
    out = context.scratch / "remeshing.json"
    subprocess.run([context.programs / "cut_bench", f"--out={out}", f"--benchmark_min_time={1 if context.full else 0.1}"],
                   stdout=subprocess.DEVNULL, check=True)
    return json.loads(out.read_text())


def of(data, vertices, what):
    return next(row for row in data["rows"] if row["vertices"] == vertices and row["what"] == what)


def show(data, page):
    small, large = (of(data, n, READY) for n in (10000, 200000))
    page.text_block(
        f"A hexagonal hole that overlaps {data['sheets'][0]['triangles_removed_median']:.0f} triangles is cut, verified and refined in "
        f"{small['median_us']:.0f} us in a sheet of 10,000 vertices and {large['median_us']:.0f} us in one of 200,000. CGAL takes "
        f"{of(data, 10000, CAVITY)['to_cut_ratio']:.1f} times as long as the cut for the cavity alone, whose outline it gets as input (the cut also finds it and verifies the mesh), and "
        f"{of(data, 200000, SLICE)['to_cut_ratio']:,.0f} times for the whole larger slice.", verdict=True)
    page.text_block("Every mesh is exactly the sheet without the outline, which the cut verifies in integers each time. Only the shape of the new "
                    "triangles can be poor; the refinement brings their angles to 20 degrees where the outline permits.")
    page.plot(plots.stages(data["rows"]), "Medians of CPU time; whiskers to 99 %.")
    page.table(("sheet", "stage", "samples", "median us", "99 % us", "largest us", "against the cut"),
               [(f"{row['vertices']:,}", row["what"], row["samples"], row["median_us"], row["p99_us"], row["max_us"], row["to_cut_ratio"])
                for row in data["rows"]])


def results(data):
    return [f"A hole in a sheet of 10,000 vertices is cut, verified and refined in {of(data, 10000, READY)['median_us']:.0f} us, in one of 200,000 in "
            f"{of(data, 200000, READY)['median_us']:.0f} us; CGAL takes {of(data, 10000, SLICE)['to_cut_ratio']:,.0f} times as long as the cut for the whole smaller slice, and {of(data, 10000, CAVITY)['to_cut_ratio']:.1f} times for the cavity alone, which the cut also finds and verifies."]


def headline(data):
    return (f"Puncture: to cut a hole, verify it and improve the triangles around it takes {of(data, 10000, READY)['median_us']:.0f} us in a slice of 10,000 vertices, "
            f"and {of(data, 200000, READY)['median_us']:.0f} us in a slice of 200,000 vertices.")
