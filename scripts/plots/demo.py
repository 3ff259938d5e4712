# SPDX-License-Identifier: Apache-2.0
"""demo.py OUT SCENES: the pictures of scripts/demo, from its outputs in OUT, to OUT/pictures; SCENES has the scenes."""
import csv
import json
import pathlib
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy  # noqa: E402

BONE, LINE, BLUE, RED, GREY, GREEN = "#e9dfc9", "#2f4858", "#1f6fb4", "#c8452d", "#7a7a7a", "#3a8f4b"
plt.rcParams.update({"figure.dpi": 130, "axes.titlesize": 10.5, "axes.titlelocation": "left", "axes.spines.top": False, "axes.spines.right": False,
                     "legend.frameon": False, "path.simplify": False})


def read_json(path):
    return json.loads(path.read_text(encoding="utf-8"))


def recording(path):
    """{column: array} of a recording; texts stay texts."""
    with open(path, encoding="ascii", newline="") as stream:
        names, *rows = csv.reader(stream)
    columns = {}
    for name, column in zip(names, zip(*rows)):
        try:
            columns[name] = numpy.array(column).astype(float)
        except ValueError:
            columns[name] = numpy.array(column)
    return columns


def mesh(axes, vertices, triangles, width=0.4):
    vertices, triangles = numpy.asarray(vertices, dtype=float), numpy.asarray(triangles)
    axes.tripcolor(vertices[:, 0], vertices[:, 1], triangles, facecolors=numpy.zeros(len(triangles)),
                   cmap=matplotlib.colors.ListedColormap([BONE]), edgecolors=LINE, linewidth=width)


def rings(axes, all_rings, colour, width):
    for ring in all_rings:
        axes.plot(*numpy.vstack([ring, ring[:1]]).T, color=colour, lw=width)


def plane(axes, title, low, high):
    axes.set(title=title, xlabel="u (mm)", ylabel="v (mm)", aspect="equal", xlim=(low[0], high[0]), ylim=(high[1], low[1]))


def overview(out):
    """README: a slice with its outline, its mesh, the hole, and the force on the hand."""
    stages, sheets = read_json(out / "sample.stages.json"), read_json(out / "recordings/three_slices_subpixel_500Hz.sheets.json")
    session = recording(out / "recordings/three_slices_subpixel_500Hz.csv")
    picture = plt.imread(out / f"sample/png/slice_{stages['slice'] + 1:03d}.png")
    outline = [numpy.array(ring) for ring in stages["pslg_mm"]]
    points = numpy.vstack(outline)
    middle, half = (points.min(axis=0) + points.max(axis=0)) / 2, numpy.ptp(points, axis=0).max() / 2 + 6
    figure, axes = plt.subplots(1, 4, figsize=(20, 5), layout="constrained")
    sx, sy = stages["spacing_mm"]
    height, width = picture.shape[:2]
    axes[0].imshow(picture[..., :3] if picture.ndim == 3 else picture, cmap="gray", extent=(-sx / 2, (width - 0.5) * sx, (height - 0.5) * sy, -sy / 2))
    rings(axes[0], outline, "#ff9d2e", 1.4)
    plane(axes[0], f"CT slice {stages['slice']} and its outline, {len(points)} vertices", middle - half, middle + half)
    mesh(axes[1], stages["refined"]["vertices_mm"], stages["refined"]["triangles"])
    rings(axes[1], outline, BLUE, 0.9)
    plane(axes[1], f"refined mesh, {len(stages['refined']['triangles'])} triangles", middle - half, middle + half)
    step = 2.0 ** -sheets["lattice_bits"]
    sheet = next(s for s in sheets["sheets"] if s["cuts"])
    holes = [step * numpy.array(ring, dtype=float) for cut in sheet["cuts"] for ring in cut["hole"]]
    middle = numpy.vstack(holes).mean(axis=0)
    mesh(axes[2], step * numpy.array(sheet["after"]["vertices"], dtype=float), sheet["after"]["triangles"], 0.7)
    rings(axes[2], holes, RED, 2)
    plane(axes[2], "punctured: the mesh around the hole", middle - 11, middle + 11)
    axes[3].plot(session["t_s"], session["fz_delivered_N"], color=RED, lw=1.8)
    axes[3].set(xlabel="time (s)", ylabel="force on the hand (N)", title="three slices punctured one after the other", box_aspect=1)
    return figure


