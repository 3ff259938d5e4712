# SPDX-License-Identifier: Apache-2.0
"""punctured.py SHEETS.json PAPER_SHEETS.json OUTDIR CLOSE_UP_NAME SHEETS_NAME: the local mesh around each hole before and
after the puncture (paper's Fig. 13) and the whole punctured slices (Fig. 20), by default and with the paper's preset
beside it. SHEETS.json is that of trocar-run --meshes."""
import dataclasses
import pathlib
import sys

import numpy
from style import HOLE, doubled_area, draw_mesh, draw_rings, mark_window, plane_axes, plt, read_json, save

NEW = "#f3c78f"  # triangles that the puncture made
NAMES = ("default, sub-pixel", "paper's preset")


@dataclasses.dataclass
class Sheet:
    """Meshes are (vertices in mm, triangles)."""
    name: str
    before: tuple
    after: tuple
    tools: list
    holes: list

    @staticmethod
    def read_all(path):
        """The sheets from the topmost down."""
        document = read_json(path)
        step_mm = 2.0 ** -document["lattice_bits"]

        def points(flat):
            return numpy.array(flat, dtype=float).reshape(-1, 2) * step_mm

        def mesh(piece):
            return points(piece["vertices"]), numpy.array(piece["triangles"], dtype=int).reshape(-1, 3)

        sheets = []
        for sheet in sorted(document["sheets"], key=lambda sheet: -sheet["z_m"]):
            holes = [points(ring) for cut in sheet["cuts"] for ring in cut["hole"]]
            if not holes:
                sys.exit(f"punctured.py: slice {sheet['slice']} has no hole")
            sheets.append(Sheet(f"slice {sheet['slice']} at {100 * sheet['z_m']:g} cm", mesh(sheet["before"]), mesh(sheet["after"]),
                                [points(cut["tool"]) for cut in sheet["cuts"]], holes))
        return sheets

    def window(self):
        around = numpy.vstack(self.holes)
        centre, half = (around.min(axis=0) + around.max(axis=0)) / 2, 2.8 * numpy.ptp(around, axis=0).max() / 2
        return centre - half, centre + half


def new_triangles(before, after):
    """Which triangles of `after` are not in `before`, by the positions of their corners."""
    def keys(mesh):
        return [tuple(sorted(map(tuple, triangle))) for triangle in mesh[0][mesh[1]]]
    old = set(keys(before))
    return numpy.array([key not in old for key in keys(after)], dtype=bool)


def draw_close_up(axes, sheet, heading):
    """Before and after the puncture, on two axes."""
    window = sheet.window()
    new = new_triangles(sheet.before, sheet.after)
    removed = sum(doubled_area(ring) for ring in sheet.holes) / 2
    plane_axes(axes[0], f"{heading}\nbefore: {len(sheet.before[1])} triangles, and the tool", window)
    draw_mesh(axes[0], *sheet.before, width=0.7)
    draw_rings(axes[0], sheet.tools, HOLE, 1.8)
    plane_axes(axes[1], f"after: {len(sheet.after[1])} triangles, {int(new.sum())} of them new;\n{removed:.3f} mm\N{SUPERSCRIPT TWO} removed", window)
    draw_mesh(axes[1], sheet.after[0], sheet.after[1][~new], width=0.7)
    draw_mesh(axes[1], sheet.after[0], sheet.after[1][new], fill=NEW, width=0.7)
    draw_rings(axes[1], sheet.holes, HOLE, 1.8)


def main():
    runs, out = [Sheet.read_all(path) for path in sys.argv[1:3]], pathlib.Path(sys.argv[3])
    n = len(runs[0])
    close, axes = plt.subplots(n, 4, figsize=(17, 4.7 * n), layout="constrained", squeeze=False)
    for column, (name, sheets) in enumerate(zip(NAMES, runs)):
        for row, sheet in enumerate(sheets):
            draw_close_up(axes[row, 2 * column:2 * column + 2], sheet, f"{name}, {sheet.name}")
    save(close, out / f"{sys.argv[4]}.png")

    # One slice: the runs beside each other; several: a row for each run.
    shape = (1, 2) if n == 1 else (2, n)
    whole, faces = plt.subplots(*shape, figsize=(5.4 * shape[1], 5.6 * shape[0]), layout="constrained", squeeze=False)
    everything = numpy.vstack([sheet.before[0] for sheets in runs for sheet in sheets])
    low, high = everything.min(axis=0) - 3, everything.max(axis=0) + 3
    for panel, (name, sheet) in zip(faces.flat, ((name, sheet) for name, sheets in zip(NAMES, runs) for sheet in sheets)):
        plane_axes(panel, f"{name}, {sheet.name}: {len(sheet.after[1])} triangles", (low, high))
        draw_mesh(panel, *sheet.after, width=0.25)
        draw_rings(panel, sheet.holes, HOLE, 1.4)
        mark_window(panel, sheet.window())
    save(whole, out / f"{sys.argv[5]}.png")


if __name__ == "__main__":
    main()
