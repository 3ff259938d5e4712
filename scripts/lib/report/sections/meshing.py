# SPDX-License-Identifier: Apache-2.0
"""Meshing: triangulation and refinement of the same outlines, against CGAL's.

Measured by the program mesher_bench, in CPU time of one thread, in one run."""
import json
import statistics
import subprocess

import meshing_plots as plots

TITLE = "Meshing: against CGAL on the same outlines"
ORDER = 15


def measure(context):
    scans = {"phantom": context.sample / "dicom"}
    if context.real_ct is not None:
        scans["L3"] = context.real_ct / "l3" / "sub-ct_label-22_ct.nii.gz"
    if context.head_ct is not None:
        scans["head"] = context.head_ct
    out = context.scratch / "meshing.json"
    subprocess.run([context.programs / "mesher_bench", f"--out={out}", f"--benchmark_min_time={0.1 if context.full else 0.02}",
                    f"--benchmark_repetitions={9 if context.full else 3}", *(f"{name}={file}" for name, file in scans.items())],
                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
    return json.loads(out.read_text())


def span(values, form):
    low, high = form.format(min(values)), form.format(max(values))
    return low if low == high else f"{low} to {high}"


def verdict(data):
    speed, share = ([row[key] for row in data["rows"]] for key in ("cgal_over_ours_ratio", "triangles_over_cgal"))
    return (f"To {data['rows'][0]['min_angle_deg']:g} degrees, CGAL's Delaunay_mesher_2 takes {span(speed, '{:.1f}')} times as long (median {statistics.median(speed):.1f}) "
            f"from outline to refined mesh, and ours has {span(share, '{:.2f}')} of its triangles (median {statistics.median(share):.2f}).")


def show(data, page):
    page.text_block(verdict(data) + " Both keep the outline exactly, so that the two meshes have the same error; the remaining sharp triangles are at "
                    "sharp angles of the outlines.", verdict=True)
    page.text_block("Each scan at its own resolution (x1) and resampled four times as finely (x4), simplified to 0.25 mm or to a quarter of its pixel, the triangles at most "
                    "50 mm\N{SUPERSCRIPT TWO} or 200 pixels large, or of any size. Medians of all slices together; CGAL gets all points and constraints at once and chooses the order of insertion.")
    page.plot(plots.against_cgal(data["rows"]), "Left: CPU time of all slices. Right: triangles. Filled: ours, open: CGAL.")
    page.table(("outlines, largest area", "slices", "ms", "CGAL ms", "ratio", "triangles", "CGAL triangles", "share",
                "below the angle", "of these at sharp input", "CGAL below"),
               [(row["id"], row["slices"], row["refine_ms"], row["cgal_refine_ms"], row["cgal_over_ours_ratio"], row["triangles"],
                 row["cgal_triangles"], row["triangles_over_cgal"], row["triangles_below_min_angle"],
                 row["triangles_below_min_angle_at_small_input_angle"], row["cgal_triangles_below_min_angle"]) for row in data["rows"]],
               folded="refinement, all figures")
    page.table(("outlines", "slices", "vertices", "triangulate ms", "CGAL ms", "ratio", "simplify ms"),
               [(row["id"], row["slices"], row["vertices"], row["triangulate_ms"], row["cgal_triangulate_ms"], row["cgal_over_ours_ratio"],
                 row["simplify_ms"]) for row in data["outlines"]], folded="constrained triangulation alone, all figures")


def results(data):
    return [verdict(data)]


def headline(data):
    speed, share = (statistics.median(row[key] for row in data["rows"]) for key in ("cgal_over_ours_ratio", "triangles_over_cgal"))
    return ("Meshing: Trocar and the mesher Delaunay_mesher_2 of the library CGAL meshed the same outlines with the same smallest allowed angle. "
            f"Trocar is {speed:.1f} times as fast and makes {1 - share:.0%} fewer triangles. "
            "Both numbers are medians over several cases. "
            "A case is one combination of scan, resolution, tolerance of the outline, and largest allowed area of a triangle (some cases have no such limit).")
