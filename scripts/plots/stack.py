# SPDX-License-Identifier: Apache-2.0
"""stack.py FOLDER REPORT.json OUT.png: all slices of an asset stacked in space, the counterpart
of the paper's Fig. 10. FOLDER is `trocar-mesh export`'s, with one .obj a slice."""
import pathlib
import sys

import numpy
from matplotlib import colormaps
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from style import plt, read_json, save


def read_obj(path):
    vertices, faces = [], []
    for line in path.read_text().splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(word) for word in words[1:4]])
        elif words[:1] == ["f"]:
            faces.append([int(word.split("/")[0]) - 1 for word in words[1:4]])
    return numpy.array(vertices).reshape(-1, 3), numpy.array(faces, dtype=int).reshape(-1, 3)


def main():
    folder, report, out = pathlib.Path(sys.argv[1]), read_json(sys.argv[2]), sys.argv[3]
    pieces = sorted((piece["z_mm"], folder / f"slice_{piece['index']:04d}.obj")
                    for piece in report["slices"] if piece["triangles"])
    figure = plt.figure(figsize=(9.5, 8), layout="constrained")
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    low, high, total = numpy.full(3, numpy.inf), numpy.full(3, -numpy.inf), 0
    colours = colormaps["YlOrBr"]
    for order, (z, path) in enumerate(pieces):
        vertices, faces = read_obj(path)
        vertices = numpy.column_stack([vertices[:, 0], vertices[:, 1], numpy.full(len(vertices), z)])
        shade = colours(0.05 + 0.45 * order / max(len(pieces) - 1, 1))
        axes.add_collection3d(Poly3DCollection(vertices[faces], facecolors=[shade], edgecolors="#3b3226",
                                               linewidths=0.12, zorder=order))
        low, high = numpy.minimum(low, vertices.min(axis=0)), numpy.maximum(high, vertices.max(axis=0))
        total += len(faces)
    stretch = 2.0  # the slices would hide each other at true scale
    axes.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]), zlim=(low[2], high[2]),
             xlabel="u (mm)", ylabel="v (mm)", zlabel="z (mm)")
    axes.set_box_aspect((high - low) * [1, 1, stretch], zoom=1.12)
    axes.view_init(elev=30, azim=-125)
    axes.set_title(f"{len(pieces)} slices, {total} triangles (z stretched {stretch:g} times)", loc="left")
    save(figure, out)


if __name__ == "__main__":
    main()
