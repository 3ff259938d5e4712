# SPDX-License-Identifier: Apache-2.0
"""The plots of the report's section on the cutting law. Rows are those of cutting_sweep."""
from style import GREY, HOLE, LINE, OUTER, THRESHOLD, plt

LEAST = 1e-7  # the tolerance of a tick's forces; smaller errors are chance


def curve(axes, rows, key, color, label, marker="o"):
    x, y = [row["p50_us"] for row in rows], [max(row[key], LEAST) for row in rows]
    axes.loglog(x, y, marker + "-", color=color, ms=5, lw=1.3, label=label)
    for row, at_x, at_y in zip(rows, x, y):
        axes.annotate(f"{row['value']:g}", (at_x, at_y), xytext=(5, 3), textcoords="offset points", fontsize=8, color=color)


def pareto(rows):
    def of(setting, points):
        return [row for row in rows if row["setting"] == setting and row["points_a_slab"] == points]

    figure, (whole, side, steps) = plt.subplots(1, 3, figsize=(12.5, 4.2), layout="constrained")
    for points, color, marker in ((2, OUTER, "o"), (1, HOLE, "s")):
        label = f"{points} Gauss point{'s' if points > 1 else ''} a slab"
        curve(whole, of("slabs", points), "error_rms", color, label, marker)
        curve(side, of("slabs", points), "side_error_rms", color, label, marker)
    whole.set_title("number of slabs in 32 mm: whole force", loc="left")
    side.set_title("number of slabs: force across the shaft", loc="left")
    capped = of("Newton steps", 2)
    curve(steps, capped, "error_rms", OUTER, "root mean square")
    curve(steps, capped, "error_max", THRESHOLD, "worst tick", "^")
    steps.set_title("most Newton steps a tick, 64 slabs", loc="left")
    for axes in (whole, side, steps):
        low, high = axes.get_xlim()
        ticks = [t for t in (0.5, 1, 2, 3, 5, 7, 10, 15, 20, 30) if low <= t <= high]
        axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
        axes.set_xticks([], minor=True)
        axes.set(xlabel="median time of a tick (\N{MICRO SIGN}s)", ylabel="force error over the peak force (1)")
        axes.grid(True)
        axes.legend(fontsize=8)
        axes.tick_params(colors=LINE)
    return figure


def stability(rows):
    """Energy given to the hand beside the sampled-data bound, and beside that of predicted poses."""
    least_J = 1e-12
    figure, (damped, ahead) = plt.subplots(1, 2, figsize=(11, 3.8), layout="constrained", sharey=True)
    for axes, kind, color, label in ((damped, "damping", OUTER, "evaluated where the plate is"),
                                     (ahead, "held", GREY, "evaluated where the plate is"),
                                     (ahead, "predicted", OUTER, "evaluated a tick ahead")):
        of = [row for row in rows if row["kind"] == kind]
        axes.semilogy([row["value"] for row in of], [max(row["given_J"], least_J) for row in of], "o-", color=color, ms=4, lw=1.3, label=label)
    damped.axvline(1, color=THRESHOLD, lw=1, ls="--", label="K T / 2: the sampled-data bound")
    ahead.axvline(0.5, color=THRESHOLD, lw=1, ls="--", label="0.5: what sessions keep to")
    ahead.set_xscale("log")
    damped.set(xlabel="device's damping over K T / 2 (1)", ylabel="most energy given to the hand (J)")
    ahead.set(xlabel="K T\N{SUPERSCRIPT TWO} / M (1), without damping")
    for axes in (damped, ahead):
        axes.grid(True)
        axes.legend(fontsize=8)
    return figure


def published_forces(rows):
    """Predicted forces over published ones with their bands; rows that are no force are left out."""
    rows = [row for row in rows if row["unit"] == "N"]
    figure, axes = plt.subplots(figsize=(9.5, 7.5), layout="constrained")
    ends = [5e-4, 3e3]
    axes.plot(ends, ends, color=GREY, lw=0.8)
    axes.fill_between(ends, [end / 1.5 for end in ends], [1.5 * end for end in ends], color=GREY, alpha=0.2, label="within a factor of 1.5")
    for k, row in enumerate(rows):
        x, y = row["published_mean"], row["predicted"]
        color = GREY if row["standing"] != "counted" else THRESHOLD if row["is_hit"] else HOLE
        axes.errorbar(x, y, xerr=[[x - row["published_low"]], [row["published_high"] - x]], yerr=[[y - row["predicted_low"]], [row["predicted_high"] - y]],
                      fmt="o", color=color, ms=5, lw=0.9, label=f"{k + 1} {row['id']}")
        axes.annotate(str(k + 1), (x, y), xytext=(5, 4), textcoords="offset points", fontsize=8)
    axes.set(xscale="log", yscale="log", xlim=ends, ylim=ends, xlabel="published (N)", ylabel="by the law (N); grey: not counted, red: missed")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=8)
    axes.grid(True)
    return figure
