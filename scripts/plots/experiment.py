# SPDX-License-Identifier: Apache-2.0
"""experiment.py RECORDING.csv SUMMARY.json PAPER_RECORDING.csv SCENE.json OUTDIR POSITION_NAME FORCE_NAME: position and force
over time of a session, the counterparts of the paper's Fig. 16/18 and 17/19. PAPER_RECORDING.csv is the same session on
the mesh of the paper's preset."""
import pathlib
import sys

import numpy
from style import GREY, HOLE, OUTER, THRESHOLD, plt, read_json, read_recording, save


def time_axis(axes, t):
    """The same for both pictures; on the right there is space for the slices' heights and the last puncture's text."""
    axes.set(xlabel="time (s)", xlim=(t[0], t[-1] + 0.1 * (t[-1] - t[0])))
    axes.grid(True)


def main():
    recording, summary, scene = read_recording(sys.argv[1]), read_json(sys.argv[2]), read_json(sys.argv[4])
    same = "byte for byte the same" if pathlib.Path(sys.argv[1]).read_bytes() == pathlib.Path(sys.argv[3]).read_bytes() else "not the same"
    out = pathlib.Path(sys.argv[5])
    t, z, force = recording["t_s"], recording["tool_z_m"], recording["fz_wanted_N"]
    delivered = recording["fz_delivered_N"]
    punctures = summary["punctures"]
    heights = [piece["z_m"] for piece in scene["slices"]]
    threshold = scene.get("tissue", {}).get("threshold_N", 35.0)
    rate = round(1 / (t[1] - t[0]))
    title = f"{len(heights)} slice{'s' if len(heights) > 1 else ''}, {rate} Hz"

    figure, axes = plt.subplots(figsize=(9, 5))
    for k, height in enumerate(heights):
        axes.axhline(100 * height, color=GREY, lw=1.0, ls="--", label="slice" if k == 0 else None)
        axes.text(0.995, 100 * height, f"{100 * height:g} cm", va="bottom", ha="right", color=GREY, transform=axes.get_yaxis_transform())
    axes.plot(t, 100 * z, color=OUTER, lw=1.6, label="tool tip")
    for k, puncture in enumerate(punctures):
        axes.plot(puncture["t_s"], 100 * puncture["tool_z_m"], "o", color=HOLE, ms=6, label="puncture" if k == 0 else None)
    time_axis(axes, t)
    axes.set(ylabel="height of the tool tip (cm)")
    axes.set_title(f"Position: {title}", loc="left")
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, borderaxespad=0.2)
    figure.subplots_adjust(left=0.08, right=0.99, bottom=0.1, top=0.93)
    save(figure, out / f"{sys.argv[6]}.png", rate=rate, same=same)

    figure, axes = plt.subplots(figsize=(9, 5))
    axes.axhline(threshold, color=THRESHOLD, lw=1.0, ls="--", label=f"threshold {threshold:g} N")
    axes.plot(t, delivered, color="#f0b49b", lw=3.2, label="delivered by the motors")
    axes.plot(t, force, color=HOLE, lw=1.3, label="wanted")
    for puncture in punctures:
        depth = min(h for h in heights if h >= puncture["tool_z_m"]) - puncture["tool_z_m"]
        axes.annotate(f"slice {puncture['slice']}\n{puncture['tip_N']:.2f} N\n{1000 * depth:.2f} mm",
                      (puncture["t_s"], puncture["tip_N"]), (6, -10), textcoords="offset points", fontsize=9, va="top")
    time_axis(axes, t)
    axes.set(ylabel="force on the hand along z (N)", ylim=(-1.5, 1.1 * max(threshold, float(numpy.max(force)))))
    axes.set_title(f"Force: {title}", loc="left")
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, borderaxespad=0.2)
    figure.subplots_adjust(left=0.08, right=0.99, bottom=0.1, top=0.93)
    save(figure, out / f"{sys.argv[7]}.png", rate=rate)


if __name__ == "__main__":
    main()
