# SPDX-License-Identifier: Apache-2.0
"""The plots of the report's section on the loop. Rows are those of loop_sweep."""
import numpy
from style import GREY, HOLE, OUTER, THRESHOLD, plt

RATE_COLOURS = {500: HOLE, 1000: OUTER, 2000: THRESHOLD, 4000: "#b07a1e", 8000: "#6a4c93"}


def traces(walls):
    figure, grid = plt.subplots(1, len(walls), figsize=(11.5, 3.3), layout="constrained")
    for axes, (plain, controlled) in zip(grid, walls):
        rest_mm = 1e3 * plain["pressed_N"] / plain["stiffness_N_per_m"]
        for row, color, name in ((plain, GREY, "without the controller"), (controlled, OUTER, "with it")):
            t_s, depth_mm = numpy.array(row["depth_mm_at_s"]).T
            axes.plot(t_s, depth_mm, color=color, lw=1.1, label=name, zorder=2 if row is controlled else 1)
        axes.axhline(rest_mm, color=THRESHOLD, lw=0.8, ls=":")
        axes.set_ylim(3 * rest_mm, -1.5 * rest_mm)
        axes.set_title(f"{plain['stiffness_N_per_m'] / 1e3:g} kN/m at {plain['rate_Hz']:g} Hz", loc="left")
        axes.set_xlabel("time (s)")
    grid[0].set_ylabel("depth in the sheet (mm)")
    grid[0].legend(fontsize=8, loc="lower left")
    return figure


def region(rows):
    figure, axes = plt.subplots(figsize=(9.5, 5.2), layout="constrained")
    for rate, color in RATE_COLOURS.items():
        some = [row for row in rows if row["rate_Hz"] == rate]
        for controlled in (False, True):
            of = [row for row in some if row["passivity_controller"] is controlled]
            axes.plot([row["wall_damping_N_s_per_m"] for row in of], [row["largest_stable_stiffness_N_per_m"] / 1e3 for row in of],
                      "o-", color=color, ms=4.5, lw=1.4 if controlled else 0.9, mfc=color if controlled else "white",
                      label=f"{rate:g} Hz" if controlled else None)
        if some:
            damping = some[0]["device_damping_N_s_per_m"]
            b = numpy.linspace(0, 0.995 * damping, 60)
            axes.plot(b, 2e-3 * rate * (damping - b), ":", color=color, lw=1.2)
    axes.set_yscale("log")
    axes.set_xscale("symlog", linthresh=2, linscale=1.2)
    ticks = (0, 1, 2, 5, 10, 20, 40)
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_ylim(0.3, 1.3e3)
    axes.set_xlim(-0.15, 45)
    axes.grid(True)
    axes.set(xlabel="damping B of the wall (N s/m)", ylabel="largest stable stiffness K (kN/m)")
    axes.legend(fontsize=8, ncols=5, loc="lower center", bbox_to_anchor=(0.5, 1), title="full: with the controller; open: without; dotted: b > K T / 2 + |B|", title_fontsize=8)
    return figure
