# SPDX-License-Identifier: Apache-2.0
"""stages.py STAGES.json REPORT.json PAPER_STAGES.json PAPER_REPORT.json SLICE.png OUTDIR: one slice through the
pipeline, by default and with the paper's preset beside it; the counterparts of the paper's Fig. 2 (contours),
4 (simplification), 5 (PSLG), 7 (constrained Delaunay triangulation of the material) and 9 (refined mesh).
STAGES.json and REPORT.json are trocar-mesh's --dump-stages and --report."""
import dataclasses
import pathlib
import sys

import matplotlib.image
import numpy
from matplotlib.path import Path
from style import (BONE, GREY, HOLE, LINE, OUTER, corner_angles_deg, doubled_area, draw_mesh,
                   draw_rings, mark_window, plane_axes, plt, read_json, save, triangle_areas)

CLOSE_UP_MM = 15.0
PNG_WINDOW_HU = (-250.0, 1025.0)  # of the sample scan's PNG (sample_ct/README.md)
BONE_HU = 226.0                   # trocar-mesh's default threshold
SQUARED = "\N{SUPERSCRIPT TWO}"


@dataclasses.dataclass
class Run:
    """One slice of one run of trocar-mesh."""
    name: str
    slice: int
    spacing: list
    contours: list   # rings, n x 2, mm
    rings: list      # simplified rings
    cdt: tuple       # vertices, triangles
    refined: tuple
    report: dict     # of this slice
    parameters: dict

    @staticmethod
    def read(name, stages_file, report_file):
        stages, report = read_json(stages_file), read_json(report_file)

        def rings(key):
            return [numpy.array(ring) for ring in stages[key] if len(ring)]

        def mesh(key):
            return numpy.array(stages[key]["vertices_mm"]), numpy.array(stages[key]["triangles"], dtype=int)

        return Run(name, stages["slice"], stages["spacing_mm"], rings("contours_mm"), rings("pslg_mm"), mesh("cdt"), mesh("refined"),
                   next(piece for piece in report["slices"] if piece["index"] == stages["slice"]), report["parameters"])

    @property
    def points(self):
        return sum(map(len, self.contours))

    @property
    def corners(self):
        return sum(map(len, self.rings))


def windows(runs):
    """The square that holds all rings with a margin, and the square of CLOSE_UP_MM with the most corners of the last run."""
    points = numpy.vstack([ring for run in runs for ring in run.rings])
    low, high = points.min(axis=0), points.max(axis=0)
    centre, half = (low + high) / 2, (high - low).max() / 2 + 4
    whole = (centre - half, centre + half)
    points = numpy.vstack(runs[-1].rings)
    counts = [numpy.sum(numpy.all(numpy.abs(points - p) < CLOSE_UP_MM / 2, axis=1)) for p in points]
    centre = points[int(numpy.argmax(counts))]
    centre = numpy.clip(centre, whole[0] + CLOSE_UP_MM / 2, whole[1] - CLOSE_UP_MM / 2)
    return whole, (centre - CLOSE_UP_MM / 2, centre + CLOSE_UP_MM / 2)


def counted(n, one, many):
    return f"{n} {one if n == 1 else many}"


