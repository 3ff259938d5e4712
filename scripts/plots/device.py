# SPDX-License-Identifier: Apache-2.0
"""device.py DEVICE.json PICTURE.png: the words of a scene on a picture of the device.

Left the four-legged mechanism of a device description, with its frame {B}, the plate, the tool and a slice at its height; right the
slice's own plane with u, v and the anchor. TUTORIAL.md shows it:

    python3 scripts/plots/device.py runtime/device/four_legs.json scripts/plots/device.png
"""
import json
import sys

import numpy as np
from matplotlib.patches import Ellipse, Polygon

from style import BONE, GREY, HOLE, LINE, OUTER, THRESHOLD, plt, save_plain

PLATE_M, SLICE_M, TOOL_M = 0.15, 0.122, 0.028  # the plate's height, the slice's, the tool's length in the picture
TURN, LOOK_DOWN = np.radians(28), np.radians(24)


def seen(p):
    """Where a point of {B} lies in the picture: parallel projection."""
    p = np.atleast_2d(p)
    x = p[:, 0] * np.cos(TURN) - p[:, 1] * np.sin(TURN)
    y = p[:, 0] * np.sin(TURN) + p[:, 1] * np.cos(TURN)
    return np.stack([x, p[:, 2] * np.cos(LOOK_DOWN) + y * np.sin(LOOK_DOWN)], axis=1)


def leg(g, plate_z):
    """Points of a leg in its own frame (runtime/mechanism/README.md): A, E, C of the upper chain; B, F, D of the lower one."""
    a, c = np.array([g["R_B1_m"], 0, g["z_A_m"]]), np.array([g["R_T_m"], 0, plate_z])
    way = c - a
    reach = np.hypot(way[0], way[2])
    theta = np.arctan2(way[2], way[0]) + np.arccos((g["l1_m"]**2 + reach**2 - g["l2_m"]**2) / (2 * g["l1_m"] * reach))
    e = a + g["l1_m"] * np.array([np.cos(theta), 0, np.sin(theta)])
    d = e + (c - e) * g["l5_m"] / g["l2_m"]
    turn = np.radians(g["d_deg"])
    b = np.array([g["R_B2_m"] * np.cos(turn), g["R_B2_m"] * np.sin(turn), g["z_A_m"] - g["H_B_m"]])
    flat, far = d - b, g["l4_m"]**2 - (d[2] - b[2])**2
    across = np.hypot(flat[0], flat[1])
    theta = np.arctan2(flat[1], flat[0]) + np.arccos((g["l3_m"]**2 + across**2 - far) / (2 * g["l3_m"] * across))
    f = b + g["l3_m"] * np.array([np.cos(theta), np.sin(theta), 0])
    return np.array([a, e, c]), np.array([b, f, d])


def around(points, quarter):
    c, s = np.cos(quarter * np.pi / 2), np.sin(quarter * np.pi / 2)
    return points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


def ring(radius, z, n=96):
    t = np.linspace(0, 2 * np.pi, n)
    return np.stack([radius * np.cos(t), radius * np.sin(t), np.full(n, z)], axis=1)


def say(axes, text, at, words_at, colour=LINE, **keys):
    axes.annotate(text, xy=at, xytext=words_at, color=colour, fontsize=9.5, va="center",
                  arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.8, "shrinkA": 2, "shrinkB": 1}, zorder=9, **keys)


def outline(t):
    """A schematic vertebral body, mm."""
    return 21 * np.cos(t), 15 * np.sin(t) * (1 - 0.12 * np.cos(2 * t))


