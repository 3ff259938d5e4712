# SPDX-License-Identifier: Apache-2.0
"""session.py RECORDING.csv SCENE.json RIM_RECORDING.csv RIM_SCENE.json DEVICE.json OUTDIR: from a session the commanded path
beside the actual one (path.png) and the device at the first puncture with its legs and angles (device.png); from it and
from the session beside a rim the eight motor torques (torques.png)."""
import pathlib
import sys

import numpy
from matplotlib.patches import Arc
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from style import BONE, GREY, HOLE, LINE, OUTER, plt, read_json, read_recording, save

LEGS = 4
LEG_COLOURS = ("#1f6fb4", "#c8452d", "#3a8f4b", "#8a5fb0")
THETA = "\N{GREEK SMALL LETTER THETA}"


def commanded(scene, t):
    """The hand's trajectory at times t, n x 3: linear between keyframes, at rest before and after (formats/session/scene.schema.json)."""
    keyframes = scene["hand"]["trajectory"]
    times = [keyframe["t_s"] for keyframe in keyframes]
    return numpy.column_stack([numpy.interp(t, times, [keyframe["tip_m"][k] for keyframe in keyframes]) for k in range(3)])


def draw_path(recording, scene, out):
    t = recording["t_s"]
    wanted, actual = 100 * commanded(scene, t)[:, 2], 100 * recording["tool_z_m"]
    figure, axes = plt.subplots(2, 1, figsize=(9, 6.4), sharex=True, height_ratios=(2.2, 1), layout="constrained")
    for piece in scene["slices"]:
        axes[0].axhline(100 * piece["z_m"], color=GREY, lw=0.9, ls="--")
        axes[0].text(0.995, 100 * piece["z_m"], f"slice at {100 * piece['z_m']:g} cm", va="bottom", ha="right", color=GREY,
                     transform=axes[0].get_yaxis_transform())
    axes[0].plot(t, wanted, color=GREY, lw=2.6, alpha=0.6, label="commanded: the hand's trajectory")
    axes[0].plot(t, actual, color=OUTER, lw=1.5, label="actual: the tool tip")
    axes[0].set(ylabel="height (cm)", xlim=(t[0], t[-1]))
    axes[0].legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, borderaxespad=0.2)
    axes[1].plot(t, 10 * (actual - wanted), color=HOLE, lw=1.4)
    axes[1].set(ylabel="actual - commanded (mm)", xlabel="time (s)")
    for panel in axes:
        panel.grid(True)
    save(figure, out / "path.png", scene=scene["name"], stiffness=scene["hand"].get("stiffness_N_per_m", 4000))


def draw_torques(sessions, device, out):
    """A column for each session (name, recording)."""
    figure, axes = plt.subplots(2, len(sessions), figsize=(14, 6.4), sharex="col", sharey="row", layout="constrained")
    largest = {1: 0.0, 4: 0.0}
    for column, (name, recording) in enumerate(sessions):
        t = recording["t_s"]
        for panel, joint, scale, unit in zip(axes[:, column], (1, 4), (1, 1e3), ("N m", "mN m")):
            # Where the legs' torques are equal, the curves of later legs are drawn narrower over those of earlier ones.
            for leg in range(1, LEGS + 1):
                torque = recording[f"tau_{leg}_{joint}_Nm"]
                largest[joint] = max(largest[joint], float(numpy.abs(torque).max()))
                panel.plot(t, scale * torque, color=LEG_COLOURS[leg - 1], lw=6.7 - 1.4 * leg, label=f"leg {leg}")
            if column == 0:
                panel.set_ylabel(f"torque at {THETA}{joint} ({unit})")
            panel.set_xlim(t[0], t[-1])
            panel.grid(True)
        axes[0, column].set_title(name, loc="left")
        axes[1, column].set_xlabel("time (s)")
    axes[1, 0].legend(loc="upper right", ncols=2)
    save(figure, out / "torques.png", upper=largest[1], lower=1e3 * largest[4], continuous=device["motors"]["continuous_torque_Nm"])


