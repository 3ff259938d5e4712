# SPDX-License-Identifier: Apache-2.0
"""The sheet's spring network: cost and error of each solver.

Measured by the program deformation_sweep at random places of the scans' slices; the reference is the
equilibrium of the whole slice on the same triangles."""
import json
import subprocess

import deformation_plots as plots

TITLE = "Deformation: the solvers of the spring network"
ORDER = 20

REACH_MM = 8
TOOL_RADIUS_MM = 3


def assets(context):
    scans = {"phantom": context.sample / "sample.nii.gz"}
    if context.real_ct is not None:
        scans["L3"] = context.real_ct / "l3" / "sub-ct_label-22_ct.nii.gz"
    if context.head_ct is not None:
        scans["head"] = context.head_ct
    for name, scan in scans.items():
        asset = context.scratch / f"deformation_{name}.glb"
        subprocess.run([context.programs / "trocar-mesh", scan, "-o", asset, "--quiet"], check=True)
        yield {"name": name, "path": str(asset)}


def measure(context):
    plan = {"assets": list(assets(context)), "places": 400 if context.full else 100, "repetitions": 5,
            "reach_m": REACH_MM * 1e-3, "tool_radius_m": TOOL_RADIUS_MM * 1e-3}
    done = subprocess.run([context.programs / "deformation_sweep"], input=json.dumps(plan), text=True,
                          stdout=subprocess.PIPE, check=True)
    return json.loads(done.stdout)


def scans_of(data):
    return list(dict.fromkeys(row["scan"] for row in data["rows"]))


def rows_of(data, scan, method):
    return [row for row in data["rows"] if row["scan"] == scan and row["method"] == method]


def label(row):
    if row["method"] == "propagation":
        return f"propagation, depth {row['parameter']:g}"
    if row["method"] == "local":
        return f"local, {row['parameter'] * REACH_MM / 2:g} mm"
    if row["method"] == "auto":
        return f"auto, {100 * row['parameter']:g} %"
    return "global"


HEAD = ("", "force error %", "95 %", "most", "displacement error %", "95 %", "most", "first tick's force error %",
        "free nodes", "\N{MICRO SIGN}s per solve", "\N{MICRO SIGN}s before it", "\N{MICRO SIGN}s meshing", "\N{MICRO SIGN}s an answer", "radius mm")


def cells(row):
    def percent(key):
        return 100 * row[key] if key in row else None
    return (label(row), *(percent(f"force_error{end}") for end in ("", "_p95", "_max")),
            *(percent(f"displacement_error{end}") for end in ("", "_p95", "_max")), percent("early_force_error"),
            round(row["free_nodes"]), row.get("solve_us"), row["prepare_us"], row.get("mesh_us"), plots.answer_us(row), row.get("radius_mm"))


def show(data, page):
    page.text_block(
        f"A hexagon of {1e3 * data['tool_radius_m']:g} mm at random places of each scan's slices, including near rims and holes; reach "
        f"\N{GREEK SMALL LETTER LAMDA} = {1e3 * data['reach_m']:g} mm. Errors are relative to the solution of the whole slice on the same triangles: of the tool's force, and "
        "of the displacements (the largest, over the depth); medians over the places unless the column says otherwise. \N{MICRO SIGN}s per solve: one tick's "
        "work for a general load (the haptic thread itself needs only one product, as the answer is linear in the depth). "
        "\N{MICRO SIGN}s before it: network and factorisation, done by a worker when the tool has moved; meshing: the region is cut out of the sheet and refined; "
        "answer: all of these, for auto including the choice of the radius.")
    for scan in scans_of(data):
        bounds = rows_of(data, scan, "auto")
        kept = all(row[f"{error}_error_max"] <= row["parameter"] for row in bounds for error in ("force", "displacement"))
        page.text_block(
            f"{scan}: auto kept {'all of its bounds' if kept else 'NOT all of its bounds'} at {bounds[0]['places']} places; at 1 % its largest errors were "
            f"{100 * bounds[1]['force_error_max']:.2g} % of force and {100 * bounds[1]['displacement_error_max']:.2g} % of displacement, with {bounds[1]['free_nodes']:.0f} "
            f"free nodes and {bounds[1]['solve_us']:.2g} \N{MICRO SIGN}s per solve (medians).", verdict=True)
    curves = {scan: {method: rows_of(data, scan, method) for method in ("propagation", "local", "auto")} for scan in scans_of(data)}
    page.plot(plots.pareto(curves),
              "Median errors against the time of a solve (left, middle), and against a worker's whole time for an answer at a new place (right; propagation may use the sheet's own mesh). Propagation: depths 1 to 12; local: "
              "radii of 1 to 12 half reaches; auto: bounds of 10, 1 and 0.1 %. Errors below 1e-7 are drawn at 1e-7: the region is then the whole slice.")
    for scan in scans_of(data):
        listed = [row for method in ("propagation", "local", "auto", "global") for row in rows_of(data, scan, method)]
        page.table(HEAD, [cells(row) for row in listed], [k for k, row in enumerate(listed) if row["method"] == "auto"], folded=f"{scan}: all figures")


def in_percent(error):
    return "< 1e-5" if error < 1e-7 else f"{100 * error:.2g}"


def results(data):
    lines = ["| scan | solver of the network | force error %, median (most) | displacement error %, median (most) | free nodes | µs per solve | µs per answer |",
             "| --- | --- | --- | --- | --- | --- | --- |"]
    for scan in scans_of(data):
        chosen = [row for row in rows_of(data, scan, "propagation") if row["parameter"] in (4, 8)]
        chosen += [row for row in rows_of(data, scan, "local") if row["parameter"] in (4, 8)] + rows_of(data, scan, "auto")
        for row in chosen:
            lines.append(f"| {scan} | {label(row)} | {in_percent(row['force_error'])} ({in_percent(row['force_error_max'])}) | "
                         f"{in_percent(row['displacement_error'])} ({in_percent(row['displacement_error_max'])}) | {row['free_nodes']:.0f} | "
                         f"{row['solve_us']:.2g} | {'' if plots.answer_us(row) is None else round(plots.answer_us(row))} |")
    return [*lines, "", "Errors relative to the whole slice on the same triangles; a hexagon of 3 mm, reach 8 mm. Solve: the work of one tick for a general load. "
            "Answer: from the sheet to stiffness and shape at a new place, done by a worker."]


def headline(data):
    rows = [row for row in data["rows"] if row["method"] == "auto" and row["parameter"] == 0.01]
    return ("Deformation of a slice as a network of springs: Trocar computes only a region around the tool, which causes an error in the force on the tool. "
            "Trocar estimates an upper bound of this error, and makes the region so large that the bound is at most 1 % of the force. "
            f"In the measurements, the force differed by at most {100 * max(row['force_error_max'] for row in rows):.2g} % from the force that the whole slice gives. "
            f"On the slowest scan, computing the deformation for one tick took {max(row['solve_us'] for row in rows):.2g} us "
            "(the median over random positions of the tool).")
