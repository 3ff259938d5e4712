# SPDX-License-Identifier: Apache-2.0
"""session_report_test.py SOURCE PROGRAMS SCAN WORK: every figure of `trocar-run --session-report` computed again.

From the recording, the scene and, for what no recording holds, the scene's heights: numpy, written from the definitions of
formats/session/session_report.schema.json and not from the program. Sessions: the paper's three slices, the phantom's vertebra cut
through, the same three slices with goals that are met and with goals that are broken, one that ends by a fault, one with two faults
and recoveries, one beside the material and back in its hole, one through soft layers, and one of 90 s whose samples are thinned.
A replay and a session in real time give what their recordings say, too. The page embeds the same report and refers to nothing outside;
rendered in a browser it shows the figures, and text of the scene stays text.
"""
import csv
import html.parser
import json
import math
import pathlib
import re
import shutil
import subprocess
import sys

import numpy as np

from e2e import check, outcome, run
from html_pages import check_self_contained, embedded_json, rendered, texts_of
from schemas_e2e_test import Schema, mutations, planted

CLOSE = 1e-9
PLUNGE_S, STOP_S, STEP_M, SETTLE_S, SAMPLES, PUNCTURES, SPANS = 0.5, 0.05, 5e-5, 0.5, 1024, 1024, 64


def read_rows(file):
    with open(file, newline="") as lines:
        rows = list(csv.DictReader(lines))
    texts = {"state", "fault", "safety", "device_read", "device_write", "outside_fault", "origin"}
    return {key: np.array([row[key] if key in texts else float(row[key]) for row in rows]) for key in rows[0]}


def vectors(rows, *names):
    return np.stack([rows[name] for name in names], axis=1)


# What a figure must be.

def heights(scene, asset_info):
    """[(slice, z, z of its slab's lower end)] from the top: given, or a body's at its true spacing."""
    if "body" not in scene:
        return sorted(((s["index"], s["z_m"], s["z_m"]) for s in scene["slices"]), key=lambda each: -each[1])
    body = scene["body"]
    planes = sorted((s for s in asset_info if body["from"] <= s[0] <= body["to"]), key=lambda s: -s[1])
    z = [body["top_z_m"] - (planes[0][1] - plane[1]) / 1e3 for plane in planes]
    spacing = min(a - b for a, b in zip(z, z[1:]))
    lower = [(a + b) / 2 if a - b < 1.5 * spacing else a - spacing / 2 for a, b in zip(z, z[1:])]
    lower.append(z[-1] - (z[-2] - z[-1]) / 2)
    return [(plane[0], at, low) for plane, at, low in zip(planes, z, lower)]


def punctures_of(rows, counts, scene, sheets, cutting):
    """[(row, sheet)]: by sheets the rows of the state `punctured` with a penetration; by the cutting law the rows in which the
    front goes beyond a slab's lower end with work done."""
    found = []
    if not cutting:
        for k in np.flatnonzero(counts & (rows["state"] == "punctured") & (rows["penetration_m"] > 0)):
            near = [i for i, sheet in enumerate(sheets) if sheet[0] == rows["active_slice"][k]]
            at = rows["tool_z_m"][k] + rows["penetration_m"][k]
            found.append((int(k), min(near, key=lambda i: abs(sheets[i][1] - at))))
        return found
    front = np.where(rows["front_z_m"] == 0, -math.inf, rows["front_z_m"])
    for k in np.flatnonzero(counts[1:] & counts[:-1] & (np.diff(rows["cut_J"]) > 0)) + 1:
        for i, (_, _, low) in enumerate(sheets):
            if front[k - 1] > low + 1e-9 >= front[k]:
                found.append((int(k), i))
    return found


