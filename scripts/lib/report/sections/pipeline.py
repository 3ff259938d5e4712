# SPDX-License-Identifier: Apache-2.0
"""Slices to assets: cost and error for each setting of trocar-mesh.

Measured by the program pipeline_sweep. On the phantom the reference is exact (where a noiseless scanner
reads the iso-value); on real scans the reference is the sub-pixel contour at full resolution."""
import json
import subprocess

import pipeline_plots as plots

TITLE = "Pipeline: from slices to an asset"
ORDER = 10

DEFAULT = {"contour": "subpixel", "tolerance_mm": 0.2, "min_angle_deg": 30, "max_area_mm2": 50, "lattice_bits": 8}
NO_AREA_BOUND_MM2 = 1e9
TOLERANCES_MM = (0, 0.02, 0.035, 0.05, 0.07, 0.1, 0.14, 0.2, 0.25, 0.35, 0.5, 0.7, 1.0, 1.4)
ANGLES_DEG = (0, 10, 20, 25, 28, 30, 32, 33)
AREAS_MM2 = (1, 2, 5, 10, 20, 50, 100, NO_AREA_BOUND_MM2)
LATTICE_BITS = (4, 5, 6, 7, 8, 9, 10, 12, 14)
PIXEL_MM = 0.3125  # of the phantom

# The recommendation comes from the noisy phantom, where the scan's noise limits the accuracy. Mean distance
# times triangles has its minimum where a per cent of error costs a per cent of triangles: at finer tolerances
# the mesh grows faster than the error falls. The minimum is flat; values within this factor of it are drawn as a band.
NEAR_LEAST = 1.10


def point(**changed):
    wanted = {**DEFAULT, **changed}
    return {"id": "{contour} t{tolerance_mm:g} a{min_angle_deg:g} A{max_area_mm2:g} b{lattice_bits}".format(**wanted), **wanted}


def plan(context):
    full = context.full
    scans = [{"name": name, "slices": list(range(1, 34, 2)) if full else [6, 12, 17, 21, 29], "noise_hu": noise}
             for name, noise in (("phantom", 0), ("phantom 12 HU", 12))]
    if context.real_ct is not None:
        scans.append({"name": "L3", "path": str(context.real_ct / "l3" / "sub-ct_label-22_ct.nii.gz"),
                      "first": 0, "stride": 1 if full else 4})
    if context.head_ct is not None:
        scans.append({"name": "head", "path": str(context.head_ct), "first": 0 if full else 3, "stride": 1 if full else 9})
    points = [point(contour=contour, tolerance_mm=t) for contour in ("subpixel", "pixel") for t in TOLERANCES_MM]
    points += [point(min_angle_deg=a) for a in ANGLES_DEG]
    points += [point(max_area_mm2=a) for a in AREAS_MM2]
    points += [point(lattice_bits=b) for b in LATTICE_BITS]
    if full:
        points += [point(tolerance_mm=t, min_angle_deg=a, lattice_bits=b)
                   for t in (0.05, 0.1, 0.2) for a in (20, 30, 33) for b in (6, 8, 10)]
    return {
        "repetitions": 9 if full else 5, "scans": scans, "points": list({p["id"]: p for p in points}.values()),
        "simplifiers": {"tolerances_px": [0.1, 0.25, 0.5, 0.75, 1, 1.5, 2, 3]},
        "discs": {"radii_px": [2.3, 3.3, 5.3, 8.3, 12.3, 20.3, 32.3, 50.3], "blur_sigma_px": [0, 0.5], "offsets": 64 if full else 16},
        # 226 HU in the samples' PNGs, whose levels are 5 HU wide from -250 HU.
        "path": {"png": str(context.sample / "png"), "dicom": str(context.sample / "dicom"),
                 "spacing_mm": [PIXEL_MM, PIXEL_MM, 1], "grey_threshold": (226 + 250) / 5},
    }


def measure(context):
    done = subprocess.run([context.programs / "pipeline_sweep"], input=json.dumps(plan(context)), text=True,
                          stdout=subprocess.PIPE, check=True)
    data = json.loads(done.stdout)
    data["default"] = point()["id"]
    data["recommended"] = recommend(data)
    path = data["path"]
    path["png_to_verified_glb_over_opencv_decode_ratio"] = (
        path["png_to_glb_1_thread_cpu_ms"] + path["verify_cpu_ms"]) / path["opencv_png_decode_cpu_ms"]
    path["two_threads_speedup_ratio"] = path["png_to_glb_1_thread_ms"] / path["png_to_glb_2_threads_ms"]
    return data


