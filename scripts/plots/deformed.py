# SPDX-License-Identifier: Apache-2.0
"""deformed.py FRAMES.jsonl SHEETS.json OUT.png: the sheet around the tool before contact, just before the
puncture, and after it with its hole (trocar-run --frames, --meshes; one sheet, force law `network`)."""
import json
import pathlib
import sys

import numpy
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from style import BONE, HOLE, LINE, OUTER, plt, read_json, save

WINDOW_MM = 14  # around the tool, to each side
ABOVE_MM = 7    # how much of the tool is drawn
LIGHT = numpy.array([-0.4, -0.5, 0.77])


def rgb(colour):
    return numpy.array([int(colour[k:k + 2], 16) / 255 for k in (1, 3, 5)])


def read_frames(path):
    """The frames, each with its shape."""
    shapes, frames = {}, []
    for line in pathlib.Path(path).read_text(encoding="ascii").splitlines():
        row = json.loads(line)
        if "triangles" in row:
            shapes[row["shape"]] = row
        else:
            frames.append({**row, "shape": shapes.get(row["shape"])})
    return frames


def in_scene_mm(sheet, points, step_mm):
    """Lattice points into the scene's x and y (formats/session/scene.h, Placement)."""
    p = step_mm * numpy.asarray(points, dtype=float).reshape(-1, 2) - sheet["anchor_mm"]
    angle = numpy.radians(sheet["rotation_deg"])
    rotated = p @ numpy.array([[numpy.cos(angle), numpy.sin(angle)], [-numpy.sin(angle), numpy.cos(angle)]])
    return rotated + 1e3 * numpy.asarray(sheet["at_m"])


def clipped(polygon, centre):
    """The part of a polygon in space that lies in the window, cut at the window's four vertical planes."""
    for axis in (0, 1):
        for sign in (1, -1):
            inside = [sign * (p[axis] - centre[axis]) <= WINDOW_MM for p in polygon]
            kept = []
            for k, p in enumerate(polygon):
                q, q_inside = polygon[(k + 1) % len(polygon)], inside[(k + 1) % len(polygon)]
                if inside[k]:
                    kept.append(p)
                if inside[k] != q_inside:
                    t = (centre[axis] + sign * WINDOW_MM - p[axis]) / (q[axis] - p[axis])
                    kept.append(p + t * (q - p))
            polygon = kept
            if len(polygon) < 3:
                return None
    return numpy.array(polygon)


def surface(vertices, triangles, centre, depth_mm, z_mm):
    """Faces with their colours: shaded by a light from one side, bluer with depth."""
    for corner in vertices[triangles]:
        normal = numpy.cross(corner[1] - corner[0], corner[2] - corner[0])
        face = clipped(list(corner), centre)
        if face is None or not numpy.any(normal):
            continue
        normal = normal * numpy.sign(normal[2]) / numpy.linalg.norm(normal)
        sunk = min(1, max(0, (z_mm - corner[:, 2].mean()) / depth_mm))
        colour = (1 - 0.75 * sunk) * rgb(BONE) + 0.75 * sunk * rgb(OUTER)
        yield face, (*numpy.clip(colour * (0.6 + 0.45 * max(0, normal @ LIGHT)), 0, 1), 1), LINE


def tool(outline, tip_mm, z_mm):
    """The prism, in pieces of at most a millimetre that end at the sheet, so that matplotlib can sort them by depth."""
    top_mm = max(tip_mm, z_mm) + ABOVE_MM
    levels = [tip_mm]
    while levels[-1] < top_mm - 1e-6:
        step = min(1.0, top_mm - levels[-1])
        levels.append(z_mm if levels[-1] < z_mm - 1e-6 < levels[-1] + step else levels[-1] + step)
    colour = (*rgb(HOLE), 0.45)
    yield numpy.column_stack([outline, numpy.full(len(outline), tip_mm)]), colour, HOLE
    yield numpy.column_stack([outline, numpy.full(len(outline), top_mm)]), colour, HOLE
    for low, high in zip(levels, levels[1:]):
        for p, q in zip(outline, numpy.roll(outline, -1, axis=0)):
            yield numpy.array([(*p, low), (*q, low), (*q, high), (*p, high)]), colour, (0, 0, 0, 0)