def runs(flags):
    """[first, last] of each run of true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return list(zip(edges[::2], edges[1::2] - 1))


def band_passed(places, rate):
    def biquad(signal, hz, high):
        w = 2 * math.pi * hz / rate
        c, alpha = math.cos(w), math.sin(w) / math.sqrt(2)
        b = ((1 + c) / 2, -(1 + c), (1 + c) / 2) if high else ((1 - c) / 2, 1 - c, (1 - c) / 2)
        a = (1 + alpha, -2 * c, 1 - alpha)
        out = np.zeros_like(signal)
        for k in range(len(signal)):
            x1, x2 = (signal[k - 1] if k > 0 else 0), (signal[k - 2] if k > 1 else 0)
            y1, y2 = (out[k - 1] if k > 0 else 0), (out[k - 2] if k > 1 else 0)
            out[k] = (b[0] * signal[k] + b[1] * x1 + b[2] * x2 - a[1] * y1 - a[2] * y2) / a[0]
        return out
    return biquad(biquad(places - places[0], 4, True), 12, False)


def inside_polygon(ring, x, y):
    """By the winding number, vectorised."""
    total = np.zeros_like(x)
    for (ax, ay), (bx, by) in zip(ring, ring[1:] + ring[:1]):
        total += np.arctan2((ax - x) * (by - y) - (ay - y) * (bx - x), (ax - x) * (bx - x) + (ay - y) * (by - y))
    return np.abs(total) > 3


def zone_distance(zone, tip):
    if "capsule" in zone:
        a, b = np.array(zone["capsule"]["from_m"], float), np.array(zone["capsule"]["to_m"], float)
        along = np.clip((tip - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1) if (b != a).any() else np.zeros(len(tip))
        return np.linalg.norm(tip - a - along[:, None] * (b - a), axis=1) - zone["capsule"]["radius_m"]
    if "box" in zone:
        low, high = np.array(zone["box"]["min_m"]), np.array(zone["box"]["max_m"])
        beyond = np.maximum(low - tip, tip - high)
    else:
        ring, (low, high) = zone["prism"]["outline_m"], zone["prism"]["z_m"]
        edge = np.full(len(tip), np.inf)
        for a, b in zip(ring, ring[1:] + ring[:1]):
            a, b = np.array(a, float), np.array(b, float)
            along = np.clip((tip[:, :2] - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            edge = np.minimum(edge, np.linalg.norm(tip[:, :2] - a - along[:, None] * (b - a), axis=1))
        flat = np.where(inside_polygon(ring, tip[:, 0], tip[:, 1]), -edge, edge)
        beyond = np.stack([flat, np.maximum(low - tip[:, 2], tip[:, 2] - high)], axis=1)
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
    return np.where(outside > 0, outside, beyond.max(axis=1))


def tip_of_plate(rows, scene):
    """The heights of the tip of a tool that is fixed to the plate."""
    w, x, y, z = (rows[name] for name in ("qw", "qx", "qy", "qz"))
    a, b, c = scene["tool"].get("tip_in_plate_m", (0, 0, 0))
    return rows["z_m"] + 2 * (x * z - w * y) * a + 2 * (y * z + w * x) * b + (1 - 2 * (x * x + y * y)) * c


def break_throughs(scene, rows, counts, struck, top_of, bottom_of, rate):
    """`struck`: {row: [what]}. Looks ahead from each row."""
    found, z, t = [], rows["tool_z_m"], rows["t_s"]
    stop, most = round(STOP_S * rate), round(PLUNGE_S * rate)
    wanted = np.sqrt((vectors(rows, "fx_wanted_N", "fy_wanted_N", "fz_wanted_N")**2).sum(axis=1))
    wanted[~counts] = 0
    struck = {k: what for k, what in struck.items() if wanted[k] <= (wanted[k - 1] if k > 0 else 0) / 2}
    fixed = tip_of_plate(rows, scene)
    for k in sorted(struck):
        before = k - 1 if k > 0 and counts[k - 1] else k
        lowest, low_row, how, end = z[before], before, "end", len(z) - 1
        for j in range(k, len(z)):
            if j > k and not counts[j]:
                how, end = "fault", j
                break
            if j > k and j in struck:
                how, end = "next", j
                break
            if z[j] < lowest:
                lowest, low_row = z[j], j
            if z[j] - lowest > STEP_M:
                how, end = "reversed", j
                break
            if j - k >= stop and z[j - stop] - z[j] < STEP_M:
                how, end = "stopped", j
                break
            if j - k >= most:
                how, end = "time", j
                break
        what = min(struck[k], key=top_of)
        hand, plunge = fixed[before] - fixed[low_row], z[before] - lowest
        found.append({**named(what), "t_s": t[k], "plunge_m": plunge, "hand_m": hand, "release_m": plunge - hand, "below_m": bottom_of(what) - lowest,
                      "lowest_t_s": t[max(low_row, k)], "ended_t_s": t[end], "ended_by": how})
    return found


def named(what):
    kind, name = what[:2]
    return {"layer": name if kind == "layer" else None, "slice": name if kind == "slice" else None}


def outlines_on(scene, rows, k, z):
    """Corners and axis of the tool in the planes of these heights, for the tip and the plate's orientation of row k."""
    tool, w = scene["tool"], np.array([rows[name][k] for name in ("qw", "qx", "qy", "qz")])
    spin = math.radians(tool.get("rotation_deg", 0))
    flat = np.array(tool["outline_m"], float) if "outline_m" in tool else tool.get("radius_m", 0.003) * np.array(
        [[math.cos(2 * math.pi * i / tool.get("sides", 6)), math.sin(2 * math.pi * i / tool.get("sides", 6))] for i in range(tool.get("sides", 6))])
    flat = flat @ np.array([[math.cos(spin), math.sin(spin)], [-math.sin(spin), math.cos(spin)]])
    tilt, towards = math.radians(tool.get("tilt_deg", 0)), math.radians(tool.get("tilt_azimuth_deg", 0))
    cos_t, u = math.cos(tilt), np.array([-math.sin(towards), math.cos(towards), 0])

    def turned(v, c, s, n):  # Rodrigues
        return v * c + np.cross(n, v) * s + np.outer(v @ n, n) * (1 - c)

    def by_plate(v):
        n = w[1:]
        return v + 2 * np.cross(n, np.cross(n, v) + w[0] * v)

    axis = by_plate(turned(np.array([[0.0, 0, 1]]), cos_t, math.sin(tilt), u))[0]
    points = np.vstack([np.zeros(3), by_plate(turned(np.column_stack([flat, np.zeros(len(flat))]), cos_t, math.sin(tilt), u))])
    points += [rows[name][k] for name in ("tool_x_m", "tool_y_m", "tool_z_m")]
    return [(points + np.outer((height - points[:, 2]) / axis[2], axis))[:, :2] for height in z]


def from_material(sheet, points):
    """Distance of points in a sheet's plane from its material: by the triangles, and by their edges, inner ones too."""
    corners = sheet["corners"]
    best = np.full(len(points), np.inf)
    inside = np.zeros(len(points), bool)
    sides = []
    for i in range(3):
        a, b = corners[:, i], corners[:, (i + 1) % 3]
        way = b - a
        to = points[:, None, :] - a
        sides.append(way[:, 0] * to[:, :, 1] - way[:, 1] * to[:, :, 0])
        along = np.clip((to * way).sum(axis=2) / (way**2).sum(axis=1), 0, 1)
        best = np.minimum(best, np.sqrt(((to - along[:, :, None] * way)**2).sum(axis=2)).min(axis=1))
    inside = (np.minimum(np.minimum(sides[0], sides[1]), sides[2]) >= 0).any(axis=1)
    return np.where(inside, 0, best)


