# SPDX-License-Identifier: Apache-2.0
"""The plots of the report's section on the pipeline. Rows are those of pipeline_sweep."""
import matplotlib.ticker
import numpy
from style import GREY, HOLE, LINE, OUTER, THRESHOLD, plt

COLOURS = {"phantom": OUTER, "phantom 12 HU": "#7fb0d8", "L3": THRESHOLD, "head": "#b07a1e"}
KINDS = {"subpixel": (OUTER, "o", "sub-pixel contour"), "pixel": (HOLE, "s", "pixel chains (cv::findContours)")}
STAGES = {"segment": "#c9c9c9", "contour": OUTER, "simplify": "#7fb0d8", "triangulate": THRESHOLD, "refine": "#9fce9f",
          "check": "#d9b36a", "hu": "#b07a1e", "encode": HOLE}
CHOSEN = "#e0a100"


def per_slice(rows, key):
    return numpy.array([row[key] / row["slices"] for row in rows])


def column(rows, key):
    return numpy.array([row[key] for row in rows], dtype=float)


def plain_ticks(axis, span):
    """Tick labels 1, 10, 0.1 instead of powers, with intermediate ticks on short axes."""
    def short(value, _):
        return f"{value:,.0f}".replace(",", "\N{THIN SPACE}") if value >= 1000 else f"{value:g}"
    axis.set_major_formatter(matplotlib.ticker.FuncFormatter(short))
    if span < 150:
        subs = (1, 2, 5) if span > 12 else (1, 1.5, 2, 3, 5, 7) if span > 2 else (1, 1.2, 1.5, 2, 2.5, 3, 4, 4.5, 5, 5.5, 6, 7, 8)
        axis.set_major_locator(matplotlib.ticker.FixedLocator([s * 10.0**e for e in range(-5, 8) for s in subs]))
    axis.set_minor_formatter(matplotlib.ticker.NullFormatter())


def short_range(axes, x=True, y=True):
    for wanted, axis, limits in ((x, axes.xaxis, axes.get_xlim()), (y, axes.yaxis, axes.get_ylim())):
        if wanted:
            plain_ticks(axis, limits[1] / max(limits[0], 1e-12))
            (axes.set_xlim if axis is axes.xaxis else axes.set_ylim)(limits)
    axes.grid(True)
    axes.set_axisbelow(True)


def label_tolerances(axes, rows, x, y, color, every=1, offset=(4, 4)):
    for k, row in enumerate(rows):
        if k % every == 0 and (every == 1 or row["tolerance_mm"] >= 0.25):
            axes.annotate(f"{row['tolerance_mm']:g}", (x[k], y[k]), xytext=offset, textcoords="offset points",
                          fontsize=7, color=color)


def recommendation(data, noisy, clean, default_mm, near):
    figure, (left, right) = plt.subplots(1, 2, figsize=(11.5, 4.4), layout="constrained", width_ratios=(1.35, 1))
    for rows, color, name, offset in ((noisy, HOLE, "phantom, 12 HU of noise", (4, 4)), (clean, OUTER, "phantom without noise", (-14, -9))):
        x, y = per_slice(rows, "triangles"), column(rows, "mean_distance_mm")
        left.loglog(x, y, "o-", color=color, ms=4, lw=1.2, label=name)
        label_tolerances(left, rows, x, y, color, offset=offset)
    for tolerance, marker, name in ((default_mm, "s", f"the program's default, {default_mm:g} mm"),
                                    (data["recommended"]["tolerance_mm"], "*", f"recommended, {data['recommended']['tolerance_mm']:g} mm")):
        row = next(row for row in noisy if row["tolerance_mm"] == tolerance)
        left.loglog(row["triangles"] / row["slices"], row["mean_distance_mm"], marker, color=CHOSEN, ms=14 if marker == "*" else 10,
                    zorder=1, label=name)
    left.set(xlabel="triangles per slice", ylabel="mean distance to the exact cross-section (mm)")
    short_range(left)
    left.legend(loc="upper right")
    costs = data["recommended"]["costs"]
    x = [cost["tolerance_mm"] for cost in costs]
    right.loglog(x, [cost["over_least"] for cost in costs], "o-", color=HOLE, ms=4, lw=1.2)
    right.axhspan(1, near, color=THRESHOLD, alpha=0.25, lw=0)
    for tolerance, marker in ((default_mm, "s"), (data["recommended"]["tolerance_mm"], "*")):
        right.loglog(tolerance, costs[x.index(tolerance)]["over_least"], marker, color=CHOSEN, ms=14 if marker == "*" else 10, zorder=1)
    right.set(xlabel="tolerance (mm)", ylabel="mean distance \N{MULTIPLICATION SIGN} triangles, over its minimum")
    short_range(right)
    return figure


