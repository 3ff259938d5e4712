# SPDX-License-Identifier: Apache-2.0
"""The plot of the report's section on conditioning. Rows are those of conditioning_sweep."""
from style import GREY, HOLE, OUTER, plt

LEAST = 1e-17
UNIT = 2.0 ** -53


def bars(axes, rows, title, series):
    """series: [(label, colour, key of the error, key of the bound or None)]."""
    for k, row in enumerate(rows):
        for shift, (label, color, key, bound) in zip((-0.14, 0.14), series):
            y = k + (shift if len(series) > 1 else 0)
            if key in row:
                axes.plot(max(row[key], LEAST), y, "o", color=color, ms=5, label=label if k == 0 else None)
            if bound is not None and bound in row:
                axes.plot(row[bound], y, "|", color=color, ms=9, mew=1.4)
    axes.axvline(UNIT, color=GREY, lw=0.8, ls=":")
    axes.set_yticks(range(len(rows)), [row["id"] for row in rows], fontsize=8)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xscale("log")
    axes.grid(True, axis="x")
    axes.set_title(title, loc="left")
    axes.legend(fontsize=8)


def errors(data):
    heights = [len(data[part]) for part in ("network", "jacobian", "allocation")]
    figure, grid = plt.subplots(3, 1, figsize=(10.5, 1.5 + 0.34 * sum(heights)), layout="constrained", height_ratios=heights, sharex=True)
    bars(grid[0], data["network"], "network (local solver)",
         (("displacements", OUTER, "displacement_error_local", "bound"), ("stiffness", HOLE, "stiffness_error_local", "stiffness_bound")))
    bars(grid[1], data["jacobian"], "Jacobian", (("compact form", OUTER, "error_compact", "bound"),))
    bars(grid[2], data["allocation"], "torque allocation", (("torques", OUTER, "torque_error", None), ("scale", HOLE, "scale_error", None)))
    grid[2].set_xlabel("largest relative error (dots), its bound (bars)")
    return figure