def draw_device(axes, g):
    axes.plot(*seen(ring(g["R_B1_m"], 0)).T, color=GREY, lw=1.2)
    t = np.linspace(0, 2 * np.pi, 96)
    u, v = outline(t)
    bone = np.stack([u / 1e3, v / 1e3, np.full(96, SLICE_M)], axis=1)
    order = sorted(range(4), key=lambda k: -around(leg(g, PLATE_M)[0], k)[0] @ [np.sin(TURN), np.cos(TURN), 0])
    for k in order:
        upper, lower = (around(points, k) for points in leg(g, PLATE_M))
        for base in (upper[0], lower[0]):
            axes.plot(*seen([base * [1, 1, 0], base]).T, color=GREY, lw=0.9, alpha=0.7)
        axes.plot(*seen(lower).T, color=OUTER, lw=1.6, alpha=0.75)
        axes.plot(*seen(upper).T, color=LINE, lw=2.6, solid_capstyle="round")
        axes.plot(*seen(np.concatenate([upper, lower])).T, "o", ms=3.5, color=LINE)
    axes.add_patch(Polygon(seen(bone), closed=True, facecolor=BONE, edgecolor=LINE, lw=1, zorder=3))
    plate = np.array([around(np.array([[g["R_T_m"], 0, PLATE_M]]), k)[0] for k in range(4)])
    axes.add_patch(Polygon(seen(plate), closed=True, facecolor="#dfe8ef", edgecolor=LINE, lw=1.4, alpha=0.85, zorder=4))
    axes.plot(*seen([[0, 0, PLATE_M], [0, 0, PLATE_M - TOOL_M]]).T, color=HOLE, lw=3.2, zorder=5, solid_capstyle="butt")
    axes.plot(*seen([[0, 0, 0], [0, 0, SLICE_M]]).T, color=THRESHOLD, lw=1, ls=":", zorder=2)
    for way, name in (([0.075, 0, 0], "x"), ([0, 0.075, 0], "y"), ([0, 0, 0.06], "z")):
        a, b = seen([[0, 0, 0], way])
        axes.annotate("", xy=b, xytext=a, arrowprops={"arrowstyle": "-|>", "color": THRESHOLD, "lw": 1.8})
        axes.text(*(b + (b - a) * 0.12), name, color=THRESHOLD, fontsize=12, ha="center", va="center", weight="bold")
    at = lambda *p: tuple(seen(p)[0])  # noqa: E731
    say(axes, "origin of {B}, in the base:\nheights z count from here", at(0, 0, 0), (-0.245, -0.098), THRESHOLD)
    say(axes, "plate: carries the tool", at(-0.045, 0.01, PLATE_M), (-0.235, 0.215))
    say(axes, "tool; its lower end\nis the tip (tip_m)", at(0, 0, PLATE_M - TOOL_M + 0.012), (0.02, 0.222), HOLE)
    say(axes, f"slice at z_m = {SLICE_M:g}:\n{100 * SLICE_M:g} cm above the origin", at(0.017, -0.006, SLICE_M), (0.15, 0.165))
    say(axes, "two motors a leg", at(*around(leg(g, PLATE_M)[0], 0)[0]), (0.175, 0.075), GREY)
    axes.set(xlim=(-0.245, 0.275), ylim=(-0.125, 0.245), aspect="equal", title="The device, its frame {B}, and a slice in it")
    axes.axis("off")


def draw_slice(axes):
    u0, v0 = 81.5, 53.6
    t = np.linspace(0, 2 * np.pi, 96)
    u, v = outline(t)
    axes.add_patch(Polygon(np.stack([u0 + u, v0 + v], axis=1), facecolor=BONE, edgecolor=LINE))
    axes.add_patch(Polygon([(u0 - 26, 90), (u0 - 14, 74), (u0 + 14, 74), (u0 + 26, 90), (u0 + 5, 108), (u0 - 5, 108)], facecolor=BONE, edgecolor=LINE))
    axes.add_patch(Ellipse((u0, 80), 22, 15, facecolor="white", edgecolor=LINE))
    axes.text(u0, 80, "canal", ha="center", va="center", fontsize=9, color=GREY)
    axes.plot(u0, v0, "o", color=HOLE, ms=8)
    say(axes, "anchor_mm [81.5, 53.6]\nlies at x = y = 0 of {B}", (u0, v0), (100, 25), HOLE)
    for end, name, words in (((60, 0), "u", (62, 3)), ((0, 60), "v", (3, 62))):
        axes.annotate("", xy=end, xytext=(0, 0), arrowprops={"arrowstyle": "-|>", "color": OUTER, "lw": 1.8})
        axes.text(*words, name, color=OUTER, fontsize=13, weight="bold", va="center")
    axes.plot(0, 0, "s", color=OUTER, ms=7)
    axes.text(4, -6, "centre of the first pixel: u = v = 0", color=OUTER, fontsize=9.5, va="center")
    axes.text(24, 9, "along a row of pixels", color=OUTER, fontsize=9, va="center")
    axes.text(5, 30, "along a column", color=OUTER, fontsize=9, rotation=90, va="center")
    axes.set(xlim=(-6, 150), ylim=(116, -14), aspect="equal", title="The slice's own plane: uv, in mm")
    axes.set_xlabel("u (mm)  \u2192  x of {B}")
    axes.set_ylabel("v (mm)  \u2192  y of {B}")


def main():
    if len(sys.argv) != 3:
        print("usage: device.py DEVICE.json PICTURE.png", file=sys.stderr)
        return 2
    with open(sys.argv[1], encoding="utf-8") as file:
        geometry = json.load(file)["geometry"]
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.5, 4.3), width_ratios=(1.3, 1))
    draw_device(left, geometry)
    draw_slice(right)
    figure.tight_layout()
    save_plain(figure, sys.argv[2])
    return 0


if __name__ == "__main__":
    sys.exit(main())
