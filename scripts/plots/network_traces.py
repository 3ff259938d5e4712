# SPDX-License-Identifier: Apache-2.0
"""network_traces.py FOLDER SCENES OUT.png: the force laws `hooke` and `network` side by side, in the
middle of a body and 2 mm from a rim, from FOLDER/network_{middle,rim}_{hooke,network}.csv and
.sheets.json (trocar-run --record, --meshes); SCENES holds their scenes, network_{middle,rim}.json."""
import pathlib
import sys

import numpy
from style import HOLE, OUTER, THRESHOLD, draw_mesh, plt, read_json, read_recording, save

PLACES = {"middle": "in the middle of the body", "rim": "2 mm from a rim"}
LAWS = {"hooke": OUTER, "network": HOLE}


def traces(axes, folder, place, threshold):
    axes.axhline(threshold, color=THRESHOLD, lw=1.0, ls="--")
    axes.text(0.99, threshold, f"threshold {threshold:g} N", color=THRESHOLD, ha="right", va="bottom", transform=axes.get_yaxis_transform())
    for law, colour in LAWS.items():
        rows = read_recording(folder / f"network_{place}_{law}.csv")
        contact = rows["state"] == "contact"
        stiffness = rows["fz_wanted_N"][contact] / rows["penetration_m"][contact]
        depth = 1000 * rows["penetration_m"][contact][-1]
        style = {"lw": 3.0, "alpha": 0.45} if law == "hooke" else {"lw": 1.4}
        axes.plot(rows["t_s"], rows["fz_wanted_N"], color=colour, **style,
                  label=f"{law}: {stiffness[-1]:.0f} N/m, punctured {depth:.2f} mm deep")
    axes.set(xlabel="time (s)", ylabel="force on the hand along z (N)", ylim=(-1.5, 1.35 * threshold))
    axes.set_title(PLACES[place], loc="left")
    axes.grid(True)
    axes.legend(loc="upper left")


def place_map(axes, folder):
    for place in PLACES:
        sheets = read_json(folder / f"network_{place}_network.sheets.json")
        step = 2.0 ** -sheets["lattice_bits"]
        sheet = sheets["sheets"][0]
        if place == "middle":
            vertices = step * numpy.asarray(sheet["before"]["vertices"], dtype=float)
            draw_mesh(axes, vertices, numpy.asarray(sheet["before"]["triangles"]), width=0.4)
        tool = step * numpy.asarray(sheet["cuts"][0]["tool"], dtype=float)
        axes.fill(tool[:, 0], tool[:, 1], color=HOLE, lw=0)
        axes.annotate(PLACES[place], tool.mean(axis=0), (0, -14 if place == "rim" else 8),
                      textcoords="offset points", ha="center", fontsize=9, color="black",
                      bbox={"fc": "white", "ec": "none", "alpha": 0.7, "pad": 1})
    axes.set_aspect("equal")
    axes.invert_yaxis()
    axes.set(xlabel="u (mm)", ylabel="v (mm)")
    axes.set_title("where the tool presses", loc="left")


def main():
    folder, scenes, out = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]), sys.argv[3]
    figure, axes = plt.subplots(1, 3, figsize=(15, 4.6), layout="constrained")
    for column, place in zip(axes, PLACES):
        traces(column, folder, place, read_json(scenes / f"network_{place}.json")["tissue"]["threshold_N"])
    place_map(axes[2], folder)
    save(figure, out)


if __name__ == "__main__":
    main()