def final_wall(scene, rows, counts, meshes):
    """The grade at the lowest tip, from the sheets before the session (`--meshes`)."""
    if not counts.any():
        return None
    k = int(np.flatnonzero(counts)[np.argmin(rows["tool_z_m"][counts])])
    step = 2.0**-meshes["lattice_bits"]
    sheets = []
    for sheet in meshes["sheets"]:
        turn = math.radians(sheet["rotation_deg"])
        flat = (np.array(sheet["before"]["vertices"], float) * step - sheet["anchor_mm"]) / 1e3
        flat = flat @ np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]]) + sheet["at_m"]
        sheets.append({"slice": sheet["slice"], "z": sheet["z_m"], "corners": flat[np.array(sheet["before"]["triangles"])]})
    above = [sheet for sheet in sheets if sheet["z"] >= rows["tool_z_m"][k]]
    judged, begin, past = [], None, False
    for sheet, points in zip(above, outlines_on(scene, rows, k, [sheet["z"] for sheet in above])):
        if begin is None and from_material(sheet, points[:1])[0] == 0:
            begin = sheet["z"]
        if begin is None:
            continue
        own = from_material(sheet, points[1:])
        apart = [np.where(own > 0, np.hypot(from_material(other, points[1:]), other["z"] - sheet["z"]), 0) for other in sheets]
        outside = np.min(apart, axis=0).max()
        past = past or outside == 0 or begin - sheet["z"] > 0.005
        if past:
            judged.append((round(outside, 9), sheet["slice"]))
    if not judged:
        return None
    worst = max(judged, key=lambda each: each[0])
    grade = 0 if worst[0] <= 0 else 1 if worst[0] < 0.002 else 2 if worst[0] <= 0.004 else 3
    return {"t_s": rows["t_s"][k], "tip_m": [rows[name][k] for name in ("tool_x_m", "tool_y_m", "tool_z_m")], "outside_m": worst[0], "grade": grade,
            "grade_is": ["0", "under 2 mm", "2 to 4 mm", "over 4 mm"][grade], "slice": worst[1] if worst[0] > 0 else None, "first_slice": judged[0][1],
            "slices_judged": len(judged)}


def attempts_of(rows, counts, tip, t):
    """From the rows in bone: those that follow another without the tip being 1 mm away from it in between belong together."""
    in_bone = counts & np.isin(rows["state"], ["contact", "punctured"]) & (rows["active_slice"] >= 0)
    at = np.flatnonzero(in_bone)
    entries = []
    for before, k in zip([None, *at[:-1]], at):
        between = [] if before is None else [j for j in range(before + 1, k) if counts[j] and np.linalg.norm(tip[j] - tip[before]) >= 0.001]
        is_new = before is None or len(between) > 0
        if is_new and not (k > 0 and counts[k - 1] and tip[k, 2] > tip[k - 1, 2]):
            entries.append({"from_s": t[k], "to_s": t[k]})
        if entries:
            entries[-1]["to_s"] = t[k]
    return {"count": len(entries), "reentries": max(0, len(entries) - 1), "leave_m": 0.001, "listed": entries[:SPANS]}