def rows_of(data, scan, **fixed):
    """The rows of a scan at the default settings, except those given in `fixed`; None leaves a setting free."""
    wanted = {**DEFAULT, **fixed}
    return [row for row in data["rows"] if row["scan"] == scan and "refused" not in row
            and all(value is None or row[key] == value for key, value in wanted.items())]


def scans_of(data):
    return list(dict.fromkeys(row["scan"] for row in data["rows"]))


def recommend(data):
    rows = sorted(rows_of(data, "phantom 12 HU", tolerance_mm=None), key=lambda row: row["tolerance_mm"])
    costs = [{"id": f"{row['tolerance_mm']:g}", "tolerance_mm": row["tolerance_mm"],
              "mean_distance_times_triangles_mm": row["mean_distance_mm"] * per_slice(row, "triangles")}
             for row in rows if row["tolerance_mm"] > 0]
    least = min(cost["mean_distance_times_triangles_mm"] for cost in costs)
    for cost in costs:
        cost["over_least"] = cost["mean_distance_times_triangles_mm"] / least
    chosen = next(cost["tolerance_mm"] for cost in costs if cost["over_least"] == 1)
    return {"tolerance_mm": chosen, "tolerance_px_of_phantom": chosen / PIXEL_MM, "costs": costs,
            "point": point(tolerance_mm=chosen)["id"]}


def find(data, scan, **fixed):
    found = rows_of(data, scan, **fixed)
    return found[0] if found else None


def per_slice(row, key):
    return row[key] / row["slices"]


HEAD = ("", "Hausdorff mm", "99 % mm", "mean mm", "area error %", "triangles per slice", "asset bytes per slice",
        "file bytes a triangle", "ms per slice", "smallest angle deg", "below the bound", "of these unexplained")


def cells(label, row):
    if "refused" in row:
        return (label, "refused: " + row["refused"].split(": ", 1)[-1]) + ("",) * (len(HEAD) - 2)
    return (label, row["hausdorff_mm"], row["p99_distance_mm"], row["mean_distance_mm"], row["area_error_percent"],
            per_slice(row, "triangles"), per_slice(row, "asset_bytes"), row["bytes_per_triangle"],
            row["total_ms_per_slice"], row["smallest_angle_deg"], row["triangles_below_min_angle"],
            row["triangles_below_min_angle_unexplained"])


def show_recommendation(data, page):
    recommended, default = data["recommended"], DEFAULT["tolerance_mm"]
    t = recommended["tolerance_mm"]
    noisy, coarse = find(data, "phantom 12 HU", tolerance_mm=t), find(data, "phantom 12 HU")
    floor = find(data, "phantom 12 HU", tolerance_mm=0)
    clean = find(data, "phantom", tolerance_mm=t)
    page.heading("Recommended tolerance")
    cost = {cost["tolerance_mm"]: cost["over_least"] for cost in recommended["costs"]}
    page.text_block(
        f"{t:g} mm ({recommended['tolerance_px_of_phantom']:.2f} of the phantom's pixels); the program's default is {default:g} mm. "
        "On the phantom with 12 HU of noise the scan itself limits the accuracy: the unsimplified contour is "
        f"{floor['mean_distance_mm']:.3f} mm off on average, with {per_slice(floor, 'triangles'):.0f} triangles per slice. Mean distance times "
        f"triangles is least at {t:g} mm, and the minimum is flat ({default:g} mm is {100 * (cost[default] - 1):.0f} % above): "
        f"at finer tolerances the mesh grows faster than the error falls. At {t:g} mm: "
        f"{noisy['mean_distance_mm']:.3f} mm ({clean['mean_distance_mm']:.3f} mm without noise), area error {noisy['area_error_percent']:+.2f} %, "
        f"{per_slice(noisy, 'triangles'):.0f} triangles per slice; at {default:g} mm: {coarse['mean_distance_mm']:.3f} mm, {coarse['area_error_percent']:+.2f} %, "
        f"{per_slice(coarse, 'triangles'):.0f}. The useful tolerance scales with the pixel and is about a third of one; on the real scans the reference is the "
        "scan's own contour, so that their plots show the cost only. The default is the finest tolerance at which the files stay within their bounds "
        "(460 kB for the head, 135 kB for L3), which 0.14 mm exceeds; 0.25 mm gives accuracy away for few bytes.", verdict=True)
    page.plot(plots.recommendation(data, rows_of(data, "phantom 12 HU", tolerance_mm=None),
                                   rows_of(data, "phantom", tolerance_mm=None), default, NEAR_LEAST),
              "Left: error against the exact cross-sections and triangles, labelled with the tolerance in mm. Right: their product "
              "relative to its minimum; the band shows what counts as minimal.")