def experiment(out, scenes, scene):
    """The paper's Fig. 16 and 17, or 18 and 19: position and force."""
    session, slices = recording(out / f"recordings/{scene}_subpixel_500Hz.csv"), read_json(scenes / f"{scene}.json")["slices"]
    figure, axes = plt.subplots(2, 1, figsize=(9, 7), sharex=True, layout="constrained")
    for piece in slices:
        axes[0].axhline(100 * piece["z_m"], color=GREY, lw=1, ls="--")
    axes[0].plot(session["t_s"], 100 * session["tool_z_m"], color=BLUE)
    axes[0].set(ylabel="height of the tool tip (cm)", title=f"{scene.replace('_', ' ')}, 500 Hz; dashed: slices")
    axes[1].plot(session["t_s"], session["fz_delivered_N"], color="#f0b49b", lw=3, label="delivered by the motors")
    axes[1].plot(session["t_s"], session["fz_wanted_N"], color=RED, lw=1.2, label="wanted")
    axes[1].set(xlabel="time (s)", ylabel="force on the hand along z (N)")
    axes[1].legend()
    return figure


def force_laws(out, scenes):
    """docs/trocar-run.md: hooke and network, in the middle of a body and 2 mm from a rim."""
    figure, axes = plt.subplots(1, 3, figsize=(15, 4.6), layout="constrained")
    for panel, (place, words) in zip(axes, (("middle", "in the middle of the body"), ("rim", "2 mm from a rim"))):
        panel.axhline(read_json(scenes / f"network_{place}.json")["tissue"]["threshold_N"], color=GREEN, lw=1, ls="--", label="threshold")
        for law, colour in (("hooke", BLUE), ("network", RED)):
            session = recording(out / f"recordings/network_{place}_{law}.csv")
            contact = session["state"] == "contact"
            stiffness, depth = session["fz_wanted_N"][contact] / session["penetration_m"][contact], 1000 * session["penetration_m"][contact][-1]
            panel.plot(session["t_s"], session["fz_wanted_N"], color=colour, label=f"{law}: {stiffness[-1]:.0f} N/m, punctured {depth:.2f} mm deep")
        panel.set(xlabel="time (s)", ylabel="force on the hand along z (N)", title=words)
        panel.legend(loc="upper left")
        sheets = read_json(out / f"recordings/network_{place}_network.sheets.json")
        step, sheet = 2.0 ** -sheets["lattice_bits"], sheets["sheets"][0]
        if place == "middle":
            vertices = step * numpy.asarray(sheet["before"]["vertices"], dtype=float)
            mesh(axes[2], vertices, sheet["before"]["triangles"])
            plane(axes[2], "where the tool presses", vertices.min(axis=0) - 3, vertices.max(axis=0) + 3)
        tool = step * numpy.asarray(sheet["cuts"][0]["tool"], dtype=float)
        axes[2].fill(*tool.T, color=RED)
        axes[2].annotate(words, tool.mean(axis=0), (0, -14 if place == "rim" else 8), textcoords="offset points", ha="center", fontsize=9)
    return figure


def needle(out, top_z_m):
    """A needle down through a vertebra and out again."""
    session = recording(out / "recordings/needle.csv")
    depth_mm, figure = 1e3 * (top_z_m - session["tool_z_m"]), plt.figure(figsize=(9, 4.6), layout="constrained")
    plt.plot(depth_mm, session["fz_tissue_N"], color=BLUE, label="all of the tissue, in and out")
    plt.plot(depth_mm, session["tip_N"], color=RED, lw=1, ls="--", label="of it the tip")
    plt.xlabel("depth of the tip (mm)")
    plt.ylabel("force along the needle (N)")
    plt.legend()
    return figure


def main():
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    out, scenes = map(pathlib.Path, sys.argv[1:])
    pictures = {"overview": overview(out), "one_slice": experiment(out, scenes, "one_slice"), "three_slices": experiment(out, scenes, "three_slices"),
                "force_laws": force_laws(out, scenes), "needle": needle(out, read_json(scenes / "vertebra.json")["body"]["top_z_m"])}
    folder = out / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in pictures.items():
        figure.savefig(folder / f"{name}.png", bbox_inches="tight", metadata={"Software": None})
    (folder / "index.html").write_text("<!DOCTYPE html><meta charset=utf-8><title>Trocar: the demo's pictures</title>\n" +
                                       "".join(f"<h2>{name}</h2><img src={name}.png alt={name} style='max-width: 100%'>\n" for name in pictures))
    return 0


if __name__ == "__main__":
    sys.exit(main())
