# SPDX-License-Identifier: Apache-2.0
"""The plots of the report's section on the device. Data are those of device_sweep."""
import matplotlib.colors
import numpy
from style import GREY, HOLE, LINE, OUTER, THRESHOLD, plt

RING_COLOURS = (OUTER, HOLE)


def condition_maps(rings, extent_m, kind):
    """One row per ring of legs, one column per height; white where a leg cannot reach."""
    chosen = [[m for m in ring["maps"] if m["extent_m"] == extent_m] for ring in rings]
    heights = len(chosen[0])
    figure, grid = plt.subplots(len(rings), heights, figsize=(2.5 * heights + 1.2, 5.4), layout="constrained", squeeze=False,
                                sharex=True, sharey=True)
    top = max(numpy.max(m[kind]) for maps in chosen for m in maps)
    colours = matplotlib.colormaps["viridis"].copy()
    colours.set_bad("white")
    for line, ring, maps in zip(grid, rings, chosen):
        for axes, each in zip(line, maps):
            values = numpy.array(each[kind])
            edge = 1000 * extent_m
            image = axes.imshow(numpy.ma.masked_less_equal(values, 0), origin="lower", extent=(-edge, edge, -edge, edge),
                                vmin=0, vmax=top, cmap=colours, interpolation="nearest")
            levels = [level for level in (0.02, 0.1) if values.min() < level < values.max()]
            if levels:
                at = numpy.linspace(-edge, edge, len(values))
                axes.contour(at, at, values, levels=levels, colors=[HOLE, "white"][-len(levels):], linewidths=1)
            if extent_m > 0.02:
                axes.add_patch(plt.Rectangle((-20, -20), 40, 40, fill=False, color="white", lw=0.9, ls="--"))
            range_shown = f"{values.min():.3f} .. {values.max():.3f}" if values.min() > 0 else f"up to {values.max():.3f}"
            axes.set_title(f"z = {1000 * each['z_m']:g} mm: {range_shown}", fontsize=8.5)
        line[0].set_ylabel(f"{ring['id']}\ny (mm)")
    for axes in grid[-1]:
        axes.set_xlabel("x (mm)")
    figure.colorbar(image, ax=grid, label="inverse condition number", shrink=0.8)
    return figure


def by_tilt(rings):
    figure, panels = plt.subplots(1, 3, figsize=(11.5, 3.8), layout="constrained")
    for ring, color in zip(rings, RING_COLOURS):
        rows = [row for row in ring["rows"] if "tilt_deg" in row]
        tilt = [row["tilt_deg"] for row in rows]
        for key, style, name in (("median", "-", "median"), ("p1", "--", "1 %"), ("min", ":", "least")):
            panels[0].semilogy(tilt, [max(row[f"inverse_condition_{key}"], 1e-5) for row in rows], style, color=color, lw=1.5,
                               label=f"{ring['id']}: {name}")
        panels[1].plot(tilt, [row["share_below_0.1_percent"] for row in rows], color=color, lw=1.5, label=f"{ring['id']}: below 0.1")
        panels[1].plot(tilt, [row["share_below_0.02_percent"] for row in rows], "--", color=color, lw=1.5, label=f"{ring['id']}: below 0.02")
        panels[2].semilogy(tilt, [row["torque_for_35N_median_Nm"] for row in rows], color=color, lw=1.5, label=f"{ring['id']}: median")
        panels[2].semilogy(tilt, [row["torque_for_35N_max_Nm"] for row in rows], ":", color=color, lw=1.5, label=f"{ring['id']}: largest")
    panels[0].axhline(0.02, color=GREY, lw=0.8)
    panels[0].set_ylabel("inverse condition number")
    panels[1].set_ylabel("poses below (%)")
    panels[2].axhline(6, color=GREY, lw=0.8)
    panels[2].set_ylim(2, 200)
    panels[2].set_ylabel("torque for 35 N, worst direction (N m)")
    for axes in panels:
        axes.set_xlabel("tilt of the plate (deg)")
        axes.grid(True)
        axes.legend(fontsize=7)
    return figure


def allocation(rows):
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 3.8), layout="constrained")
    force = [row["force_N"] for row in rows]
    for key, color, style, name in (("feasible_percent", GREY, "-", "possible within the limits"),
                                    ("exact_percent", OUTER, "-", "delivered exactly"),
                                    ("minimum_norm_fits_percent", HOLE, "--", "the pseudo-inverse alone fits")):
        left.plot(force, [row[key] for row in rows], style, color=color, lw=1.6, label=name)
    left.set(xlabel="wanted force (N), with a moment of up to 0.05 m times it", ylabel="random poses and directions (%)", ylim=(0, 103))
    for key, style, name in (("max", ":", "largest"), ("p95", "--", "95 %"), ("median", "-", "median")):
        right.plot(force, [row[f"clipping_direction_error_{key}_deg"] for row in rows], style, color=HOLE, lw=1.6, label=f"clipping, {name}")
    right.plot(force, [row["direction_error_max_deg"] for row in rows], color=OUTER, lw=1.6, label="Trocar, largest")
    right.plot(force, [100 * (1 - row["mean_scale"]) for row in rows], "-", color=THRESHOLD, lw=1.2, label="Trocar: mean reduction of the force (%)")
    right.set(xlabel="wanted force (N)", ylabel="direction error of the force (deg)")
    for axes in (left, right):
        axes.grid(True)
        axes.legend(fontsize=8)
        axes.tick_params(colors=LINE)
    return figure