def show_tolerance(data, page):
    scans = scans_of(data)
    curves = {scan: {contour: rows_of(data, scan, contour=contour, tolerance_mm=None) for contour in ("subpixel", "pixel")}
              for scan in scans}
    chosen = data["recommended"]["tolerance_mm"]
    page.heading("Tolerance and contour kind: error against size and time")
    page.plot(plots.pareto(curves, DEFAULT["tolerance_mm"], chosen),
              "Each point is a tolerance, labelled in mm; down and to the left is better. Mean distance both ways to the exact "
              "cross-section (phantom) or to the full-resolution sub-pixel contour (L3, head).")
    page.plot(plots.errors(curves), "Distances against tolerance. The grey line is the tolerance itself; short strokes at the left: tolerance 0. "
              "Chains through pixel centres start half a pixel inside the material, at every tolerance, and lose every wall thinner than a pixel.")
    page.plot(plots.area_errors(curves), "Area error over all slices, signed.")
    for scan in scans:
        listed = [row for contour in ("subpixel", "pixel") for row in data["rows"] if row["scan"] == scan and row["point"] in
                  {point(contour=contour, tolerance_mm=t)["id"] for t in TOLERANCES_MM}]
        marked = [k for k, row in enumerate(listed) if row["point"] in (data["default"], data["recommended"]["point"])]
        page.table(HEAD, [cells(f"{row['contour']}, {row['tolerance_mm']:g} mm", row) for row in listed], marked,
                   folded=f"{scan}: {listed[0]['slices']} slices of {listed[0]['pixel_mm']:.4g} mm pixels, by tolerance")


def show_meshing(data, page):
    scans = scans_of(data)
    page.heading("Smallest angle, largest area, lattice")
    for title, key, values, name, log in (
            ("smallest angle", "min_angle_deg", ANGLES_DEG, "requested smallest angle (deg)", False),
            ("largest area", "max_area_mm2", AREAS_MM2, "largest triangle allowed (mm\N{SUPERSCRIPT TWO})", True),
            ("lattice", "lattice_bits", LATTICE_BITS, "lattice bits N (step 2\N{SUPERSCRIPT MINUS}\N{MODIFIER LETTER CAPITAL N} mm)", False)):
        curves = {scan: [row for row in rows_of(data, scan, **{key: None}) if row[key] in values] for scan in scans}
        figure, caption = plots.parameter(curves, key, name, log, DEFAULT[key], NO_AREA_BOUND_MM2)
        page.plot(figure, caption)
        listed = [row for scan in scans for value in values for row in data["rows"]
                  if row["scan"] == scan and row["point"] == point(**{key: value})["id"]]
        page.table(HEAD, [cells(f"{row['scan']}, {'no bound' if row[key] == NO_AREA_BOUND_MM2 else format(row[key], 'g')}", row)
                          for row in listed], [k for k, row in enumerate(listed) if row["point"] == data["default"]],
                   folded=f"all figures by {title}")


def show_stages(data, page):
    rows = [row for tolerance in (DEFAULT["tolerance_mm"], data["recommended"]["tolerance_mm"])
            for scan in scans_of(data) if (row := find(data, scan, tolerance_mm=tolerance))]
    page.heading("Where the time goes")
    page.plot(plots.stages(rows), "Milliseconds per slice by stage, pixels already in memory; encode (CPU time) includes decoding the result.")


