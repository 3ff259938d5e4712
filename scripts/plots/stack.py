# SPDX-License-Identifier: Apache-2.0
"""stack.py FOLDER REPORT.json PAPER_FOLDER PAPER_REPORT.json OUT.png: all slices of an asset stacked in space, by default
and with the paper's preset beside it; the counterpart of the paper's Fig. 10. A FOLDER is that of `trocar-mesh export`,
with one .obj for each slice."""
import pathlib
import sys

import numpy
from matplotlib import colormaps
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from style import plt, read_json, save

STRETCH = 2.0  # of z: at true scale the slices would hide each other


def read_obj(path):
    vertices, faces = [], []
    for line in path.read_text().splitlines():
        fields = line.split()
        if fields[:1] == ["v"]:
            vertices.append([float(field) for field in fields[1:4]])
        elif fields[:1] == ["f"]:
            faces.append([int(field.split("/")[0]) - 1 for field in fields[1:4]])
    return numpy.array(vertices).reshape(-1, 3), numpy.array(faces, dtype=int).reshape(-1, 3)


def plane_offset(folder, index):
    """From an .obj's patient frame to the slice plane's (u, v), in which the same slice's .poly is."""
    lines = (folder / f"slice_{index:04d}.poly").read_text().splitlines()
    count = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    outline = numpy.array([line.split()[1:3] for line in lines[count + 1:count + 1 + int(lines[count].split()[0])]], dtype=float)
    return outline.min(axis=0) - read_obj(folder / f"slice_{index:04d}.obj")[0][:, :2].min(axis=0)


def read_stack(folder, report):
    """The slices from the lowest up, z from 0: [(vertices, faces)]."""
    offset = plane_offset(folder, next(piece["index"] for piece in report["slices"] if piece["triangles"]))
    lowest = min(piece["z_mm"] for piece in report["slices"])
    stack = []
    for piece in sorted((piece for piece in report["slices"] if piece["triangles"]), key=lambda piece: piece["z_mm"]):
        vertices, faces = read_obj(folder / f"slice_{piece['index']:04d}.obj")
        stack.append((numpy.column_stack([vertices[:, :2] + offset, numpy.full(len(vertices), piece["z_mm"] - lowest)]), faces))
    return stack


def draw_stack(axes, stack, low, high, name):
    colours = colormaps["YlOrBr"]
    for order, (vertices, faces) in enumerate(stack):
        shade = colours(0.05 + 0.45 * order / max(len(stack) - 1, 1))
        axes.add_collection3d(Poly3DCollection(vertices[faces], facecolors=[shade], edgecolors="#3b3226", linewidths=0.12, zorder=order))
    axes.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]), zlim=(low[2], high[2]), xlabel="u (mm)", ylabel="v (mm)")
    axes.set_zlabel("z (mm)", labelpad=2)
    axes.zaxis.set_rotate_label(False)
    axes.zaxis.label.set_rotation(90)
    axes.set_box_aspect((high - low) * [1, 1, STRETCH], zoom=1.15)
    axes.view_init(elev=30, azim=-125)
    axes.patch.set_visible(False)
    axes.set_title(f"{name}: {len(stack)} slices, {sum(len(faces) for _, faces in stack)} triangles", loc="left")


def main():
    reports = [read_json(sys.argv[2]), read_json(sys.argv[4])]
    stacks = [read_stack(pathlib.Path(folder), report) for folder, report in zip((sys.argv[1], sys.argv[3]), reports)]
    points = numpy.vstack([vertices for stack in stacks for vertices, _ in stack])
    low, high = points.min(axis=0), points.max(axis=0)
    figure = plt.figure(figsize=(16, 7.4))
    for column, (stack, name) in enumerate(zip(stacks, ("default, sub-pixel", "paper's preset"))):
        axes = figure.add_subplot(1, 2, column + 1, projection="3d", computed_zorder=False)
        draw_stack(axes, stack, low, high, name)
    figure.subplots_adjust(left=0.02, right=0.98, bottom=0.04, top=0.93, wspace=0.14)
    figure.text(-0.02, 0, " ")  # space for the first panel's z label
    save(figure, sys.argv[5], stretch=STRETCH, island=reports[1]["parameters"]["min_region_mm2"])


if __name__ == "__main__":
    main()
