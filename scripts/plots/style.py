# SPDX-License-Identifier: Apache-2.0
"""Shared by the plots: colours and fonts, readers of the programs' outputs, writing of a picture with its caption."""
import csv
import json
import os
import pathlib
import textwrap

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy  # noqa: E402

from captions import CAPTIONS  # noqa: E402

BONE = "#e9dfc9"       # material
LINE = "#2f4858"       # mesh edges
OUTER = "#1f6fb4"      # outer boundaries, positions
HOLE = "#c8452d"       # holes, forces, the tool
GREY = "#7a7a7a"
THRESHOLD = "#3a8f4b"

plt.rcParams.update({
    "figure.dpi": 130, "savefig.dpi": 130, "font.family": "DejaVu Sans", "font.size": 10,
    "axes.titlesize": 10.5, "figure.titlesize": 12.5, "axes.spines.top": False,
    "axes.spines.right": False, "axes.grid": False, "grid.color": "#dddddd", "grid.linewidth": 0.6,
    "legend.frameon": False, "path.simplify": False,
})


def save_plain(figure, path, **metadata):
    """Writes the PNG, complete or not at all; the same data give the same bytes."""
    path = pathlib.Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    figure.savefig(temporary, format="png", bbox_inches="tight", pad_inches=0.12, metadata={"Software": None, **metadata})
    os.replace(temporary, path)
    plt.close(figure)
    print(path)


def save(figure, path, draw_caption=True, **numbers):
    """Writes the PNG with its caption: the one of that name in captions.py with `numbers` filled in. It is drawn
    below the figure unless draw_caption is False, and stored as the PNG's Description, which index.py reads."""
    caption = CAPTIONS[pathlib.Path(path).stem].format(**numbers)
    if draw_caption:
        width, height = figure.get_size_inches()
        figure.text(0.01, -0.12 / height, textwrap.fill(caption, int(13.5 * width)), ha="left", va="top", fontsize=9.5, color="#333333",
                    linespacing=1.35)
    save_plain(figure, path, Description=caption, Comment="caption drawn" if draw_caption else "caption not drawn")


def read_json(path):
    return json.loads(pathlib.Path(path).read_text())


def read_recording(path):
    """A recording's columns as {name: array}."""
    with open(path, encoding="ascii", newline="") as stream:
        names, *rows = csv.reader(stream)
    return {name: column_array(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}


def column_array(column):
    """Whole numbers if all texts of the column are such, else numbers if all are, else the texts."""
    texts = numpy.array(column)
    for kind in (int, float):
        try:
            return texts.astype(kind)
        except (ValueError, OverflowError):
            pass
    return texts


def plane_axes(axes, title, window=None):
    """The slice plane as the image shows it: u to the right, v down, equal scales."""
    axes.set_aspect("equal")
    axes.set_title(title, loc="left")
    axes.set_xlabel("u (mm)")
    axes.set_ylabel("v (mm)")
    if window is not None:
        (u0, v0), (u1, v1) = window
        axes.set_xlim(u0, u1)
        axes.set_ylim(v1, v0)
    else:
        axes.invert_yaxis()
    for side in ("top", "right"):
        axes.spines[side].set_visible(True)


def mark_window(axes, window):
    (u0, v0), (u1, v1) = window
    axes.add_patch(plt.Rectangle((u0, v0), u1 - u0, v1 - v0, fill=False, color="#e0a100", lw=1.2, zorder=9))


def draw_rings(axes, rings, color, width=1.0, **more):
    """Closed rings."""
    for ring in rings:
        closed = numpy.vstack([ring, ring[:1]])
        axes.plot(closed[:, 0], closed[:, 1], color=color, lw=width, **more)


def doubled_area(ring):
    ring = numpy.asarray(ring, dtype=float)
    following = numpy.roll(ring, -1, axis=0)
    return float(numpy.sum(ring[:, 0] * following[:, 1] - following[:, 0] * ring[:, 1]))


def draw_mesh(axes, vertices, triangles, fill=BONE, edge=LINE, width=0.5):
    if len(triangles) == 0:
        return
    axes.tripcolor(vertices[:, 0], vertices[:, 1], triangles, facecolors=numpy.zeros(len(triangles)),
                   cmap=matplotlib.colors.ListedColormap([fill]), edgecolors=edge, linewidth=width)


def corner_angles_deg(vertices, triangles):
    """Every triangle's three angles, n x 3."""
    corner = vertices[triangles]
    angles = []
    for k in range(3):
        a = corner[:, (k + 1) % 3] - corner[:, k]
        b = corner[:, (k + 2) % 3] - corner[:, k]
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        angles.append(numpy.degrees(numpy.arctan2(numpy.abs(cross), numpy.sum(a * b, axis=1))))
    return numpy.stack(angles, axis=1)


def triangle_areas(vertices, triangles):
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