def expected(scene, rows, asset_info, rate, meshes, layer_punctures=()):
    out, t = {}, rows["t_s"]
    n = len(t)
    cutting = "front_z_m" in rows
    counts = np.isin(rows["safety"], ["ready", "running"])
    tip, state = vectors(rows, "tool_x_m", "tool_y_m", "tool_z_m"), rows["state"]
    force = np.sqrt((vectors(rows, "fx_delivered_N", "fy_delivered_N", "fz_delivered_N")**2).sum(axis=1))
    sheets = heights(scene, asset_info)
    layers = scene.get("layers", [])
    top = max([s[1] for s in sheets] + [layer["top_z_m"] for layer in layers])
    free, contact = counts & (state == "free"), counts & (state == "contact")
    through = counts & np.isin(state, ["punctured", "beside"])
    out["ticks"], out["ticks_counted"] = n, int(counts.sum())

    struck, listed = {}, []
    for k, name in layer_punctures:
        layer = next(layer for layer in layers if layer["name"] == name)
        struck.setdefault(k, []).append(("layer", name, layer["top_z_m"], layer["top_z_m"] - layer["thickness_m"]))
    for k, i in punctures_of(rows, counts, scene, sheets, cutting):
        struck.setdefault(k, []).append(("slice", sheets[i][0], sheets[i][1], sheets[i][1]))
    for k in sorted(struck):
        for what in struck[k]:
            listed.append({**named(what), "t_s": t[k], "force_N": force[k - 1], "depth_m": what[2] - tip[k, 2], "tip_z_m": tip[k, 2],
                           "front_HU": rows["front_HU"][k - 1] if cutting else None})
    out["punctures"], out["punctures_count"] = listed[:PUNCTURES], len(listed)
    plunges = break_throughs(scene, rows, counts, struck, lambda what: what[2], lambda what: what[3], rate)
    out["break_throughs"], out["break_throughs_count"] = plunges[:PUNCTURES], len(plunges)
    out["plunge_max_m"] = max((each["plunge_m"] for each in plunges), default=0)

    steps = np.zeros(n)
    together = counts[1:] & counts[:-1]
    steps[1:][together] = np.linalg.norm(np.diff(tip, axis=0)[together], axis=1)
    first = int(np.flatnonzero(contact)[0]) if contact.any() else None
    path = {"length_m": steps.sum(), "insertion_m": None, "straight_m": None, "straightness": None,
            "lowest_z_m": tip[counts, 2].min(), "depth_max_m": top - tip[counts, 2].min()}
    if first is not None:
        after = np.flatnonzero(counts & (np.arange(n) >= first))
        low = int(after[np.argmin(tip[after, 2])])
        if low > first:
            path["insertion_m"], path["straight_m"] = steps[first + 1:low + 1].sum(), np.linalg.norm(tip[low] - tip[first])
            path["straightness"] = path["straight_m"] / path["insertion_m"]
    out["path"] = path
    first_s, last_s = (t[first] if first is not None else None), (listed[-1]["t_s"] if listed else None)
    both = first_s is not None and last_s is not None
    out["time"] = {"total_s": n / rate, "free_s": free.sum() / rate, "contact_s": contact.sum() / rate, "through_s": through.sum() / rate,
                   "stopped_s": (~counts).sum() / rate, "first_contact_s": first_s, "last_puncture_s": last_s,
                   "contact_to_last_puncture_s": last_s - first_s if both else None}
    k = int(np.argmax(force))
    out["force"] = {"max_N": force[k], "max_t_s": t[k], "max_tip_m": list(tip[k]),
                    "time_integral_N_s": force[counts].sum() / rate,
                    "contact_mean_N": force[contact].mean() if contact.any() else None}

    squares = {"free": [], "contact": []}
    for a, b in runs(counts):
        passed = band_passed(tip[a:b + 1], rate)
        for name, part in (("free", free), ("contact", contact)):
            use = part[a:b + 1].copy()
            use[:round(SETTLE_S * rate)] = False
            squares[name].append(passed[use]**2)
    out["tremor"] = {"low_Hz": 4, "high_Hz": 12, "settle_s": SETTLE_S}
    for name, parts in squares.items():
        all_parts = np.concatenate(parts) if parts else np.zeros((0, 3))
        some = len(all_parts) > 0
        out["tremor"][name] = {"ticks": len(all_parts), "rms_m": math.sqrt(all_parts.sum(axis=1).mean()) if some else None,
                               "sideways_rms_m": math.sqrt(all_parts[:, :2].sum(axis=1).mean()) if some else None}
    expected_goals(out, scene.get("goals"), tip, t, counts, force)

    beside = counts & (state == "beside")
    spans = [(name, a, b) for name in np.unique(rows["active_slice"][beside]) for a, b in runs(beside & (rows["active_slice"] == name))]
    spans.sort(key=lambda span: span[1])
    cuts = int(rows["cuts_published"][-1]) - sum(1 for each in listed if each["layer"] is None)
    out["walls"] = {"beside": [{"slice": None if name < 0 else int(name), "from_s": t[a], "to_s": t[b]} for name, a, b in spans[:SPANS]],
                    "beside_count": len(spans), "beside_s": beside.sum() / rate, "side_cuts_count": cuts, "final": final_wall(scene, rows, counts, meshes)}
    out["attempts"] = attempts_of(rows, counts, tip, t)
    xray = rows["xray"].astype(int) if "xray" in rows else np.zeros(n, int)
    out["xray"] = {"shots": int((xray & 1).sum()), "screening_s": int((xray >> 1).sum()) / rate}
    stops = [k for k in range(n) if rows["fault"][k] != "none" and (k == 0 or rows["fault"][k] != rows["fault"][k - 1])]
    faults = [k for k in stops if rows["fault"][k] not in ("paused", "forces_off")]
    out["operator_stops_count"] = len(stops) - len(faults)
    out["faults"] = []
    for k, following in zip(faults, faults[1:] + [n]):
        again = [j for j in range(k + 1, following) if rows["safety"][j] == "running"]
        out["faults"].append({"fault": rows["fault"][k], "t_s": t[k], "recovered_t_s": t[again[0]] if again else None})
    out["faults_count"] = len(faults)

    known = np.flatnonzero(rows["safety"] != "idle")
    stride = 1
    while len(known) > SAMPLES * stride:
        stride *= 2
    kept = [group[np.argmax(force[group])] for group in (known[i:i + stride] for i in range(0, len(known), stride))]
    out["samples"] = {"stride": stride, "columns": ["t_s", "tool_x_m", "tool_y_m", "tool_z_m", "force_N", "front_HU"],
                      "rows": [[t[k], *tip[k], force[k], rows["front_HU"][k] if cutting else None] for k in kept]}
    return out


