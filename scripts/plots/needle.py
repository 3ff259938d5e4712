# SPDX-License-Identifier: Apache-2.0
"""needle.py RECORDING.csv SUMMARY.json SCENE.json NAME OUTDIR: a needle through a vertebra by the force law cutting: the force over
the depth of the tip, and the HU under the tool over the depth of its front (needle.png)."""
import pathlib
import sys

import numpy
from style import GREY, HOLE, OUTER, plt, read_json, read_recording, save


def main():
    recording, summary, scene = read_recording(sys.argv[1]), read_json(sys.argv[2]), read_json(sys.argv[3])
    name, out = sys.argv[4], pathlib.Path(sys.argv[5])
    top_m = scene["body"]["top_z_m"]
    depth = 1e3 * (top_m - recording["tool_z_m"])
    lowest = int(numpy.argmax(depth))
    figure, axes = plt.subplots(2, 1, figsize=(9, 7), sharex=True, height_ratios=(1.6, 1), layout="constrained")
    force = recording["fz_tissue_N"]
    axes[0].plot(depth[:lowest], force[:lowest], color=OUTER, lw=1.6, label="on the way in: all of the tissue")
    axes[0].plot(depth[:lowest], recording["tip_N"][:lowest], color=HOLE, lw=1.1, ls="--", label="of it the tip")
    axes[0].plot(depth[lowest:], force[lowest:], color=GREY, lw=1.3, label="on the way out")
    axes[0].set(ylabel="force along the needle (N)")
    axes[0].axhline(0, color=GREY, lw=0.6)
    axes[0].legend(loc="upper left")
    front = 1e3 * (top_m - recording["front_z_m"])
    hu = numpy.where(recording["front_HU"] > -1000, recording["front_HU"], numpy.nan)
    cutting = recording["tip_N"] > 0
    axes[1].plot(front[:lowest][cutting[:lowest]], hu[:lowest][cutting[:lowest]], color=OUTER, ls="", marker=".", ms=3)
    axes[1].set(ylabel="HU under the tool", xlabel="depth below the highest slice: of the tip, and below of the front (mm)")
    for panel in axes:
        panel.grid(True)
    cut = summary["cutting"]
    save(figure, out / "needle.png", what=name, largest=float(force.max()), deepest=float(depth.max()),
         work=1e3 * cut["front_work_J"], slices=len(summary["punctures"]), scale=cut["force_scale"])


if __name__ == "__main__":
    main()