def four_panels(title, runs, describe, whole, close):
    """A column for each run: the slice and a close up of it."""
    figure, axes = plt.subplots(2, 2, figsize=(12, 12.2), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left")
    for column, run in enumerate(runs):
        plane_axes(axes[0, column], f"{run.name}: {describe(run)}", whole)
        plane_axes(axes[1, column], f"close up, {CLOSE_UP_MM:g} mm wide", close)
        mark_window(axes[0, column], close)
    return figure, axes


def show_ct(axes, image, spacing):
    height, width = image.shape[:2]
    axes.imshow(image, cmap="gray", vmin=0, vmax=1, interpolation="nearest", zorder=0, extent=(
        -spacing[0] / 2, (width - 0.5) * spacing[0], (height - 0.5) * spacing[1], -spacing[1] / 2))


def arrows(axes, ring, color, every_mm):
    """Arrow heads along a ring, about `every_mm` apart."""
    closed = numpy.vstack([ring, ring[:1]])
    steps = numpy.diff(closed, axis=0)
    length = numpy.hypot(*steps.T)
    along = numpy.concatenate([[0], numpy.cumsum(length)])
    for s in numpy.arange(every_mm / 2, along[-1], every_mm):
        k = min(int(numpy.searchsorted(along, s)) - 1, len(steps) - 1)
        at = closed[k] + steps[k] * (s - along[k]) / max(length[k], 1e-9)
        head = axes.annotate("", at + steps[k] / max(length[k], 1e-9) * 1e-3, at, annotation_clip=True,
                             arrowprops={"arrowstyle": "-|>", "color": color, "mutation_scale": 15, "lw": 0,
                                         "shrinkA": 0, "shrinkB": 0})
        head.set_in_layout(False)  # it is inside the axes; measuring hundreds of them takes long


def sampled(ring, step_mm):
    """Points along a closed ring, step_mm apart."""
    closed = numpy.vstack([ring, ring[:1]])
    along = numpy.concatenate([[0], numpy.cumsum(numpy.hypot(*numpy.diff(closed, axis=0).T))])
    at = numpy.arange(0, along[-1], step_mm)
    return numpy.column_stack([numpy.interp(at, along, closed[:, k]) for k in (0, 1)])


def distances_outside(paper, default):
    """How far the paper's largest contour lies outside the default's material around the vertebral body, mm.
    The body is the part of the outline in front of the vertebral canal (the largest hole)."""
    outline = sampled(max(paper.contours, key=doubled_area), 0.1)
    canal = min(default.contours, key=doubled_area)
    outline = outline[outline[:, 1] < canal[:, 1].min()]
    reference = numpy.vstack([sampled(ring, 0.05) for ring in default.contours])
    distance = numpy.concatenate([numpy.sqrt(((part[:, None] - reference[None]) ** 2).sum(-1)).min(axis=1)
                                  for part in numpy.array_split(outline, 32)])
    inside = sum(Path(ring).contains_points(outline) for ring in default.contours) % 2 == 1
    return numpy.where(inside, -distance, distance)


def equalised(image, level):
    """The grey level that histogram equalisation (as cv::equalizeHist) maps to at least `level`, the share
    of pixels from there on, and the share of pixels above BONE_HU."""
    grey = numpy.rint(255 * image).astype(int)
    histogram = numpy.bincount(grey.ravel(), minlength=256)
    first = histogram[numpy.nonzero(histogram)[0][0]]
    mapped = numpy.rint((numpy.cumsum(histogram) - first) * 255 / (grey.size - first))
    lowest = int(numpy.nonzero(mapped >= level)[0][0])
    low, high = PNG_WINDOW_HU
    hu = low + lowest * (high - low) / 255
    bone = (BONE_HU - low) * 255 / (high - low)
    return hu, numpy.mean(grey >= lowest), numpy.mean(grey >= bone)


def input_angles_deg(rings):
    """The angle inside the material at every corner; the material lies on a ring's left in (u, v)."""
    angles = []
    for ring in rings:
        before, after = numpy.roll(ring, 1, axis=0) - ring, numpy.roll(ring, -1, axis=0) - ring
        cross = after[:, 0] * before[:, 1] - after[:, 1] * before[:, 0]
        angles.append(numpy.degrees(numpy.arctan2(cross, numpy.sum(after * before, axis=1))) % 360)
    return numpy.concatenate(angles)


def draw_contours(runs, image, whole, close, out):
    default, paper = runs
    figure, axes = four_panels(f"Contours over the CT, slice {default.slice}", runs, lambda run: f"{counted(len(run.contours), 'contour', 'contours')}, {run.points} points",
                               whole, close)
    for column, run in enumerate(runs):
        for panel in axes[:, column]:
            show_ct(panel, image, run.spacing)
            draw_rings(panel, run.contours, "#ff6a3d", 0.9)
        for ring in run.contours:
            axes[1, column].plot(*ring.T, ".", color="#ffd34d", ms=4)
    outside = distances_outside(paper, default)
    level = paper.parameters["equalize"]
    hu, share, bone_share = equalised(image, level)
    save(figure, out / "fig02_contours.png", slice=default.slice, outside_mean=outside.mean(), outside_max=outside.max(), level=level,
         share=100 * share, bone_share=100 * bone_share, level_HU=hu)


def draw_simplified(runs, whole, close, out):
    figure, axes = four_panels(f"Simplified, slice {runs[0].slice}", runs, lambda run: f"{run.corners} of {run.points} points kept", whole, close)
    for column, run in enumerate(runs):
        draw_rings(axes[1, column], run.contours, GREY, 0.8, zorder=2)
        for panel in axes[:, column]:
            draw_rings(panel, run.rings, OUTER, 1.1, zorder=3)
            for ring in run.rings:
                panel.plot(*ring.T, "o", color=HOLE, ms=2.2 if panel is axes[0, column] else 4.5, zorder=4)
        axes[1, column].plot([], [], color=GREY, lw=0.8, label="contour")
        axes[1, column].plot([], [], color=OUTER, lw=1.1, label="simplified")
        axes[1, column].legend(loc="upper right", frameon=True)
    default, paper = runs
    save(figure, out / "fig04_simplified.png", slice=default.slice, tolerance=default.parameters["tolerance_mm"], default_points=default.points,
         default_corners=default.corners, paper_points=paper.points, paper_corners=paper.corners)


def draw_pslg(runs, whole, close, out):
    def outlines(run):
        outer = sum(doubled_area(ring) > 0 for ring in run.rings)
        return f"{counted(outer, 'outer boundary', 'outer boundaries')}, {counted(len(run.rings) - outer, 'hole', 'holes')}, {run.corners} vertices"

    figure, axes = four_panels(f"PSLG, slice {runs[0].slice}", runs, outlines, whole, close)
    for column, run in enumerate(runs):
        for panel, every in zip(axes[:, column], (9.0, 2.5)):
            for ring in run.rings:
                color = OUTER if doubled_area(ring) > 0 else HOLE
                draw_rings(panel, [ring], color, 1.1)
                panel.plot(*ring.T, "o", color=color, ms=1.8 if panel is axes[0, column] else 3.5)
                arrows(panel, ring, color, every)
    for color, label in ((OUTER, "outer boundary: counter-clockwise in (u, v)"), (HOLE, "hole: clockwise in (u, v)")):
        axes[1, 0].plot([], [], color=color, label=label)
    figure.legend(*axes[1, 0].get_legend_handles_labels(), loc="upper right", ncols=2)
    save(figure, out / "fig05_pslg.png", slice=runs[0].slice)


def draw_carved(runs, whole, close, out):
    smallest = {run.name: corner_angles_deg(*run.cdt).min() for run in runs}
    figure, axes = four_panels(f"Constrained Delaunay triangulation of the material, slice {runs[0].slice}", runs,
                               lambda run: f"{len(run.cdt[1])} triangles, smallest angle {smallest[run.name]:.2f}\N{DEGREE SIGN}", whole, close)
    for column, run in enumerate(runs):
        for panel in axes[:, column]:
            draw_mesh(panel, *run.cdt)
            draw_rings(panel, run.rings, OUTER, 1.2)
    save(figure, out / "fig07_carved.png", slice=runs[0].slice, default_angle=smallest[runs[0].name], paper_angle=smallest[runs[1].name])


def draw_histogram(panel, values, bins, bound, label, xlabel, align="center"):
    panel.hist(values, bins=bins, color=BONE, edgecolor=LINE, linewidth=0.6)
    panel.axvline(bound, color=HOLE, lw=1.2)
    panel.text(bound, 1.01, label, color=HOLE, ha=align, va="bottom", transform=panel.get_xaxis_transform())
    panel.set(xlabel=xlabel, ylabel="triangles", xlim=(bins[0], bins[-1]))


def draw_refined(runs, whole, out):
    figure = plt.figure(figsize=(12, 12.2), layout="constrained")
    figure.suptitle(f"Refined mesh, slice {runs[0].slice}", x=0.01, ha="left")
    grid = figure.add_gridspec(3, 2, height_ratios=(2.6, 1, 1))
    for column, run in enumerate(runs):
        angles, areas = corner_angles_deg(*run.refined).min(axis=1), triangle_areas(*run.refined)
        panel = figure.add_subplot(grid[0, column])
        plane_axes(panel, f"{run.name}: {len(run.refined[0])} vertices, {len(angles)} triangles,\nsmallest angle {angles.min():.2f}\N{DEGREE SIGN}, "
                   f"largest area {areas.max():.1f} mm{SQUARED}", whole)
        draw_mesh(panel, *run.refined, width=0.45)
        draw_rings(panel, run.rings, OUTER, 1.2)
        bound = run.parameters["min_angle_deg"]
        draw_histogram(figure.add_subplot(grid[1, column]), angles, numpy.arange(0, 61, 2), bound, f"bound {bound:g}\N{DEGREE SIGN}",
                       "smallest angle of a triangle (deg)")
        bound = run.report["max_area_bound_mm2"]
        pixels = f" = {run.parameters['max_area_px2']:g} px{SQUARED}" if "max_area_px2" in run.parameters else ""
        draw_histogram(figure.add_subplot(grid[2, column]), areas, numpy.linspace(0, 1.05 * bound, 31), bound, f"bound {bound:.4g} mm{SQUARED}{pixels}",
                       f"area of a triangle (mm{SQUARED})", align="right")
    default, paper = runs
    inputs = input_angles_deg(paper.rings)
    save(figure, out / "fig09_refined.png", slice=default.slice, bound=paper.parameters["min_angle_deg"],
         default_below=default.report["triangles_below_min_angle"], default_triangles=default.report["triangles"],
         paper_below=paper.report["triangles_below_min_angle"], paper_triangles=paper.report["triangles"], paper_angle=paper.report["min_angle_deg"],
         inputs=int(numpy.sum(inputs < 60)), input_angle=inputs.min(), explained=paper.report["triangles_below_min_angle_at_small_input_angle"],
         unexplained=paper.report["triangles_below_min_angle_unexplained"])


def main():
    runs = [Run.read("default, sub-pixel", sys.argv[1], sys.argv[2]), Run.read("paper's preset", sys.argv[3], sys.argv[4])]
    image, out = matplotlib.image.imread(sys.argv[5]), pathlib.Path(sys.argv[6])
    image = image[..., :3].mean(axis=-1) if image.ndim == 3 else image
    whole, close = windows(runs)
    draw_contours(runs, image, whole, close, out)
    draw_simplified(runs, whole, close, out)
    draw_pslg(runs, whole, close, out)
    draw_carved(runs, whole, close, out)
    draw_refined(runs, whole, out)


if __name__ == "__main__":
    main()