def pareto(curves, default_mm, chosen_mm):
    figure, grid = plt.subplots(len(curves), 3, figsize=(12, 3.5 * len(curves)), layout="constrained", squeeze=False, sharey="row")
    for line, (scan, kinds) in zip(grid, curves.items()):
        for axes, key, name in zip(line, ("triangles", "asset_bytes", "total_ms_per_slice"),
                                   ("triangles per slice", "asset bytes per slice", "ms per slice, pixels to encoded mesh")):
            for kind, rows in kinds.items():
                color, marker, label = KINDS[kind]
                x = column(rows, key) if key.endswith("_per_slice") else per_slice(rows, key)
                y = column(rows, "mean_distance_mm")
                axes.loglog(x, y, marker + "-", color=color, ms=3.5, lw=1.1, label=label)
                label_tolerances(axes, rows, x, y, color, every=2 if kind == "pixel" else 1)
                for tolerance, shape, size, what in ((default_mm, "s", 10, "default"), (chosen_mm, "*", 14, "recommended")):
                    for k, row in enumerate(rows):
                        if kind == "subpixel" and row["tolerance_mm"] == tolerance:
                            axes.loglog(x[k], y[k], shape, color=CHOSEN, ms=size, zorder=1, label=what)
            axes.set_xlabel(name)
            short_range(axes)
        line[0].set_ylabel("mean distance (mm)")
        line[0].set_title(scan, loc="left", fontweight="bold")
    handles, labels = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4, fontsize=9)
    return figure


def errors(curves):
    figure, grid = plt.subplots(1, len(curves), figsize=(3.2 * len(curves), 4.2), layout="constrained", squeeze=False, sharey=True)
    for axes, (scan, kinds) in zip(grid[0], curves.items()):
        for kind, rows in kinds.items():
            color, _, label = KINDS[kind]
            some = [row for row in rows if row["tolerance_mm"] > 0]
            zero = next((row for row in rows if row["tolerance_mm"] == 0), None)
            for key, style, what in (("hausdorff_mm", "-", "Hausdorff"), ("p99_distance_mm", "--", "99 %"), ("mean_distance_mm", ":", "mean")):
                axes.loglog(column(some, "tolerance_mm"), column(some, key), style, color=color, lw=1.4, label=f"{what}, {label.split(' (')[0]}")
                if zero is not None:
                    axes.plot([0, 0.06], [zero[key]] * 2, style, color=color, lw=1.4, transform=axes.get_yaxis_transform())
        t = column(some, "tolerance_mm")
        axes.loglog(t, t, color=GREY, lw=3, alpha=0.35, zorder=0)
        axes.set_title(scan, loc="left", fontweight="bold")
        axes.set_xlabel("tolerance (mm)")
        axes.set_xlim(t.min() * 0.55, t.max() * 1.1)
        short_range(axes)
    grid[0][0].set_ylabel("distance (mm)")
    handles, labels = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=6, fontsize=8)
    return figure


def area_errors(curves):
    figure, grid = plt.subplots(1, 2, figsize=(11, 3.6), layout="constrained")
    for axes, kind in zip(grid, ("subpixel", "pixel")):
        for scan, kinds in curves.items():
            rows = [row for row in kinds[kind] if row["tolerance_mm"] > 0]
            axes.semilogx(column(rows, "tolerance_mm"), column(rows, "area_error_percent"), "o-", ms=3.5, lw=1.2,
                          color=COLOURS.get(scan, GREY), label=scan)
        axes.axhline(0, color=GREY, lw=0.8)
        axes.set_title(KINDS[kind][2], loc="left")
        axes.set(xlabel="tolerance (mm)", ylabel="area error (%)")
        short_range(axes, y=False)
    grid[0].legend()
    return figure