def main():
    frames, document = read_frames(sys.argv[1]), read_json(sys.argv[2])
    sheet, step_mm = document["sheets"][0], 2.0 ** -document["lattice_bits"]
    outline = in_scene_mm(sheet, sheet["cuts"][0]["tool"], step_mm)
    centre, z_mm = outline.mean(axis=0), 1e3 * sheet["z_m"]
    contact = [k for k, frame in enumerate(frames) if frame["state"] == "contact" and frame["depth_m"] > 0]
    if not contact:
        sys.exit("deformed.py: no frame is in contact")
    before, at, after = frames[max(0, contact[0] - 1)], frames[contact[-1]], frames[-1]
    after = next((frame for frame in frames[contact[-1] + 1:] if frame["state"] == "punctured"), after)
    depth_mm = 1e3 * at["depth_m"]

    def flat(mesh):
        p = in_scene_mm(sheet, mesh["vertices"], step_mm)
        return numpy.column_stack([p, numpy.full(len(p), z_mm)]), numpy.array(mesh["triangles"]).reshape(-1, 3)

    shape = at["shape"]
    place = 1e3 * numpy.array(shape["vertices_m"], dtype=float).reshape(-1, 2)
    sunk = numpy.column_stack([place, z_mm - depth_mm * numpy.array(shape["w"])]), numpy.array(shape["triangles"]).reshape(-1, 3)
    panels = ((before, flat(sheet["before"]), "before"), (at, sunk, f"at {at['wanted_z_N']:.1f} N, {depth_mm:.2f} mm deep"),
              (after, flat(sheet["after"]), "after the puncture"))

    figure = plt.figure(figsize=(16, 5.4))
    low_mm = min(z_mm - depth_mm, 1e3 * after["tip_m"][2]) - 1
    for k, (frame, (vertices, triangles), title) in enumerate(panels):
        axes = figure.add_subplot(1, 3, k + 1, projection="3d")
        tip_mm = 1e3 * frame["tip_m"][2]
        sheet_faces, tool_faces = [*surface(vertices, triangles, centre, depth_mm, z_mm)], [*tool(outline, tip_mm, z_mm)]
        # A tool above the sheet is drawn in front of all of it; otherwise the pieces are sorted by distance.
        layers = [sheet_faces, tool_faces] if tip_mm > z_mm else [sheet_faces + tool_faces]
        axes.computed_zorder = False
        for order, layer in enumerate(layers):
            faces, colours, edges = zip(*layer)
            axes.add_collection3d(Poly3DCollection(faces, facecolors=colours, edgecolors=edges, linewidths=0.35, zorder=order + 1))
        axes.set_title(f"{title} (t = {frame['t_s']:.2f} s)", loc="left", x=0.06, y=0.97)
        axes.set(xlim=centre[0] + numpy.array([-1, 1]) * WINDOW_MM, ylim=centre[1] + numpy.array([-1, 1]) * WINDOW_MM,
                 zlim=(low_mm, z_mm + ABOVE_MM + 1), xlabel="x (mm)", ylabel="y (mm)")
        axes.set_zlabel("z (mm)", labelpad=7)
        axes.tick_params(labelsize=8)
        axes.patch.set_visible(False)  # it would cover the ticks of the panel before
        axes.set_box_aspect((2 * WINDOW_MM, 2 * WINDOW_MM, numpy.ptp(axes.get_zlim())))
        axes.view_init(elev=30, azim=-62)
    figure.subplots_adjust(left=0, right=0.97, bottom=0.02, top=0.95, wspace=0.1)
    figure.text(1.01, 0, " ")  # space for the last panel's z label
    save(figure, sys.argv[3])


if __name__ == "__main__":
    main()
