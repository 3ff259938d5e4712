# SPDX-License-Identifier: Apache-2.0
"""The plot of the report's section on re-meshing. Rows are those of cut_bench."""
from style import GREY, HOLE, OUTER, plt


def stages(rows):
    sizes = sorted({row["vertices"] for row in rows})
    names = list(dict.fromkeys(row["what"] for row in rows))
    figure, axes = plt.subplots(figsize=(9.5, 0.6 + 0.5 * len(names)), layout="constrained")
    for k, (size, color) in enumerate(zip(sizes, (OUTER, HOLE))):
        for row in (row for row in rows if row["vertices"] == size):
            y = names.index(row["what"]) + 0.28 * (k - 0.5)
            first = row["what"] == names[0]
            axes.plot([row["median_us"], row["p99_us"]], [y, y], color=color, lw=1.2)
            axes.plot(row["median_us"], y, "o", color=color if "CGAL" not in row["what"] else "white", mec=color, ms=6,
                      label=f"{size:,} vertices" if first else None)
    axes.axhline(names.index("replica, after the hand-over") + 0.5, color=GREY, lw=0.8, ls=":")
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xscale("log")
    axes.set_xlabel("CPU time (us)")
    axes.grid(True, axis="x")
    axes.legend(fontsize=8)
    return figure