def rotation(q):
    w, x, y, z = q
    return numpy.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def chain(p, first_m, second_m, branch):
    """The two links from the origin to p = (two coordinates in the first link's plane, one along its normal): the
    first link's angle, the second's angle relative to it, and the second's angle out of the plane."""
    lift = numpy.arcsin(p[2] / second_m)
    reach, span = second_m * numpy.cos(lift), numpy.hypot(p[0], p[1])
    first = numpy.arctan2(p[1], p[0]) + branch * numpy.arccos((span ** 2 + first_m ** 2 - reach ** 2) / (2 * first_m * span))
    second = numpy.arctan2(p[1] - first_m * numpy.sin(first), p[0] - first_m * numpy.cos(first)) - first
    return first, second, lift


def solve_leg(device, C):
    """The points of a leg in its own frame (x outward, y tangential, z up) and theta1..theta6, in closed form
    (runtime/mechanism/leg.h), from its ball joint C."""
    g = device["geometry"]
    sign = {"plus": 1, "minus": -1}
    d = numpy.radians(g["d_deg"])
    A = numpy.array([g["R_B1_m"], 0, g["z_A_m"]])
    B = numpy.array([g["R_B2_m"] * numpy.cos(d), g["R_B2_m"] * numpy.sin(d), g["z_A_m"] - g["H_B_m"]])
    p = C - A
    theta1, theta2, theta3 = chain((p[0], p[2], p[1]), g["l1_m"], g["l2_m"], sign[device["branches"]["theta1"]])
    E = A + g["l1_m"] * numpy.array([numpy.cos(theta1), 0, numpy.sin(theta1)])
    D = E + g["l5_m"] / g["l2_m"] * (C - E)
    theta4, theta5, theta6 = chain(D - B, g["l3_m"], g["l4_m"], sign[device["branches"]["theta4"]])
    F = B + g["l3_m"] * numpy.array([numpy.cos(theta4), numpy.sin(theta4), 0])
    theta = []
    for k, angle in enumerate((theta1, theta2, theta3, theta4, theta5, theta6)):
        middle = numpy.radians(sum(device["joint_limits_deg"][f"theta{k + 1}"]) / 2)
        theta.append(angle - 2 * numpy.pi * numpy.round((angle - middle) / (2 * numpy.pi)))
    return dict(A=A, B=B, C=C, D=D, E=E, F=F), numpy.array(theta)


def draw_angle(panel, centre, from_rad, by_rad, radius, label):
    start, end = numpy.degrees(sorted((from_rad, from_rad + by_rad)))
    panel.add_patch(Arc(centre, 2 * radius, 2 * radius, theta1=start, theta2=end, color=HOLE, lw=1.2))
    middle = from_rad + by_rad / 2
    panel.annotate(label, centre + 1.15 * radius * numpy.array([numpy.cos(middle), numpy.sin(middle)]), color=HOLE, fontsize=9.5,
                   ha="left" if numpy.cos(middle) > 0.2 else "right" if numpy.cos(middle) < -0.2 else "center",
                   va="bottom" if numpy.sin(middle) > 0.2 else "top" if numpy.sin(middle) < -0.2 else "center")
    panel.plot(*numpy.column_stack([centre, centre + 1.3 * radius * numpy.array([numpy.cos(from_rad), numpy.sin(from_rad)])]),
               color=GREY, lw=0.9, ls=":")


def project(panel, points, axes, chains, labels, offsets):
    """A leg's points along two of its axes, in mm."""
    flat = {name: 1e3 * point[list(axes)] for name, point in points.items()}
    for names, colour, width in chains:
        panel.plot(*numpy.array([flat[name] for name in names]).T, "-o", color=colour, lw=width, ms=5, mfc="white", zorder=3)
    for name in labels:
        panel.annotate(name, flat[name], offsets.get(name, (7, 6)), textcoords="offset points", fontsize=11, weight="bold")
    panel.set_aspect("equal")
    panel.grid(True)
    return flat


