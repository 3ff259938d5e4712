# SPDX-License-Identifier: Apache-2.0
"""The figures of a session report, computed from the recording, the scene and, for what no recording holds, the scene's heights: numpy,
written from the definitions of formats/session/session_report.schema.json and not from the program. session_report_test.py compares."""
import math

import numpy as np
from exported import rows_of

SETTLE_S, SAMPLES, PUNCTURES, SPANS = 0.5, 1024, 1024, 64


def read_rows(file):
    rows = rows_of(file)
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


def axis_of(rows, scene):
    """The unit vectors up the shaft."""
    tool, n = scene["tool"], vectors(rows, "qx", "qy", "qz")
    tilt, towards = math.radians(tool.get("tilt_deg", 0)), math.radians(tool.get("tilt_azimuth_deg", 0))
    v = np.array([math.sin(tilt) * math.cos(towards), math.sin(tilt) * math.sin(towards), math.cos(tilt)])
    return v + 2 * np.cross(n, np.cross(n, v) + rows["qw"][:, None] * v)


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
        was_below = k > 0 and counts[k - 1] and (rows["state"][k - 1] == "beside" or (
            rows["state"][k - 1] == "contact" and rows["active_slice"][k - 1] < 0 and rows["state"][k] == "punctured"))
        comes_back = bool(entries) and was_below and tip[k, 2] > tip[k - 1, 2]
        if is_new and not comes_back:
            entries.append({"from_s": t[k], "to_s": t[k]})
        if entries:
            entries[-1]["to_s"] = t[k]
    return {"count": len(entries), "reentries": max(0, len(entries) - 1), "leave_m": 0.001, "listed": entries[:SPANS]}


def below_surface(rows, counts, tip):
    """Rows at most 1 mm above the greatest height at which the tip was in bone since it was last above everything; and rows after which it is
    above everything again, or the session ends, before it is in bone."""
    in_bone = counts & np.isin(rows["state"], ["contact", "punctured"]) & (rows["active_slice"] >= 0)
    out, surface = np.zeros(len(tip), bool), None
    for k in np.flatnonzero(counts):
        if rows["state"][k] == "free":
            surface = None
        elif in_bone[k]:
            surface = tip[k, 2] if surface is None else max(surface, tip[k, 2])
        if surface is not None:
            out[k] = tip[k, 2] <= surface + 0.001
        else:
            rest = np.flatnonzero(in_bone[k:] | (counts[k:] & (rows["state"][k:] == "free")))
            out[k] = not (len(rest) and in_bone[k + rest[0]])
    return out


def expected(scene, rows, asset_info, rate, meshes, plunge_max_m, layer_punctures=()):
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
            listed.append({**named(what), "t_s": t[k], "hand_N": force[k - 1], "tip_N": rows["tip_N"][k - 1], "depth_m": what[2] - tip[k, 2], "tip_z_m": tip[k, 2],
                           "front_HU": rows["front_HU"][k - 1] if cutting else None})
    out["punctures"], out["punctures_count"] = listed[:PUNCTURES], len(listed)
    out["plunge_max_m"], out["break_throughs_count"] = plunge_max_m, int((rows["break_through_N"] > 0).sum())

    steps = np.zeros(n)
    together = counts[1:] & counts[:-1]
    steps[1:][together] = np.linalg.norm(np.diff(tip, axis=0)[together], axis=1)
    touching = contact.copy()
    touching[[k for k in struck if counts[k]]] = True
    first = int(np.flatnonzero(touching)[0]) if touching.any() else None
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
            across = np.cross(passed, axis_of(rows, scene)[a:b + 1])
            squares[name].append((across[use]**2).sum(axis=1))
    out["tremor"] = {"low_Hz": 4, "high_Hz": 12, "settle_s": SETTLE_S}
    for name, parts in squares.items():
        all_parts = np.concatenate(parts) if parts else np.zeros(0)
        out["tremor"][name] = {"ticks": len(all_parts), "across_rms_m": math.sqrt(all_parts.mean()) if len(all_parts) else None}
    expected_goals(out, scene.get("goals"), tip, t, counts, force)

    beside = counts & (state == "beside") & below_surface(rows, counts, tip)
    spans = [(name, a, b) for name in np.unique(rows["active_slice"][beside]) for a, b in runs(beside & (rows["active_slice"] == name))]
    spans.sort(key=lambda span: span[1])
    cuts = int(rows["cuts_published"][-1]) - sum(1 for each in listed if each["layer"] is None)
    out["walls"] = {"beside": [{"slice": None if name < 0 else int(name), "from_s": t[a], "to_s": t[b]} for name, a, b in spans[:SPANS]],
                    "beside_count": len(spans), "beside_s": beside.sum() / rate, "side_cuts_count": cuts, "final": final_wall(scene, rows, counts, meshes)}
    out["attempts"] = attempts_of(rows, counts, tip, t)
    xray = rows["xray"].astype(int) if "xray" in rows else np.zeros(n, int)
    out["xray"] = {"shots": int((xray & 1).sum()), "screening_s": int((xray >> 1).sum()) / rate}
    again = np.zeros(n, bool)  # raised again within a recovery, or by a stop that is pressed again
    again[1:] = (rows["safety"][1:] == "fault") & (rows["safety"][:-1] == "recovering")
    held = told = by_operator = False
    for k, (read, write, outside) in enumerate(zip(rows["device_read"], rows["device_write"], rows["outside_fault"])):
        was, was_operator = held, by_operator
        held = held if read in ("no_data", "link_lost") else read == "emergency_stop" or told
        told = write == "emergency_stop"
        by_operator = outside == "emergency_stop"
        again[k] |= ((held or told) and not was) or (by_operator and not was_operator)
        held |= told
    stops = [k for k in range(n) if rows["fault"][k] != "none" and (k == 0 or rows["fault"][k] != rows["fault"][k - 1] or again[k])]
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
    out["samples"] = {"stride": stride, "columns": ["t_s", "tool_x_m", "tool_y_m", "tool_z_m", "hand_N", "front_HU"],
                      "rows": [[t[k], *tip[k], force[k], rows["front_HU"][k] if cutting else None] for k in kept]}
    return out


def expected_goals(out, goals, tip, t, counts, force):
    out.update({"line": None, "target": None, "zones": [], "goals": []})
    if goals is None:
        out["goals_met"] = out["goals_attempted"] = 0
        return
    tip, t = tip[counts], t[counts]

    has_touched = out["time"]["first_contact_s"] is not None

    def judge(goal, limit, value, unit="m", zone=None):
        attempted = has_touched and (value is not None or goal == "time")
        if goal == "target":
            attempted = has_touched or value <= limit
        if goal == "zone":
            attempted = has_touched or value < 0
        if goal == "plunge":
            attempted = out["break_throughs_count"] > 0 or value > limit
        met = attempted and value is not None and (value >= limit if goal == "zone" else value <= limit)
        out["goals"].append({"goal": goal, "zone": zone, "limit": limit, "limit_is": "least" if goal == "zone" else "largest",
                             "value": value, "unit": unit, "attempted": bool(attempted), "met": bool(met)})

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
        judge("time", goals["time_max_s"], max(0, end - start) if end is not None and start is not None else None, "s")
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
    out["goals_attempted"] = sum(goal["attempted"] for goal in out["goals"])
