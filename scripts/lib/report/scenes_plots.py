# SPDX-License-Identifier: Apache-2.0
"""The plots of the report's section on scene loading. Rows are those of scene_sweep."""
from style import GREY, HOLE, OUTER, THRESHOLD, plt

COLOURS = {1: OUTER, 3: THRESHOLD, 35: HOLE}


def loading(scans):
    """scans: (name, rows of scenes, rows of whole files)."""
    panels = (("read_bytes", 1e3, "read (kB)"), ("read_peak_bytes", 1e3, "memory while reading (kB)"), ("read_ms", 1, "time to read (ms)"))
    figure, grid = plt.subplots(len(scans), len(panels), figsize=(12, 3.1 * len(scans)), layout="constrained", squeeze=False)
    for line, (name, rows, whole) in zip(grid, scans):
        for axes, (key, unit, title) in zip(line, panels):
            for slices, color in COLOURS.items():
                some = sorted((row["asset_slices"], row[key] / unit) for row in rows if row["scene_slices"] == slices)
                if some:
                    axes.plot(*zip(*some), "o-", color=color, ms=4.5, lw=1.2, label=f"a scene of {slices}")
            axes.plot(*zip(*sorted((row["asset_slices"], row[key] / unit) for row in whole)), "s--", color=GREY, ms=4, lw=1, label="the whole file")
            axes.set(xscale="log", yscale="log", xlabel="slices of the asset", ylabel=title)
            axes.grid(True)
        line[0].set_title(name, loc="left", fontweight="bold")
    grid[0][0].legend(fontsize=8)
    return figure
