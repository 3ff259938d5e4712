# SPDX-License-Identifier: Apache-2.0
"""stages.py STAGES.json SLICE.png OUTDIR: one slice through the pipeline, the counterparts
of the paper's Fig. 2 (contours), 4 (Douglas-Peucker), 5 (PSLG), 7 (carved constrained
Delaunay triangulation) and 9 (refined mesh). STAGES.json is trocar-mesh's --dump-stages."""
import pathlib
import sys

import matplotlib.image
import numpy
from style import (BONE, GREY, HOLE, LINE, OUTER, corner_angles_deg, doubled_area, draw_mesh,
                   draw_rings, mark_window, plane_axes, plt, read_json, save, triangle_areas)

CLOSE_UP_MM = 15.0


def windows(rings):
    """All of the bone with a margin, and the square that holds the most of the outline's corners."""
    points = numpy.vstack(rings)
    low, high = points.min(axis=0), points.max(axis=0)
    # As wide as high, so that both panels have the same shape.
    centre, half = (low + high) / 2, (high - low).max() / 2 + 4
    whole = (centre - half, centre + half)
    counts = [numpy.sum(numpy.all(numpy.abs(points - p) < CLOSE_UP_MM / 2, axis=1)) for p in points]
    centre = points[int(numpy.argmax(counts))]
    centre = numpy.clip(centre, whole[0] + CLOSE_UP_MM / 2, whole[1] - CLOSE_UP_MM / 2)
    return whole, (centre - CLOSE_UP_MM / 2, centre + CLOSE_UP_MM / 2)


def counted(n, one, many):
    return f"{n} {one if n == 1 else many}"


