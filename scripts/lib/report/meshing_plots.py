# SPDX-License-Identifier: Apache-2.0
"""The plot of the report's section on meshing. Rows are those of mesher_bench."""
from style import HOLE, OUTER, plt


def against_cgal(rows):
    names = [row["id"] for row in rows]
    figure, (times, counts) = plt.subplots(1, 2, figsize=(10.5, 0.9 + 0.27 * len(names)), sharey=True, layout="constrained")
    for axes, ours, theirs, label in ((times, "refine_ms", "cgal_refine_ms", "CPU time of all slices (ms)"),
                                      (counts, "triangles", "cgal_triangles", "triangles")):
        for y, row in enumerate(rows):
            axes.plot([row[ours], row[theirs]], [y, y], color="0.8", lw=1.2, zorder=1)
        axes.plot([row[ours] for row in rows], range(len(rows)), "o", color=OUTER, ms=5, label="Trocar")
        axes.plot([row[theirs] for row in rows], range(len(rows)), "o", color="white", mec=HOLE, ms=5, label="CGAL Delaunay_mesher_2")
        axes.set_xscale("log")
        axes.set_xlabel(label)
        axes.grid(True, axis="x")
    times.set_yticks(range(len(names)), names)
    times.set_ylim(len(names) - 0.5, -0.5)
    counts.legend(fontsize=8)
    return figure