def draw_device(recording, scene, device, description, out):
    punctured = numpy.nonzero(recording["state"] == "punctured")[0]
    tick = int(punctured[0]) if len(punctured) else 0
    position = numpy.array([recording[f"{axis}_m"][tick] for axis in "xyz"])
    turn = rotation([recording[name][tick] for name in ("qw", "qx", "qy", "qz")])
    figure = plt.figure(figsize=(16, 6.6))
    space = figure.add_axes((0, 0.02, 0.39, 0.92), projection="3d", computed_zorder=False)
    difference, plate, legs = 0.0, [], []
    for leg in range(LEGS):
        azimuth = leg * numpy.pi / 2
        to_device = numpy.array([[numpy.cos(azimuth), -numpy.sin(azimuth), 0], [numpy.sin(azimuth), numpy.cos(azimuth), 0], [0, 0, 1]])
        joint = position + turn @ to_device @ [device["geometry"]["R_T_m"], 0, 0]
        points, theta = solve_leg(device, to_device.T @ joint)
        recorded = [recording[f"th_{leg + 1}_{k}_rad"][tick] for k in (1, 2, 3, 4)]
        difference = max(difference, float(numpy.abs(theta[:4] - recorded).max()))
        plate.append(joint)
        legs.append((points, theta))
        place = {name: 1e3 * to_device @ point for name, point in points.items()}
        for names, width in (("AEC", 3.2), ("BFD", 1.8)):
            space.plot(*numpy.array([place[name] for name in names]).T, "-o", color=LEG_COLOURS[leg], lw=width, ms=4, mfc="white", zorder=3)
        foot = 1e3 * to_device @ [device["geometry"]["R_B1_m"], 0, 0]
        space.plot(*numpy.array([foot, place["A"]]).T, color=GREY, lw=1.0, ls=":", zorder=1)
        space.text(*(place["A"] + [0, 0, 16]), f"leg {leg + 1}", color=LEG_COLOURS[leg], ha="center", zorder=5)
    if difference > 1e-6:
        sys.exit(f"session.py: the closed form differs from the recorded encoders by {difference:g} rad")
    corners = 1e3 * numpy.array(plate)
    space.add_collection3d(Poly3DCollection([corners], facecolors=[BONE], edgecolors=LINE, zorder=2))
    space.set(xlabel="x (mm)", ylabel="y (mm)")
    space.set_zlabel("z (mm)", labelpad=6)
    space.set(xlim=(-190, 190), ylim=(-190, 190), zlim=(0, 1e3 * position[2] + 30))
    space.set_box_aspect((380, 380, numpy.ptp(space.get_zlim())), zoom=1.05)
    space.view_init(elev=24, azim=-52)
    space.set_title("the device in frame {B}", loc="left")

    points, theta = legs[0]
    degrees = [f"{THETA}{k + 1} = {numpy.degrees(angle).round(1) + 0.0:.1f}\N{DEGREE SIGN}" for k, angle in enumerate(theta)]
    side = figure.add_axes((0.49, 0.08, 0.22, 0.85), anchor="NW")
    flat = project(side, points, (0, 2), (("AEC", OUTER, 3), ("BFD", GREY, 1.6)), "AEC", {"A": (8, -4), "E": (4, -14), "C": (6, 6)})
    draw_angle(side, flat["A"], 0, theta[0], 18, degrees[0])
    draw_angle(side, flat["E"], theta[0], theta[1], 16, degrees[1])
    side.set(xlabel="outward x (mm)", ylabel="up z (mm)")
    side.set_title(f"leg 1 from the side: {degrees[2]} out of the plane", loc="left")
    top = figure.add_axes((0.75, 0.08, 0.25, 0.85), anchor="NW")
    flat = project(top, points, (0, 1), (("AEC", OUTER, 3), ("BFD", HOLE, 1.6)), "ABCDEF", {})
    draw_angle(top, flat["B"], 0, theta[3], 14, degrees[3])
    draw_angle(top, flat["F"], theta[3], theta[4], 12, degrees[4])
    top.set(xlabel="outward x (mm)", ylabel="tangential y (mm)")
    top.set_title(f"leg 1 from above: {degrees[5]} out of the plane", loc="left")
    for panel in (side, top):
        panel.margins(0.18)
    save(figure, out / "device.png", scene=scene["name"], description=description, difference=difference)


def main():
    recording, scene = read_recording(sys.argv[1]), read_json(sys.argv[2])
    rim_recording, rim_scene = read_recording(sys.argv[3]), read_json(sys.argv[4])
    device, out = read_json(sys.argv[5]), pathlib.Path(sys.argv[6])
    draw_path(recording, scene, out)
    draw_torques([(scene["name"], recording), (rim_scene["name"], rim_recording)], device, out)
    draw_device(recording, scene, device, pathlib.Path(sys.argv[5]).name, out)


if __name__ == "__main__":
    main()
