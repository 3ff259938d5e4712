# SPDX-License-Identifier: Apache-2.0
"""The haptic device: how a fourth leg changes the singularities, and what the torque allocation delivers.

Measured by the program device_sweep."""
import json
import subprocess

import device_plots as plots

TITLE = "Device: kinematics, singularities and torques"
ORDER = 30

STATED_EXTENT_M, WIDE_EXTENT_M, TILT_DEG = 0.02, 0.09, 10


def plan(context):
    full = context.full
    heights = [0.095, 0.1225, 0.15, 0.1775, 0.205]
    return {
        "poses": 100000 if full else 20000, "tilts_deg": list(range(0, 46, 5)),
        "maps": [{"extent_m": STATED_EXTENT_M, "heights_m": heights, "points": 41 if full else 21, "tilt_deg": TILT_DEG, "tilts": 96 if full else 24},
                 {"extent_m": WIDE_EXTENT_M, "heights_m": heights, "points": 61 if full else 41, "tilt_deg": TILT_DEG, "tilts": 96 if full else 24}],
        "forces_N": [10, 20, 30, 35, 40, 50, 60, 70, 80, 100, 120, 150], "wrenches": 100000 if full else 10000,
        "timed": 200000 if full else 50000, "kinematics_poses": 20000 if full else 5000,
    }


def measure(context):
    done = subprocess.run([context.programs / "device_sweep"], input=json.dumps(plan(context)), text=True, stdout=subprocess.PIPE, check=True)
    data = json.loads(done.stdout)
    for each in (each for ring in data["rings"] for each in ring["maps"] if each["extent_m"] == WIDE_EXTENT_M):
        del each["upright"]  # not shown
    return data


def stated(ring):
    return next(row for row in ring["rows"] if row["id"] == "stated workspace")


def at_tilt(ring, tilt_deg):
    return next(row for row in ring["rows"] if row.get("tilt_deg") == tilt_deg)


def least_stated(ring):
    """The least inverse condition number of the random poses and of the maps' places, tilted up to the bound. It lies at corners."""
    maps = [each for each in ring["maps"] if each["extent_m"] == STATED_EXTENT_M]
    return min([stated(ring)["inverse_condition_min"], *(value for each in maps for row in each["tilted"] for value in row)])


HEAD = ("", "inverse condition, least", "1 %", "median", "below 0.1, %", "below 0.02, %", "least singular value, 1/m", "torque for 35 N, median N m",
        "largest N m", "out of reach")


def cells(label, row):
    return (label, row["inverse_condition_min"], row["inverse_condition_p1"], row["inverse_condition_median"], row["share_below_0.1_percent"],
            row["share_below_0.02_percent"], row["smallest_singular_value_min_per_m"], row["torque_for_35N_median_Nm"], row["torque_for_35N_max_Nm"],
            row["unreachable_poses"])


def show_rings(data, page):
    rings = data["rings"]
    four, three = rings
    page.heading("Four legs against three")
    a, b, tilted_a, tilted_b = stated(four), stated(three), at_tilt(four, 30), at_tilt(three, 30)
    page.text_block(
        "The paper adds a fourth leg, and with it two redundant motors, to resolve the singularities of parallel mechanisms. In the stated workspace "
        f"(z 95 to 205 mm, 20 mm to each side, rotations up to 10 deg) neither device is singular: the least inverse condition number is "
        f"{least_stated(four):.3f} with four legs and {least_stated(three):.3f} with three. The gain of the fourth leg there is force: 35 N in the worst "
        f"direction takes at most {a['torque_for_35N_max_Nm']:.1f} N m per joint, against {b['torque_for_35N_max_Nm']:.1f} N m, more than the 6 N m of the motors. "
        f"Outside the stated workspace the fourth leg makes singularities rarer and moves them outwards, but does not remove them: at 30 deg of tilt {tilted_a['share_below_0.02_percent']:.1f} % "
        f"of the poses are nearer than 0.02 (three legs: {tilted_b['share_below_0.02_percent']:.1f} %), and the least is {tilted_a['inverse_condition_min']:.4f} "
        f"({tilted_b['inverse_condition_min']:.0e}).", verdict=True)
    page.text_block("Both devices have the description's lengths, heights and branches; only the number of legs differs. Lengths that the paper does not give were optimised "
                    "for four legs, so a device designed for three legs might do better. Rotations are scaled with a characteristic length of 0.05 m. The loop stops at 0.02.")
    page.plot(plots.condition_maps(rings, STATED_EXTENT_M, "tilted"), f"The stated workspace: at each place the least of the upright pose and rotations of {TILT_DEG} deg about axes spread "
              "over the sphere. Titles: least and largest in the map.")
    page.plot(plots.condition_maps(rings, STATED_EXTENT_M, "upright"), "The same, upright.")
    page.plot(plots.condition_maps(rings, WIDE_EXTENT_M, "tilted"), f"A wider region, rotations of {TILT_DEG} deg; white: a leg cannot reach. Dashed: the stated workspace. Lines: 0.1 (white), 0.02 (red).")
    page.plot(plots.by_tilt(rings), "Random places of the stated workspace at increasing tilt about random axes.")
    page.table(HEAD, [cells(f"{ring['id']}: {row['id']}", row) for ring in rings for row in ring["rows"]], [0, len(four["rows"])], folded="all figures")


