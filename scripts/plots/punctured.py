# SPDX-License-Identifier: Apache-2.0
"""punctured.py MESHES.json OUTDIR CLOSE_UP_NAME SHEETS_NAME: the local mesh around each hole before and
after (paper's Fig. 13) and the punctured slices whole (Fig. 20). MESHES.json is trocar-run's --meshes."""
import pathlib
import sys

import numpy
from style import HOLE, doubled_area, draw_mesh, draw_rings, mark_window, plane_axes, plt, read_json, save

FRESH = "#f3c78f"  # triangles that the cut made


def mesh_of(piece, step):
    return numpy.array(piece["vertices"], dtype=float).reshape(-1, 2) * step, numpy.array(piece["triangles"], dtype=int).reshape(-1, 3)


def rings_of(rings, step):
    return [numpy.array(ring, dtype=float).reshape(-1, 2) * step for ring in rings]


def fresh_triangles(before, after):
    """Which triangles of `after` are not in `before`, by their corners' places."""
    def keys(mesh):
        corners = mesh[0][mesh[1]]
        return [tuple(sorted(map(tuple, triangle))) for triangle in corners]
    old = set(keys(before))
    return numpy.array([key not in old for key in keys(after)], dtype=bool)


def main():
    document, out = read_json(sys.argv[1]), pathlib.Path(sys.argv[2])
    sheets = sorted(document["sheets"], key=lambda sheet: -sheet["z_m"])
    step_mm = 2.0 ** -document["lattice_bits"]
    n = len(sheets)

    close, axes = plt.subplots(n, 2, figsize=(11, 5.3 * n), layout="constrained", squeeze=False)
    whole, faces = plt.subplots(1, n, figsize=(max(7.5, 5.2 * n), 5.7), layout="constrained", squeeze=False)
    everything = numpy.vstack([mesh_of(sheet["before"], step_mm)[0] for sheet in sheets])
    low, high = everything.min(axis=0) - 3, everything.max(axis=0) + 3
    for row, sheet in enumerate(sheets):
        before, after = mesh_of(sheet["before"], step_mm), mesh_of(sheet["after"], step_mm)
        tools = [rings_of([cut["tool"]], step_mm)[0] for cut in sheet["cuts"]]
        holes = [ring for cut in sheet["cuts"] for ring in rings_of(cut["hole"], step_mm)]
        if not holes:
            sys.exit(f"punctured.py: slice {sheet['slice']} has no hole")
        around = numpy.vstack(holes)
        centre, half = (around.min(axis=0) + around.max(axis=0)) / 2, 2.8 * numpy.ptp(around, axis=0).max() / 2
        window = (centre - half, centre + half)
        new = fresh_triangles(before, after)
        name = f"slice {sheet['slice']} at {100 * sheet['z_m']:g} cm"
        removed = sum(doubled_area(ring) for ring in holes) / 2
        plane_axes(axes[row, 0], f"{name}, before: {len(before[1])} triangles, and the tool", window)
        draw_mesh(axes[row, 0], *before, width=0.7)
        draw_rings(axes[row, 0], tools, HOLE, 1.8)
        plane_axes(axes[row, 1], f"after: {len(after[1])} triangles, {int(new.sum())} of them new; {removed:.3f} mm\N{SUPERSCRIPT TWO} removed", window)
        draw_mesh(axes[row, 1], after[0], after[1][~new], width=0.7)
        draw_mesh(axes[row, 1], after[0], after[1][new], fill=FRESH, width=0.7)
        draw_rings(axes[row, 1], holes, HOLE, 1.8)

        plane_axes(faces[0, row], f"{name}: {len(after[1])} triangles", (low, high))
        draw_mesh(faces[0, row], *after, width=0.25)
        draw_rings(faces[0, row], holes, HOLE, 1.4)
        mark_window(faces[0, row], window)
    close.suptitle("Local remeshing around the tool", x=0.01, ha="left")
    whole.suptitle("Punctured slices" if n > 1 else "Punctured slice", x=0.01, ha="left")
    save(close, out / f"{sys.argv[3]}.png")
    save(whole, out / f"{sys.argv[4]}.png")


if __name__ == "__main__":
    main()