def show_peers(data, page):
    page.heading("Against other programs")
    path = data["path"]
    ratio = path["png_to_verified_glb_over_opencv_decode_ratio"]
    page.text_block(f"From {path['slices']} PNGs of 512 x 512 to a verified .glb in one thread: {ratio:.2f} times the time that OpenCV "
                    f"takes just to decode the same files (CPU time, medians, interleaved); from DICOM {path['dicom_to_glb_1_thread_cpu_ms'] / path['opencv_png_decode_cpu_ms']:.2f} "
                    f"times. With two threads {path['two_threads_speedup_ratio']:.2f} times faster than with one, by the wall clock.", verdict=True)
    page.plot(plots.path(path), "Milliseconds for the sample scan, one thread, CPU time. The .glb is made in memory; writing it to disk is not included.")
    page.plot(plots.discs(data["discs"]), "Area error of discs, mean over positions within a pixel (thin: the worst). Pixel chains: cv::findContours.")
    page.plot(plots.simplifiers(data["simplifiers"]), "cv::approxPolyDP simplifies ring by ring; the share of rings that collapse, change orientation or cross. "
              "The same exact test is used for both programs; Trocar's count is 0 everywhere unless the plot says otherwise.")
    head = ("", "rings", "collapsed", "crossing", "slices broken", "vertices", "ms per slice")
    page.table(head, [(f"{row['id']}: {program}", row["rings"], of["collapsed_rings"], of["crossing_rings"],
                       f"{of['broken_slices']} of {row['slices']}", of["vertices"], of["ms_per_slice"])
                      for row in data["simplifiers"] for program in ("trocar", "approxPolyDP") for of in (row[program],)],
               folded="simplification, all figures")


def show(data, page):
    page.text_block("Distances are between the outline that the asset holds (simplified, refined, on the lattice) and the reference, in both directions, "
                    "sampled every eighth of a pixel. On the phantom the reference is exact: where a noiseless scanner of the same "
                    "apertures reads 226 HU. On the real scans L3 (1.5 mm pixels) and head (0.96 mm) it is the sub-pixel contour at full "
                    "resolution on a 2\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT ONE}\N{SUPERSCRIPT FOUR} mm lattice, so those errors come from simplification and lattice only. "
                    "Regions below 1 mm\N{SUPERSCRIPT TWO} are dropped on both sides.")
    show_recommendation(data, page)
    show_tolerance(data, page)
    show_meshing(data, page)
    show_stages(data, page)
    show_peers(data, page)


def chosen_rows(data):
    """What RESULTS.md and the headline plot show: (scan, "sub-pixel" or "pixel chains", row)."""
    rows = []
    for scan in scans_of(data):
        for tolerance in dict.fromkeys((DEFAULT["tolerance_mm"], data["recommended"]["tolerance_mm"])):
            if row := find(data, scan, tolerance_mm=tolerance):
                rows.append((scan, "sub-pixel", row))
        if row := find(data, scan, contour="pixel"):
            rows.append((scan, "pixel chains", row))
    return rows


def results(data):
    lines = ["| scan, contour | tolerance mm | mean distance mm | Hausdorff mm | area error % | triangles per slice | file's bytes per triangle | ms per slice |",
             "| --- | --- | --- | --- | --- | --- | --- | --- |"]
    for scan, contour, row in chosen_rows(data):
        lines.append(f"| {scan}, {contour} | {row['tolerance_mm']:g} | {row['mean_distance_mm']:.3f} | {row['hausdorff_mm']:.2f} | {row['area_error_percent']:+.2f} | "
                     f"{per_slice(row, 'triangles'):.0f} | {row['bytes_per_triangle']:.2f} | {row['total_ms_per_slice']:.2f} |")
    path = data["path"]
    broken = [sum(row[program]["collapsed_rings"] + row[program]["crossing_rings"] for row in data["simplifiers"]) for program in ("trocar", "approxPolyDP")]
    return [*lines, "", "Times: from pixels in memory to the encoded mesh, one thread. On the phantom with noise the largest distance is caused by the noise. "
            "Chains through pixel centres lose half a pixel all round, and every wall thinner than a pixel.",
            "", f"From {path['slices']} PNGs to a verified `.glb`, one thread: {path['png_to_verified_glb_over_opencv_decode_ratio']:.2f} times what OpenCV "
            f"takes to decode them. Rings that simplification broke in the whole sweep: {broken[0]}; `cv::approxPolyDP` on the same contours: {broken[1]}."]


def headline(data):
    row = find(data, "phantom 12 HU")
    return (f"Outlines: on a synthetic CT with noise, the mean distance of the outlines from the exact cross-section is {row['mean_distance_mm']:.3f} mm. "
            f"On average a slice has {per_slice(row, 'triangles'):.0f} triangles, which are made from its pixels in {row['total_ms_per_slice']:.2f} ms.")