def show_allocation(data, page):
    page.heading("Torque allocation against the clipped pseudo-inverse")
    rows, times = data["allocation"], {row["id"]: row for row in data["times"]}
    worst = max(rows, key=lambda row: row["feasible_percent"] - row["exact_percent"])
    hardest = max(rows, key=lambda row: row["clipping_direction_error_p95_deg"])
    sixty = next(row for row in rows if row["force_N"] == 60)
    page.text_block(
        f"At 60 N the pseudo-inverse's torques are within the motors' limits in {sixty['minimum_norm_fits_percent']:.0f} % of random poses and directions; with the null space "
        f"{sixty['exact_percent']:.0f} % are delivered exactly. The rest is scaled without a change of direction: the largest direction error is {max(row['direction_error_max_deg'] for row in rows):.0e} deg, "
        f"the largest residual {max(row['residual_max'] for row in rows):.0e}. Clipping changes the direction of forces by up to {hardest['clipping_direction_error_max_deg']:.0f} deg, by more than "
        f"{hardest['clipping_direction_error_p95_deg']:.0f} deg in one case of twenty at {hardest['force_N']:.0f} N. The reserve of {data['torque_reserve_percent']:g} % that limits the rate of the torques "
        f"costs at most {worst['feasible_percent'] - worst['exact_percent']:.1f} % of the wrenches their last {data['torque_reserve_percent']:g} % (at {worst['force_N']:.0f} N). "
        f"In time: {allocation_time(times)}.", verdict=True)
    page.plot(plots.allocation(rows), "Eight motors of 6 N m. Left: shares. Right: the angle between delivered and wanted force.")
    page.table(("force", "exact %", "feasible %", "minimum norm fits %", "mean scale", "residual", "largest torque, of limit", "direction error deg", "clipping: median deg", "95 % deg", "largest deg"),
               [(row["id"], row["exact_percent"], row["feasible_percent"], row["minimum_norm_fits_percent"], row["mean_scale"], row["residual_max"], row["largest_torque_of_limit"],
                 row["direction_error_max_deg"], row["clipping_direction_error_median_deg"], row["clipping_direction_error_p95_deg"], row["clipping_direction_error_max_deg"]) for row in rows])
    page.table(("allocate_torques", "wrenches", "median us", "99.9 % us", "largest us"),
               [(row["id"], row["wrenches"], row["median_us"], row["p999_us"], row["max_us"]) for row in data["times"]])
    page.text_block("Times: the least of seven calls in a row for each wrench; the last row is each wrench's first call, interruptions by other work included.")


def show_kinematics(data, page):
    page.heading("Kinematics")
    page.text_block("Random poses of the stated workspace. Forward kinematics against the pose that the angles were computed from (rotation times 0.05 m); from the "
                    "motors alone it starts up to 0.5 mm and 0.5 deg away. The Jacobian's two forms against each other; both against 50 digits under Conditioning.")
    page.table(("", "us per call", "largest error of the pose, m", "most iterations", "largest difference, relative"),
               [(row["id"], row["median_us"], row.get("pose_error_max_m"), row.get("iterations_max"), row.get("difference_from_compact_max"))
                for row in data["kinematics"]])


def allocation_time(times):
    work, first = times["all"], times["all, first call with interruptions"]
    return (f"one allocation takes {work['median_us']:.2f} us in the median and {work['max_us']:.2f} us for the hardest wrench; "
            f"with interruptions by other work, 99.9 % take at most {first['p999_us']:.2f} us and the longest took {first['max_us']:.0f} us")


def show(data, page):
    show_rings(data, page)
    show_kinematics(data, page)
    show_allocation(data, page)


def results(data):
    four, three = (stated(ring) for ring in data["rings"])
    least_four, least_three = (least_stated(ring) for ring in data["rings"])
    sixty = next(row for row in data["allocation"] if row["force_N"] == 60)
    times = {row["id"]: row for row in data["times"]}
    return [f"Device, stated workspace: least inverse condition {least_four:.3f} and {four['torque_for_35N_max_Nm']:.1f} N m per joint for 35 N in any direction with four legs; "
            f"{least_three:.3f} and {three['torque_for_35N_max_Nm']:.1f} N m with three. At 60 N the null space raises exactly delivered wrenches from "
            f"{sixty['minimum_norm_fits_percent']:.0f} % to {sixty['exact_percent']:.0f} %; {allocation_time(times)}."]


def headline(data):
    four, three = (stated(ring)["torque_for_35N_max_Nm"] for ring in data["rings"])
    return (f"Device: a force of 35 N in any direction, anywhere in the device's workspace, needs at most {four:.1f} N m at each motor; "
            f"a device with three of the four legs would need {three:.1f} N m.")