def expected_goals(out, goals, tip, t, counts, force):
    out.update({"line": None, "target": None, "zones": [], "goals": []})
    if goals is None:
        out["goals_met"] = 0
        return
    tip, t = tip[counts], t[counts]

    def judge(goal, limit, value, unit="m", zone=None):
        met = value is not None and (value >= limit if goal == "zone" else value <= limit)
        out["goals"].append({"goal": goal, "zone": zone, "limit": limit, "limit_is": "least" if goal == "zone" else "largest",
                             "value": value, "unit": unit, "met": bool(met)})

    reached = None
    if "target" in goals:
        away = np.linalg.norm(tip - goals["target"]["at_m"], axis=1)
        inside = np.flatnonzero(away <= goals["target"]["radius_m"])
        reached = t[inside[0]] if len(inside) else None
        out["target"] = {"closest_m": away.min(), "closest_t_s": t[np.argmin(away)], "reached_t_s": reached}
        judge("target", goals["target"]["radius_m"], away.min())
    if "line" in goals:
        line, entry = goals["line"], np.array(goals["line"]["entry_m"], float)
        way = np.array(line["direction"], float) if "direction" in line else np.array(line.get("to_m", goals.get("target", {}).get("at_m"))) - entry
        way = way / np.linalg.norm(way)
        along = (tip - entry) @ way
        away = np.linalg.norm(tip - entry - along[:, None] * way, axis=1)[along >= 0]
        some = len(away) > 0
        out["line"] = {"ticks": len(away), "max_m": away.max() if some else None, "rms_m": math.sqrt((away**2).mean()) if some else None,
                       "entry_m": away[0] if some else None}
        if "entry_radius_m" in line:
            judge("entry", line["entry_radius_m"], out["line"]["entry_m"])
        if "corridor_m" in line:
            judge("corridor", line["corridor_m"], out["line"]["max_m"])
    if "force_max_N" in goals:
        judge("force", goals["force_max_N"], force.max(), "N")
    if "time_max_s" in goals:
        end = reached if "target" in goals else out["time"]["last_puncture_s"]
        start = out["time"]["first_contact_s"]
        judge("time", goals["time_max_s"], end - start if end is not None and start is not None else None, "s")
    if "plunge_max_m" in goals:
        judge("plunge", goals["plunge_max_m"], out["plunge_max_m"])
    for zone in goals.get("zones", []):
        away = zone_distance(zone, tip)
        spans = runs(away < 0)
        breaches = [{"from_s": t[a], "to_s": t[b], "depth_m": -away[a:b + 1].min(), "depth_t_s": t[a + np.argmin(away[a:b + 1])]}
                    for a, b in spans]
        out["zones"].append({"name": zone["name"], "min_m": away.min(), "min_t_s": t[np.argmin(away)], "breaches": breaches[:SPANS],
                             "breaches_count": len(spans)})
        judge("zone", zone.get("margin_m", 0), away.min(), zone=zone["name"])
    out["goals_met"] = sum(goal["met"] for goal in out["goals"])


# The comparison.

def compare(where, want, got):
    """Every figure of `want`; `got` may also have words."""
    if isinstance(want, dict):
        check(isinstance(got, dict) and set(want) <= set(got), f"{where}: {str(got)[:200]}")
        for key in want if isinstance(got, dict) else ():
            if key in got:
                compare(f"{where}/{key}", want[key], got[key])
    elif isinstance(want, list):
        check(isinstance(got, list) and len(want) == len(got), f"{where}: {len(got)} entries, not {len(want)}: {str(got)[:300]}")
        for i, pair in enumerate(zip(want, got)):
            compare(f"{where}/{i}", *pair)
    elif isinstance(want, (bool, str)) or want is None:
        check(want == got, f"{where}: {got!r}, not {want!r}")
    elif got is None or isinstance(got, (str, bool)):
        check(False, f"{where}: {got!r}, not {want!r}")
    else:  # a difference of two lengths is as exact as they are, 0.1 m
        check(abs(want - got) <= CLOSE * max(abs(want), abs(got)) + 1e-15, f"{where}: {got!r}, not {want!r}")


def check_csv(name, report, file):
    """The CSV has every number and text of the figures but the samples, under its path."""
    def leaves(value, path=""):
        if isinstance(value, (dict, list)):
            for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
                yield from leaves(inner, f"{path}/{key}" if path else str(key))
        else:
            yield path, value
    want = {path: value for path, value in leaves({key: value for key, value in report.items() if key != "samples"})}
    with open(file, newline="") as lines:
        got = {row["figure"]: row["value"] for row in csv.DictReader(lines)}
    empty = {path for path, text in got.items() if text == "" and path not in want}  # empty lists
    check(set(got) - empty == set(want), f"{name}: csv: {sorted(set(got) ^ set(want))[:5]}")
    for path, value in want.items():
        text = got.get(path, "")
        if isinstance(value, bool) or value is None:
            is_same = text == {True: "true", False: "false", None: ""}[value]
        elif isinstance(value, str):
            is_same = text in (value, "'" + value)
        else:
            is_same = float(text) == value
        check(is_same, f"{name}: csv: {path} is {text!r}, not {value!r}")