def two_panels(title, whole, close):
    figure, axes = plt.subplots(1, 2, figsize=(12, 6.4), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left")
    plane_axes(axes[0], "the slice", whole)
    plane_axes(axes[1], f"close up, {CLOSE_UP_MM:g} mm wide", close)
    mark_window(axes[0], close)
    return figure, axes


def show_ct(axes, image, spacing):
    height, width = image.shape[:2]
    axes.imshow(image, cmap="gray", vmin=0, vmax=1, interpolation="nearest", zorder=0, extent=(
        -spacing[0] / 2, (width - 0.5) * spacing[0], (height - 0.5) * spacing[1], -spacing[1] / 2))


def arrows(axes, ring, color, every_mm):
    """Arrow heads along a ring, about every so many mm."""
    closed = numpy.vstack([ring, ring[:1]])
    steps = numpy.diff(closed, axis=0)
    length = numpy.hypot(*steps.T)
    along = numpy.concatenate([[0], numpy.cumsum(length)])
    for s in numpy.arange(every_mm / 2, along[-1], every_mm):
        k = min(int(numpy.searchsorted(along, s)) - 1, len(steps) - 1)
        at = closed[k] + steps[k] * (s - along[k]) / max(length[k], 1e-9)
        axes.annotate("", at + steps[k] / max(length[k], 1e-9) * 1e-3, at, annotation_clip=True,
                      arrowprops={"arrowstyle": "-|>", "color": color, "mutation_scale": 15, "lw": 0,
                                  "shrinkA": 0, "shrinkB": 0})


def main():
    stages, png, out = read_json(sys.argv[1]), sys.argv[2], pathlib.Path(sys.argv[3])
    image = matplotlib.image.imread(png)
    image = image[..., :3].mean(axis=-1) if image.ndim == 3 else image
    spacing = stages["spacing_mm"]
    contours = [numpy.array(ring) for ring in stages["contours_mm"] if len(ring)]
    rings = [numpy.array(ring) for ring in stages["pslg_mm"] if len(ring)]
    number = f"slice {stages['slice']}"
    whole, close = windows(rings)
    points = sum(map(len, contours))
    corners = sum(map(len, rings))

    # Fig. 2
    figure, axes = two_panels(f"Contours over the CT, {number}: {len(contours)} contours, {points} points", whole, close)
    for panel in axes:
        show_ct(panel, image, spacing)
        draw_rings(panel, contours, "#ff6a3d", 0.9)
    for ring in contours:
        axes[1].plot(*ring.T, ".", color="#ffd34d", ms=4)
    save(figure, out / "fig02_contours.png")

    # Fig. 4
    figure, axes = two_panels(f"After Douglas-Peucker, {number}: {points} points of the contours, {corners} kept", whole, close)
    draw_rings(axes[1], contours, GREY, 0.8, zorder=2, label="contour")
    for panel in axes:
        draw_rings(panel, rings, OUTER, 1.1, zorder=3, label="simplified")
        for ring in rings:
            panel.plot(*ring.T, "o", color=HOLE, ms=2.2 if panel is axes[0] else 4.5, zorder=4)
    handles, labels = axes[1].get_legend_handles_labels()
    chosen = dict(zip(labels, handles))
    axes[1].legend(chosen.values(), chosen.keys(), loc="upper right", frameon=True)
    save(figure, out / "fig04_simplified.png")

    # Fig. 5
    outer = [ring for ring in rings if doubled_area(ring) > 0]
    holes = [ring for ring in rings if doubled_area(ring) < 0]
    outlines = f"{counted(len(outer), 'outer boundary', 'outer boundaries')}, {counted(len(holes), 'hole', 'holes')}"
    figure, axes = two_panels(f"PSLG, {number}: {outlines}, {corners} vertices on the lattice", whole, close)
    for panel, every in zip(axes, (9.0, 2.5)):
        for group, color, label in ((outer, OUTER, "outer boundary: counter-clockwise in (u, v)"),
                                    (holes, HOLE, "hole: clockwise in (u, v)")):
            draw_rings(panel, group, color, 1.1)
            for ring in group:
                panel.plot(*ring.T, "o", color=color, ms=1.8 if panel is axes[0] else 3.5)
                arrows(panel, ring, color, every)
            if group:
                panel.plot([], [], color=color, label=label)
    axes[0].legend(loc="upper left", bbox_to_anchor=(-0.02, -0.1), ncols=2)
    axes[1].set_xlabel("u (mm)\n\nv points down here, so that turns look reversed")
    save(figure, out / "fig05_pslg.png")

    # Fig. 7
    cdt = [numpy.array(stages["cdt"]["vertices_mm"]), numpy.array(stages["cdt"]["triangles"], dtype=int)]
    smallest = corner_angles_deg(*cdt).min()
    figure, axes = two_panels(f"Constrained Delaunay triangulation, carved, {number}: {len(cdt[1])} triangles, smallest angle {smallest:.2f}\N{DEGREE SIGN}", whole, close)
    for panel in axes:
        draw_mesh(panel, *cdt)
        draw_rings(panel, rings, OUTER, 1.2)
    save(figure, out / "fig07_carved.png")

    # Fig. 9
    mesh = [numpy.array(stages["refined"]["vertices_mm"]), numpy.array(stages["refined"]["triangles"], dtype=int)]
    angles, areas = corner_angles_deg(*mesh).min(axis=1), triangle_areas(*mesh)
    area_px = areas / (spacing[0] * spacing[1])
    figure = plt.figure(figsize=(12, 6.4), layout="constrained")
    figure.suptitle(f"Refined mesh, {number}: {len(mesh[0])} vertices, {len(mesh[1])} triangles, "
                    f"smallest angle {angles.min():.2f}\N{DEGREE SIGN}, largest area {area_px.max():.0f} px\N{SUPERSCRIPT TWO}", x=0.01, ha="left")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.55, 1))
    panel = figure.add_subplot(grid[:, 0])
    plane_axes(panel, f"bounds: 30\N{DEGREE SIGN} and 200 px\N{SUPERSCRIPT TWO}", whole)
    draw_mesh(panel, *mesh, width=0.45)
    draw_rings(panel, rings, OUTER, 1.2)
    panel = figure.add_subplot(grid[0, 1])
    panel.hist(angles, bins=numpy.arange(0, 61, 2), color=BONE, edgecolor=LINE, linewidth=0.6)
    panel.axvline(30, color=HOLE, lw=1.2)
    panel.text(29, panel.get_ylim()[1] * 0.92, "bound 30\N{DEGREE SIGN} ", color=HOLE, ha="right")
    panel.set(xlabel="smallest angle of a triangle (deg)", ylabel="triangles", xlim=(0, 60))
    panel = figure.add_subplot(grid[1, 1])
    panel.hist(area_px, bins=numpy.arange(0, 211, 7), color=BONE, edgecolor=LINE, linewidth=0.6)
    panel.axvline(200, color=HOLE, lw=1.2)
    panel.text(197, panel.get_ylim()[1] * 0.92, "bound 200 px\N{SUPERSCRIPT TWO} ", color=HOLE, ha="right")
    panel.set(xlabel="area of a triangle (px\N{SUPERSCRIPT TWO})", ylabel="triangles", xlim=(0, 210))
    save(figure, out / "fig09_refined.png")


if __name__ == "__main__":
    main()
