# SPDX-License-Identifier: Apache-2.0
"""overview.py STAGES.json SLICE.png MESHES.json RECORDING.csv OUT.png: the whole path in one picture, for the
README: a slice with its outline, its mesh, the hole, and the force on the hand."""
import pathlib
import sys

import numpy
from style import HOLE, OUTER, draw_mesh, draw_rings, plane_axes, plt, read_json, read_recording, save


def main():
    stages, picture, sheets = read_json(sys.argv[1]), plt.imread(sys.argv[2]), read_json(sys.argv[3])
    recording = read_recording(sys.argv[4])
    sx, sy = stages["spacing_mm"]
    rings = [numpy.array(ring) for ring in stages["pslg_mm"]]
    points = numpy.vstack(rings)
    centre, half = (points.min(axis=0) + points.max(axis=0)) / 2, numpy.ptp(points, axis=0).max() / 2 + 6
    window = (centre - half, centre + half)
    figure, axes = plt.subplots(1, 4, figsize=(20, 5), layout="constrained")
    for panel in axes:
        panel.set_box_aspect(1)  # all panels of the same height

    plane_axes(axes[0], f"CT slice {stages['slice']} and its outline, {len(points)} vertices", window)
    height, width = picture.shape[:2]
    axes[0].imshow(picture[..., :3] if picture.ndim == 3 else picture, cmap="gray", interpolation="nearest",
                   extent=(-sx / 2, (width - 0.5) * sx, (height - 0.5) * sy, -sy / 2))
    draw_rings(axes[0], rings, "#ff9d2e", 1.4)
    axes[0].set_xlim(window[0][0], window[1][0])
    axes[0].set_ylim(window[1][1], window[0][1])

    vertices, triangles = numpy.array(stages["refined"]["vertices_mm"]), numpy.array(stages["refined"]["triangles"])
    plane_axes(axes[1], f"refined mesh, {len(triangles)} triangles", window)
    draw_mesh(axes[1], vertices, triangles, width=0.4)
    draw_rings(axes[1], rings, OUTER, 0.9)

    step = 2.0 ** -sheets["lattice_bits"]
    sheet = next(s for s in sheets["sheets"] if s["cuts"])
    holes = [numpy.array(ring, dtype=float) * step for cut in sheet["cuts"] for ring in cut["hole"]]
    centre = numpy.vstack(holes).mean(axis=0)
    after = sheet["after"]
    plane_axes(axes[2], "punctured: the mesh around the hole", (centre - 11, centre + 11))
    draw_mesh(axes[2], numpy.array(after["vertices"], dtype=float) * step, numpy.array(after["triangles"]), width=0.7)
    draw_rings(axes[2], holes, HOLE, 2.0)

    axes[3].plot(recording["t_s"], recording["fz_delivered_N"], color=HOLE, lw=1.8)
    axes[3].set(xlabel="time (s)", ylabel="force on the hand (N)", xlim=(0, float(recording["t_s"][-1])))
    axes[3].set_title("three slices punctured one after the other", loc="left")
    axes[3].grid(True)
    save(figure, pathlib.Path(sys.argv[5]), draw_caption=False)


if __name__ == "__main__":
    main()