def parameter(curves, key, name, log, default, no_bound):
    """Three panels against one parameter: (figure, caption)."""
    panels = {
        "min_angle_deg": (("triangles", "triangles per slice"), ("refine_ms_per_slice", "refinement, ms per slice"),
                          ("smallest_angle_deg", "smallest angle (deg)")),
        "max_area_mm2": (("triangles", "triangles per slice"), ("asset_bytes", "asset bytes per slice"),
                         ("total_ms_per_slice", "ms per slice")),
        "lattice_bits": (("mean_distance_mm", "mean distance (mm)"), ("bytes_per_triangle", "bytes per triangle of the whole file"),
                         ("triangles_below_min_angle", "triangles below 30\N{DEGREE SIGN} a slice")),
    }[key]
    captions = {
        "min_angle_deg": "The smallest angle of the whole mesh includes triangles at small angles of the input, which no mesh can avoid; "
                         "the table counts triangles below the bound, and those not at a small input angle.",
        "max_area_mm2": "Rightmost: no bound on the area. A bound smaller than the angles alone require costs triangles.",
        "lattice_bits": "A scan whose pixels are narrower than eight lattice steps is refused; its curve starts at the first lattice that is fine enough.",
    }
    figure, grid = plt.subplots(1, 3, figsize=(12, 3.5), layout="constrained")
    for axes, (figure_key, label) in zip(grid, panels):
        for scan, rows in curves.items():
            x = column(rows, key)
            if key == "max_area_mm2":
                x = numpy.where(x == no_bound, 300, x)
            whole = figure_key.endswith("_ms_per_slice") or figure_key in ("smallest_angle_deg", "mean_distance_mm", "bytes_per_triangle")
            y = column(rows, figure_key) if whole else per_slice(rows, figure_key)
            order = numpy.argsort(x)
            axes.plot(x[order], y[order], "o-", ms=3.5, lw=1.2, color=COLOURS.get(scan, GREY), label=scan)
        axes.axvline(default, color=CHOSEN, lw=6, alpha=0.35, zorder=0)
        axes.set(xlabel=name, ylabel=label)
        if log:
            axes.set_xscale("log")
        logarithmic = figure_key not in ("smallest_angle_deg", "bytes_per_triangle", "triangles_below_min_angle")
        if logarithmic:
            axes.set_yscale("log")
        short_range(axes, x=log, y=logarithmic)
        if log:
            axes.set_xticks([1, 3, 10, 30, 100, 300], ["1", "3", "10", "30", "100", "none"])
    grid[0].legend(fontsize=8)
    return figure, captions[key] + " Yellow: the default."


def stages(rows):
    figure, axes = plt.subplots(figsize=(10.5, 0.5 * len(rows) + 1.4), layout="constrained")
    names = [f"{row['scan']}, {row['tolerance_mm']:g} mm" for row in rows]
    left = numpy.zeros(len(rows))
    for stage, color in STAGES.items():
        width = column(rows, f"{stage}_ms_per_slice")
        axes.barh(names, width, left=left, color=color, edgecolor="white", linewidth=0.5, label=stage)
        left += width
    for k, row in enumerate(rows):
        axes.text(left[k], k, f"  {left[k]:.2f} ms, {row['triangles'] / row['slices']:.0f} triangles", va="center", fontsize=8)
    axes.invert_yaxis()
    axes.set_xlim(0, left.max() * 1.25)
    axes.set_xlabel("ms per slice")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.1), ncols=len(STAGES), fontsize=8)
    return figure


def path(row):
    figure, axes = plt.subplots(figsize=(10.5, 2.7), layout="constrained")
    bars = {"OpenCV decodes the PNGs": row["opencv_png_decode_cpu_ms"],
            "PNG to .glb, verified": row["png_to_glb_1_thread_cpu_ms"] + row["verify_cpu_ms"],
            "DICOM to .glb, verified": row["dicom_to_glb_1_thread_cpu_ms"] + row["verify_cpu_ms"]}
    axes.barh(list(bars), list(bars.values()), color=[GREY, OUTER, THRESHOLD])
    for k, value in enumerate(bars.values()):
        axes.text(value, k, f"  {value:.0f} ms", va="center", fontsize=9)
    bound = 2 * row["opencv_png_decode_cpu_ms"]
    axes.axvline(bound, color=HOLE, lw=1.2, ls="--")
    axes.text(bound, 2.45, "twice the decoding ", color=HOLE, ha="right", fontsize=8, va="bottom")
    axes.invert_yaxis()
    axes.set_xlim(0, 1.15 * max(bound, *bars.values()))
    axes.set_xlabel(f"ms of CPU for {row['slices']} slices")
    return figure