class Elements(html.parser.HTMLParser):
    """Tags and attributes of a rendered page; every element must be closed."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.values, self.links, self.open = [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.values += [value or "" for _, value in attrs]
        self.links += [value for name, value in attrs if name in ("src", "href", "srcset", "action", "data") or name.startswith("on")]
        if tag not in ("meta", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        check(self.open and self.open[-1] == tag, f"page: </{tag}> after {self.open[-3:]}")
        if self.open:
            self.open.pop()


class WholeRows(Schema):
    """Mistakes are made in the first items of lists of objects; a row of samples stays whole."""

    def check(self, what, document, part=None):
        for error in list(self.validator.iter_errors(document))[:3]:
            check(False, f"{what}: {error.json_path}: {error.message[:300]}")
        few = {key: value[:3] if isinstance(value, list) else value for key, value in document.items()}
        few["samples"] = {**document["samples"], "rows": document["samples"]["rows"][:3]}
        for reason, changed in (*planted(few, few), *mutations(few, self.tree)):
            kind = re.sub(r"/\d+", "/N", reason)
            if kind not in self.changes:
                self.changes.add(kind)
                check(not self.validator.is_valid(changed), f"{what}: accepted although {reason}")


class Sessions:
    def __init__(self, source, programs, asset, work):
        self.programs, self.asset, self.work = programs, asset, work
        self.schema = WholeRows(source, "session_report")
        info = json.loads(run(programs / "trocar-mesh", "info", "--json", asset).stdout)
        self.planes = [(each["index"], each["z_mm"]) for each in info["slices"]]

    def run(self, name, scene, *options, expect=0, clock="virtual", layer_punctures=None):
        made = self.work / f"{name}.json.scene"
        made.write_text(json.dumps(scene))
        meshes = self.work / f"{name}.meshes.json"
        page, record, summary = self.work / f"{name}.html", self.work / f"{name}.csv", self.work / f"{name}.summary.json"
        run(self.programs / "trocar-run", made, "--asset", self.asset, "--clock", clock, "--quiet", "--session-report", page,
            *(() if "--replay" in options else ("--black-box", self.work)), "--record", record, "--summary", summary, "--meshes", meshes, *options, expect=expect)
        report, summed = json.loads(page.with_suffix(".json").read_text()), json.loads(summary.read_text())
        rows = read_rows(record)
        found = layer_punctures(rows) if layer_punctures else ()
        compare(name, expected(scene, rows, self.planes, summed["rate_Hz"], json.loads(meshes.read_text()), found), report)
        check(report["trainee"] == summed["trainee"], f"{name}: trainee: {report['trainee']}, summary: {summed['trainee']}")
        check_csv(name, report, page.with_suffix(".figures.csv"))
        self.schema.check(name, report)
        check(report["scene"] == scene["name"] and report["end"] == summed["end"] and report["ticks_lost"] == 0, f"{name}: {report['end']}")
        check(abs(report["force"]["max_N"] - summed["max_force_N"]) <= CLOSE * summed["max_force_N"], f"{name}: largest force")
        slices = [(each["slice"], each["t_s"]) for each in report["punctures"] if each["layer"] is None]
        check(slices == [(each["slice"], each["t_s"]) for each in summed["punctures"]], f"{name}: punctures are not the summary's")
        for each, other in zip((each for each in report["punctures"] if each["layer"] is None), summed["punctures"]):
            check(each["tip_N"] == other["force_N"] and abs(each["force_N"] - other["hand_N"]) <= CLOSE * other["hand_N"], f"{name}: {each}, {other}")
            if "tip_N" in rows:  # of the tick before, before the scene's scale
                before = rows["tip_N"][np.searchsorted(rows["t_s"], each["t_s"] - 1e-9) - 1] * scene["force_law"].get("force_scale", 1)
                check(abs(each["tip_N"] - before) <= CLOSE * before + 1e-9, f"{name}: {each['tip_N']} N at the tip, {before} N in the rows")
        check([each["message"] for each in report["faults"]] == [each["message"] for each in summed["faults"]], f"{name}: messages of faults")
        check(report["walls"]["side_cuts_count"] == summed.get("cutting", {}).get("side_cuts", 0), f"{name}: side cuts")
        self.check_page(name, page, report)
        return report, rows

    def check_page(self, name, file, report):
        text = file.read_text()
        check_self_contained(name, text)
        check(embedded_json(text, "report") == report, f"{name}: the page embeds another report")
        page = rendered(file)
        if page is None:
            return
        elements = Elements(page)
        check(not elements.links and not set(elements.tags) & {"img", "iframe", "link", "object", "base"}, f"{name}: page holds {elements.links}")
        check(elements.tags.count("script") == 3 and not elements.open, f"{name}: page: {elements.tags.count('script')} scripts, not closed: {elements.open}")
        has_hu = any(row[5] not in (None, 0) and row[5] > -1000 for row in report["samples"]["rows"])
        check(elements.tags.count("svg") == 5 + has_hu and elements.tags.count("circle") >= 2 * len(report["punctures"]), f"{name}: page: pictures")
        check(not any(re.search("NaN|Infinity|undefined|null", value) for value in elements.values), f"{name}: page: numbers of pictures")
        words = " ".join(" ".join(texts_of(page)).split())
        check(report["scene"] in words and not re.search(r"\b(NaN|Infinity|undefined|null)\b", words), f"{name}: page: {words[:300]}")
        for goal in report["goals"]:
            value = "none" if goal["value"] is None else f"{goal['value'] * 1e3:.2f} mm" if goal["unit"] == "m" else f"{goal['value']:.2f}"
            check(value in words, f"{name}: page lacks {goal['goal']} {value}")
        of_breaks = {(each["t_s"], each["layer"], each["slice"]) for each in report["break_throughs"]}
        for each in (each for each in report["punctures"] if (each["t_s"], each["layer"], each["slice"]) in of_breaks):
            check(f"{each['force_N']:.2f} N" in words and f"{each['tip_N']:.2f} N" in words and f"{each['t_s']:.3f} s" in words, f"{name}: page lacks {each}")
        for each in report["break_throughs"]:
            check(f"{each['plunge_m'] * 1e3:.2f} mm" in words, f"{name}: page lacks {each}")
        integral, attempts = f"{report['force']['time_integral_N_s']:.2f} N s", f"{report['attempts']['count']}, {report['attempts']['reentries']}"
        check(integral in words and attempts in words, f"{name}: page lacks {integral} or {attempts}")
        final = report["walls"]["final"]
        check((f"Grade: {final['grade_is']}." if final else "there is no grade") in words, f"{name}: page lacks the grade of {final}")
        for known in ("10.52198/21.sti.38.os1365", "PMID 27085361", "RAPM 44:298", "PMC7882829", "no published validation known"):
            check(known in words, f"{name}: page lacks {known}")
        code = (report["trainee"] or {}).get("code")
        check(code is None or f"Trainee {code}" in words, f"{name}: page lacks {code}")
        for each in report["faults"]:
            check(" ".join(each["message"].split()) in words, f"{name}: page lacks {each}")
        for each in report["zones"]:
            check(each["name"] in words and f"{each['min_m'] * 1e3:.2f} mm" in words, f"{name}: page lacks {each}")


def descent(scene, *points, **fields):
    return {**scene, **fields, "hand": {**scene["hand"], "trajectory": [{"t_s": p[0], "tip_m": list(p[1:4])} for p in points]}}


def soft_layers(scene):
    """Two layers over the body, far apart, so that each is punctured on its own."""
    law = dict(scene["force_law"], axis="rigid", prediction="off")
    layers = [{"name": "skin <&\"'>", "top_z_m": 0.18, "thickness_m": 0.002, "stiffness_N_per_m": 400, "stiffening_N_per_m2": 50000,
               "puncture_N": 3, "cutting_N": 0.5},
              {"name": "fascia", "top_z_m": 0.168, "thickness_m": 0.001, "stiffness_N_per_m": 1000, "puncture_N": 4, "cutting_N": 0.2}]
    points = ((0, 0, 0, 0.185), (0.1, 0, 0, 0.185), (3.5, 0, 0, 0.1585), (3.8, 0, 0, 0.1585))
    return descent({**scene, "layers": layers, "force_law": law, "duration_s": 3.8}, *points)


def layer_rows(scene):
    """Of a rigid tool: a layer is punctured in the first tick in which its spring, without it, would exceed the puncture force."""
    def find(rows):
        found = []
        for layer in scene["layers"]:
            z = layer["top_z_m"] - rows["tool_z_m"]
            spring = np.where(z > 0, layer.get("stiffness_N_per_m", 0) * z + layer.get("stiffening_N_per_m2", 0) * z**2, 0)
            found.append((int(np.flatnonzero(spring > layer["puncture_N"])[0]), layer["name"]))
        return found
    return find


def goals(broken):
    """Of the three slices, along z at x = y = 0 from 0.202 to 0.088 m."""
    ring = [[0.002, -0.01], [0.02, -0.01], [0.02, 0.01], [0.008, 0], [0.002, 0.01]]
    zones = [{"name": "canal", "margin_m": 0.0015, "prism": {"outline_m": ring, "z_m": [0.09, 0.18]}},
             {"name": "vessel", "margin_m": 0.001, "capsule": {"from_m": [0.01, 0.02, 0.1], "to_m": [0.01, -0.02, 0.2], "radius_m": 0.004}},
             {"name": "lung", "box": {"min_m": [-0.05, -0.05, 0.02], "max_m": [0.05, 0.05, 0.08]}}]
    made = {"target": {"at_m": [0, 0, 0.1], "radius_m": 0.003}, "force_max_N": 60, "time_max_s": 8, "plunge_max_m": 0.02,
            "line": {"entry_m": [0.0005, 0, 0.195], "entry_radius_m": 0.002, "corridor_m": 0.003}, "zones": zones}
    if not broken:
        return made
    made.update({"target": {"at_m": [0.03, 0, 0.11], "radius_m": 0.001}, "force_max_N": 20, "time_max_s": 1, "plunge_max_m": 0.0005,
                 "line": {"entry_m": [0.004, 0.003, 0.195], "direction": [0.1, 0.2, -1], "entry_radius_m": 0.002, "corridor_m": 0.003}})
    made["zones"] = [{"name": "canal <b>", "prism": {"outline_m": [[x - 0.007, y] for x, y in ring], "z_m": [0.12, 0.16]}},
                     {"name": "vessel", "capsule": {"from_m": [0.002, 0.02, 0.15], "to_m": [0.002, -0.02, 0.15], "radius_m": 0.004}},
                     {"name": "lung", "box": {"min_m": [-0.05, -0.05, 0.02], "max_m": [0.05, 0.05, 0.11]}}]
    return made


def check_options(sessions, scene):
    made, trocar_run = sessions.work / "options.json.scene", sessions.programs / "trocar-run"
    made.write_text(json.dumps(scene))
    base = (trocar_run, made, "--asset", sessions.asset, "--clock", "virtual", "--quiet")
    for words, code, said in (
            (("--session-report", sessions.work / "x.txt"), 2, "must be a name that ends in .html"),
            (("--session-report", sessions.work / ".html"), 2, "must be a name that ends in .html"),
            (("--session-report", sessions.work / "x.html", "--summary", sessions.work / "x.json"), 2, "x.json"),
            (("--session-report", sessions.work / "no" / "x.html"), 4, "x.html")):
        done = subprocess.run([str(word) for word in (*base, *words)], capture_output=True, text=True, check=False)
        check(done.returncode == code and said in done.stderr and done.stderr.count("\n") == 1, f"{words}: {done}")
    far = {**scene, "goals": {"target": {"at_m": [0.3, 0, 0.1], "radius_m": 0.003}}}
    made.write_text(json.dumps(far))
    done = subprocess.run([str(word) for word in (*base, "--check", "--strict")], capture_output=True, text=True, check=False)
    check(done.returncode == 3 and "the target at (0.3000, 0.0000, 0.1000) m cannot be reached" in done.stderr, f"target: {done}")


def main():
    source, programs, scan, work = (pathlib.Path(word).resolve() for word in sys.argv[1:5])
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    asset = work / "sample.glb"
    run(programs / "trocar-mesh", scan / "dicom", "-o", asset, "--quiet")
    sessions = Sessions(source, programs, asset, work)
    scenes = {path.stem: json.loads(path.read_text()) for path in (source / "runtime" / "scenes").glob("*.json")}
    three = scenes["three_slices"]

    report, _ = sessions.run("three", three)
    check(report["punctures_count"] == 3 and report["break_throughs_count"] == 3 and report["goals"] == [], "three: too little happened")
    who = ("--trainee", "A-17", "--course", "spine_2026", "--attempt", "3")
    report, _ = sessions.run("met", {**three, "goals": goals(False)}, *who)
    check(report["trainee"] == {"code": "A-17", "course": "spine_2026", "attempt": 3}, f"met: {report['trainee']}")
    check(report["goals_met"] == len(report["goals"]) == 9, f"met: {report['goals']}")
    report, _ = sessions.run("broken", {**three, "name": "<script>alert(1)</script> & 'x'", "goals": goals(True)})
    check(report["goals_met"] == 0 and len(report["goals"]) == 9, f"broken: {report['goals']}")
    check(all(zone["breaches_count"] > 0 for zone in report["zones"]), f"broken: {report['zones']}")
    check("<script>alert" not in (work / "broken.html").read_text(), "not escaped")
    page = rendered(work / "broken.html")
    check(page is None or "canal &lt;b&gt;" in page and "&lt;script&gt;alert(1)" in page, "not text in the rendered page")
    report, _ = sessions.run("vertebra", scenes["vertebra"])
    check(report["punctures_count"] >= 20 and report["path"]["straightness"] > 0.9, "vertebra: too little happened")
    sessions.run("network", scenes["network_rim"])
    grades = {}
    for x_mm in (0, 18, 20, 22):
        moved = [(p["t_s"], p["tip_m"][0] + x_mm / 1e3, p["tip_m"][1], max(p["tip_m"][2], 0.13)) for p in scenes["vertebra"]["hand"]["trajectory"]]
        report, _ = sessions.run(f"wall_{x_mm}", descent(scenes["vertebra"], *moved))
        grades[x_mm] = report["walls"]["final"] and report["walls"]["final"]["grade"]
    check(grades[0] == 0 and {1, 2} <= set(grades.values()), f"wall: {grades}")
    away = [(0, 0, 0, 0.13), (0.8, 0, 0, 0.109), (1.2, 0.09, 0, 0.13), (2.4, 0, 0, 0.13), (4.2, 0, 0, 0.13), (5.0, 0, 0, 0.108)]
    report, _ = sessions.run("fault", descent(scenes["one_slice"], *away, duration_s=3), expect=5)
    check(report["faults_count"] == 1 and report["faults"][0]["recovered_t_s"] is None and report["time"]["stopped_s"] > 0,
          f"fault: {report['faults']}")
    report, _ = sessions.run("recovered", descent(scenes["one_slice"], *away, duration_s=5), "--recover", "auto")
    check(report["faults_count"] >= 1 and report["faults"][0]["recovered_t_s"] is not None, f"recovered: {report['faults']}")
    hole = [(0, 0, 0, 0.124), (0.1, 0, 0, 0.124), (2, 0, 0, 0.1), (2.5, 0, 0, 0.13), (3, 0.0005, 0, 0.13), (3.5, 0.0005, 0, 0.11), (4, 0, 0, 0.13),
            (4.5, 0.029, -0.002, 0.13), (5, 0.029, -0.002, 0.112), (5.5, 0.029, -0.002, 0.13)]
    report, _ = sessions.run("beside", descent({**scenes["one_slice"], "hand": three["hand"]}, *hole, duration_s=5.6))
    check(report["walls"]["beside_count"] >= 1, f"beside: {report['walls']}")
    twice = [(0, 0, 0, 0.124), (0.1, 0, 0, 0.124), (1.5, 0, 0, 0.1), (2.2, 0, 0, 0.13), (2.8, 0.012, 0, 0.13), (4.2, 0.012, 0, 0.1), (5, 0.012, 0, 0.13)]
    report, _ = sessions.run("twice", descent({**scenes["one_slice"], "hand": three["hand"]}, *twice, duration_s=5))
    check(report["attempts"]["reentries"] == 1, f"twice: {report['attempts']}")
    layered = soft_layers(scenes["vertebra"])
    report, _ = sessions.run("layers", layered, layer_punctures=layer_rows(layered))
    check([each["layer"] for each in report["punctures"]] == [layer["name"] for layer in layered["layers"]], f"layers: {report['punctures']}")
    tilted = [(0, 0, 0, 0.162), (0.2, 0, 0, 0.162), (3, 0, 0, 0.13), (4, 0.012, 0.008, 0.13), (6, 0, 0, 0.162)]
    weak = json.loads(json.dumps(scenes["vertebra"]))
    weak["tissue"]["cut"].update(lateral_strength_MPa=0.3)
    report, _ = sessions.run("walls", descent(weak, *tilted, duration_s=6))
    check(report["walls"]["side_cuts_count"] > 0, f"walls: {report['walls']}")
    long = [(0, 0, 0, 0.124), (1, 0, 0, 0.124), (60, 0, 0, 0.1), (89, 0, 0, 0.13)]
    report, _ = sessions.run("long", descent({**scenes["one_slice"], "hand": three["hand"]}, *long, duration_s=90), "--rate", "200")
    check(report["samples"]["stride"] > 8, f"long: {report['samples']['stride']}")

    made = work / "met.json.scene"
    run(programs / "trocar-run", made, "--asset", asset, "--quiet", "--replay", work / "met.csv", "--session-report", work / "again.html")
    for kind in ("html", "json"):
        check((work / f"again.{kind}").read_bytes() == (work / f"met.{kind}").read_bytes(), f"a replay's {kind} differs")
    sessions.run("real", descent(scenes["one_slice"], (0, 0, 0, 0.125), (0.6, 0, 0, 0.11), duration_s=0.8), clock="real")
    check_options(sessions, three)
    return outcome()


if __name__ == "__main__":
    sys.exit(main())
