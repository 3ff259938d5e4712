# SPDX-License-Identifier: Apache-2.0
"""The plot of the report's section on the path. Rows are those of path_bounds."""
import numpy
from style import LINE, OUTER, plt

ORDER = ("open", "unpack", "digest", "read", "segment", "contour", "simplify", "triangulate", "refine", "check", "hu", "encode",
         "collect", "assemble", "idle")


def stages(rows):
    figure, grid = plt.subplots(1, len(rows), figsize=(2.9 * len(rows), 4.4), layout="constrained", squeeze=False)
    for axes, row in zip(grid[0], rows):
        shown = [s for s in row["stages"] if s["ms"] >= 0.01 * row["total_ms"]]
        shown.sort(key=lambda s: ORDER.index(s["id"]) if s["id"] in ORDER else len(ORDER))
        places = numpy.arange(len(shown))
        axes.barh(places, [s["ms"] for s in shown], color=OUTER, height=0.7)
        for k, stage in zip(places, shown):
            if "bound_ms" in stage:
                axes.plot([stage["bound_ms"]] * 2, [k - 0.42, k + 0.42], color=LINE, lw=2)
        axes.set_yticks(places, [s["id"] for s in shown])
        axes.invert_yaxis()
        axes.set_title(f"{row['id']}, {row['total_ms']:.0f} ms", loc="left", fontsize=9)
        axes.set_xlabel("ms")
        axes.grid(True, axis="x")
        axes.set_axisbelow(True)
    return figure