def discs(rows):
    figure, grid = plt.subplots(1, 2, figsize=(11, 3.8), layout="constrained", sharey=True)
    for axes, blur in zip(grid, sorted({row["blur_sigma_px"] for row in rows})):
        some = [row for row in rows if row["blur_sigma_px"] == blur]
        x = column(some, "radius_px")
        for kind, (color, marker, label) in KINDS.items():
            axes.loglog(x, numpy.abs(column(some, f"{kind}_area_error_percent")), marker + "-", color=color, ms=4, lw=1.3, label=label)
            axes.loglog(x, column(some, f"{kind}_worst_area_error_percent"), "-", color=color, lw=0.6)
        for radius, bound in ((20, 0.1), (5, 1.0)):
            axes.plot(radius, bound, "v", color=CHOSEN, ms=8, zorder=3, label="bound: 1 % at 5 px, 0.1 % at 20 px" if radius == 5 else None)
        axes.set_title("sharp edge: each pixel holds its coverage" if blur == 0 else f"blurred edge, sigma {blur:g} px", loc="left")
        axes.set_xlabel("radius (px)")
        short_range(axes, y=False)
        plain_ticks(axes.yaxis, 1e4)
    grid[0].set_ylabel("|area error| (%)")
    grid[0].legend(fontsize=8)
    return figure


def simplifiers(rows):
    figure, (left, right) = plt.subplots(1, 2, figsize=(11.5, 4), layout="constrained")
    for scan in dict.fromkeys(row["scan"] for row in rows):
        for contour, style in (("subpixel", "-"), ("pixel", "--")):
            some = [row for row in rows if row["scan"] == scan and row["contour"] == contour]
            x, color = column(some, "tolerance_px"), COLOURS.get(scan, GREY)
            for program, marker, width in (("approxPolyDP", "o", 1.3), ("trocar", "x", 1.3)):
                broken = [100 * (row[program]["collapsed_rings"] + row[program]["crossing_rings"]) / row["rings"] for row in some]
                name = f"{scan}, {'pixel chains' if contour == 'pixel' else 'sub-pixel'}"
                if program == "approxPolyDP" or any(broken):
                    left.semilogx(x, broken, marker + style, color=color, ms=4, lw=width, label=name if program == "approxPolyDP" else f"Trocar: {name}")
            ratio = [row["trocar"]["ms_per_slice"] for row in some]
            right.loglog(x, ratio, style, color=color, lw=1.6)
            right.loglog(x, [row["approxPolyDP"]["ms_per_slice"] for row in some], style, color=color, lw=0.6)
    left.set(xlabel="tolerance (px)", ylabel="rings that cv::approxPolyDP breaks (%)")
    ours = sum(row["trocar"]["collapsed_rings"] + row["trocar"]["crossing_rings"] for row in rows)
    left.text(0.99, 0.02 if ours == 0 else 0.5, f"broken by Trocar in total: {ours}", transform=left.transAxes, ha="right",
              color=LINE, fontsize=9, fontweight="bold")
    left.set_ylim(bottom=-8)
    right.set(xlabel="tolerance (px)", ylabel="ms per slice (thin: cv::approxPolyDP)")
    right.axhline(1.5, color=HOLE, lw=1, ls=":")
    right.text(0.1, 1.5, "bound: 1.5 ms", color=HOLE, fontsize=8, va="bottom")
    left.legend(fontsize=7.5)
    short_range(left, y=False)
    short_range(right)
    return figure


def headline(chosen):
    """`chosen`: (scan, "sub-pixel" or "pixel chains", row). Distance to the reference and time of a slice, side by side."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 0.62 + 0.25 * len(chosen)), layout="constrained", sharey=True)
    labels = [f"{scan}, {contour}, {row['tolerance_mm']:g} mm" for scan, contour, row in chosen]
    colours = [HOLE if contour == "pixel chains" else OUTER for _, contour, _ in chosen]
    for axes, key, name, digits in ((left, "mean_distance_mm", "mean distance to the reference (mm)", 3), (right, "total_ms_per_slice", "time per slice (ms)", 2)):
        values = [row[key] for _, _, row in chosen]
        axes.barh(range(len(chosen)), values, color=colours, height=0.7)
        for place, value in enumerate(values):
            axes.text(value, place, f" {value:.{digits}f}", va="center", fontsize=8)
        axes.set(xlabel=name, xlim=(0, 1.15 * max(values)))
    left.set_yticks(range(len(chosen)), labels, fontsize=8.5)
    left.invert_yaxis()
    return figure
