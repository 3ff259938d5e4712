# SPDX-License-Identifier: Apache-2.0
"""The plots of the report's section on deformation. Rows are those of deformation_sweep."""
import numpy
from pipeline_plots import short_range
from style import HOLE, OUTER, THRESHOLD, plt

METHODS = {"propagation": (HOLE, "s", "propagation"), "local": (OUTER, "o", "local"), "auto": (THRESHOLD, "*", "auto")}
LEAST = 1e-7  # smaller errors are rounding


def answer_us(row):
    """From the sheet to the answer at a new place; none for propagation, which may use the sheet's own mesh."""
    if row["method"] == "propagation":
        return None
    return row.get("answer_us", row.get("mesh_us", 0) + row["prepare_us"])


def label(row):
    return f"{100 * row['parameter']:g} %" if row["method"] == "auto" else f"{row['parameter']:g}"


def pareto(curves):
    figure, grid = plt.subplots(len(curves), 3, figsize=(12, 3.6 * len(curves)), layout="constrained", squeeze=False)
    panels = (("force_error", "force error", lambda row: row["solve_us"], "\N{MICRO SIGN}s per solve"),
              ("displacement_error", "displacement error", lambda row: row["solve_us"], "\N{MICRO SIGN}s per solve"),
              ("force_error", "force error", answer_us, "\N{MICRO SIGN}s from the sheet to an answer"))
    for line, (scan, methods) in zip(grid, curves.items()):
        for axes, (key, name, time, time_name) in zip(line, panels):
            for method, rows in methods.items():
                color, marker, title = METHODS[method]
                if time(rows[0]) is None:
                    continue
                x = numpy.array([time(row) for row in rows])
                y = numpy.maximum([row[key] for row in rows], LEAST)
                size = 11 if method == "auto" else 4
                axes.loglog(x, y, marker + ("" if method == "auto" else "-"), color=color, ms=size, lw=1.1, label=title)
                for k, row in enumerate(rows):
                    if y[k] > LEAST and (method == "auto" or k in (0, 1, 2, 3, 5, 7, 9, 11)):
                        axes.annotate(label(row), (x[k], y[k]), xytext=(4, 4), textcoords="offset points", fontsize=7, color=color)
            axes.set(xlabel=time_name, ylabel=name, ylim=(LEAST / 2, 10))
            if time is answer_us:  # similar for all: dominated by the meshing
                axes.set_xscale("linear")
                axes.set_xlim(0, 1.15 * axes.get_xlim()[1])
                axes.grid(True)
            else:
                short_range(axes, y=False)
        line[0].set_title(scan, loc="left", fontweight="bold")
    handles, labels = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, fontsize=9)
    return figure
