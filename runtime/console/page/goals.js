// SPDX-License-Identifier: Apache-2.0
// How the scene's goals stand, in words and figures: while a session runs, from the rows that this page gets; in playback, from the rows
// up to the moment that is shown. When the session has ended, or the recording is at its end, the verdict is that of the session report.
// The definitions are those of runtime/report/session_observer.h.
import { file_query, get_text } from "./api.js";

const kReady = 1, kRunning = 2, kContact = 1, kPunctured = 2;  // SafetyState, ContactPhase
const kGap_s = 1;  // between rows that a page gets while it is open and not hidden
const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const length = (a) => Math.hypot(a[0], a[1], a[2]);

/// Returns the distance of a point from a polygon's border, negative inside.
function polygon_distance(ring, x, y) {
  let least = Infinity, is_inside = false;
  ring.forEach(([bx, by], i) => {
    const [ax, ay] = ring[(i + ring.length - 1) % ring.length], ux = bx - ax, uy = by - ay;
    const along = Math.min(1, Math.max(0, ((x - ax) * ux + (y - ay) * uy) / (ux * ux + uy * uy)));
    least = Math.min(least, Math.hypot(x - ax - along * ux, y - ay - along * uy));
    if (ay > y !== by > y && x < ax + (y - ay) / uy * ux) is_inside = !is_inside;
  });
  return is_inside ? -least : least;
}

/// Returns the distance of a point from a zone of the scene, in m, negative inside.
export function zone_distance({ capsule, box, prism }, p) {
  if (capsule) {
    const way = minus(capsule.to_m, capsule.from_m), from = minus(p, capsule.from_m), square = dot(way, way);
    const along = square > 0 ? Math.min(1, Math.max(0, dot(from, way) / square)) : 0;
    return length(from.map((value, k) => value - along * way[k])) - capsule.radius_m;
  }
  const beyond = box ? p.map((value, k) => Math.max(box.min_m[k] - value, value - box.max_m[k]))
    : [polygon_distance(prism.outline_m, p[0], p[1]), Math.max(prism.z_m[0] - p[2], p[2] - prism.z_m[1])];
  const most = Math.max(...beyond);
  return most <= 0 ? most : Math.hypot(...beyond.map((value) => Math.max(0, value)));
}

function direction_of({ line, target }) {
  const way = line.direction ?? minus(line.to_m ?? target.at_m, line.entry_m), size = length(way);
  return way.map((value) => value / size);
}

/// Collects the values of the goals, row by row.
export class GoalMeter {
  constructor(goals) {
    this.goals = goals;
    this.direction = goals.line ? direction_of(goals) : null;
    this.zones = (goals.zones ?? []).map(() => ({ now: NaN, least: Infinity }));
    this.closest = this.off_line_max = this.entry = this.force_max = this.first_contact_s = this.reached_s = null;
    this.distance = this.off_line = this.force = NaN;
    this.t_s = this.unseen_s = 0;  // time of the last row, and of the session that no row was seen of
  }
  take(shown, row) {
    const { goals } = this, safety = shown.columns.value(row, "safety", kRunning), force = shown.force(row);
    const t_s = shown.columns.value(row, "t_s");
    if (t_s - this.t_s > kGap_s) this.unseen_s += t_s - this.t_s;
    this.t_s = t_s;
    if (Number.isFinite(force)) {
      this.force = force;
      this.force_max = Math.max(this.force_max ?? 0, force);
    }
    if (safety !== kReady && safety !== kRunning) return;
    const tip = Array.from(shown.columns.values(row, "tool_m"));
    // A slice can be reached and punctured in the same tick.
    if ([kContact, kPunctured].includes(shown.columns.value(row, "phase"))) this.first_contact_s ??= this.t_s;
    if (goals.target) {
      this.distance = length(minus(tip, goals.target.at_m));
      this.closest = Math.min(this.closest ?? Infinity, this.distance);
      if (this.distance <= goals.target.radius_m) this.reached_s ??= this.t_s;
    }
    if (goals.line) {
      const from = minus(tip, goals.line.entry_m), along = dot(from, this.direction);
      this.off_line = length(from.map((value, k) => value - along * this.direction[k]));
      if (along >= 0) {
        this.entry ??= this.off_line;
        this.off_line_max = Math.max(this.off_line_max ?? 0, this.off_line);
      }
    }
    this.zones.forEach((zone, i) => {
      zone.now = zone_distance(goals.zones[i], tip);
      zone.least = Math.min(zone.least, zone.now);
    });
  }

  /// Returns [{goal, zone, value, limit, state, words}] in the report's order. `value`: as far as it is known. `state`: "met" (it stays so), "kept"
  /// (so far), "open" (not yet decided, or not yet attempted: nothing was touched) or "missed". `last_puncture_s`: time of the last puncture, or null.
  standing(last_puncture_s) {
    const { goals } = this, list = [];
    const mm = (m) => (Number.isFinite(m) ? `${(1000 * m).toFixed(1)} mm` : "unknown");
    const add = (goal, value, limit, state, words, zone = null) => list.push({ goal, zone, value, limit, state, words });
    const has_touched = this.first_contact_s !== null;
    const most = (value, limit) => (value === null || !has_touched ? "open" : value <= limit ? "kept" : "missed");
    if (goals.target) {
      const { radius_m } = goals.target;
      add("target", this.closest, radius_m, this.closest !== null && this.closest <= radius_m ? "met" : "open", `${mm(this.distance)} away, goal ${mm(radius_m)}`);
    }
    const { entry_radius_m, corridor_m } = goals.line ?? {};
    if (entry_radius_m !== undefined) {
      const state = this.entry === null || !has_touched ? "open" : this.entry <= entry_radius_m ? "met" : "missed";
      add("entry", this.entry, entry_radius_m, state, this.entry === null ? `line ${mm(this.off_line)} away, goal ${mm(entry_radius_m)}` : `entered ${mm(this.entry)} off, goal ${mm(entry_radius_m)}`);
    }
    if (corridor_m !== undefined)
      add("corridor", this.off_line_max, corridor_m, most(this.off_line_max, corridor_m), `${mm(this.off_line)} off, largest ${mm(this.off_line_max ?? NaN)} of ${mm(corridor_m)}`);
    if (goals.force_max_N !== undefined)
      add("force", this.force_max, goals.force_max_N, most(this.force_max, goals.force_max_N), `${Number.isFinite(this.force) ? this.force.toFixed(1) : "unknown"} N, largest ${(this.force_max ?? 0).toFixed(1)} of ${goals.force_max_N} N`);
    if (goals.time_max_s !== undefined) {
      const end_s = goals.target ? this.reached_s : last_puncture_s, took = this.first_contact_s === null || end_s === null ? null : Math.max(0, end_s - this.first_contact_s);
      const since = this.first_contact_s === null ? null : (goals.target && took !== null ? took : this.t_s - this.first_contact_s);
      const state = since === null ? "open" : goals.target ? (took !== null ? (took <= goals.time_max_s ? "met" : "missed") : since <= goals.time_max_s ? "open" : "missed") : most(took, goals.time_max_s);
      add("time", took, goals.time_max_s, state, since === null ? `not begun, at most ${goals.time_max_s} s` : `${since.toFixed(1)} s since contact, at most ${goals.time_max_s} s`);
    }
    if (goals.plunge_max_m !== undefined) add("plunge", null, goals.plunge_max_m, "open", `at most ${mm(goals.plunge_max_m)}, judged at the end`);
    this.zones.forEach(({ now, least }, i) => {
      const { name, margin_m = 0 } = goals.zones[i], is_known = Number.isFinite(least);
      const words = now < 0 ? `${mm(-now)} inside` : `${mm(now)} away`;
      add("zone", is_known ? least : null, margin_m, !is_known || !(has_touched || least < 0) ? "open" : least >= margin_m ? "kept" : "missed", `${words}, ${least < 0 ? `deepest ${mm(-least)}` : `closest ${mm(least)}`}, keep ${mm(margin_m)}`, name);
    });
    return list;
  }
}

/// The goals of a session report, in words like those of GoalMeter.
export function judged(report) {
  const text = (value, unit) => (value === null ? "no value" : unit === "m" ? `${(1000 * value).toFixed(2)} mm` : `${value.toFixed(2)} ${unit}`);
  return report.goals.map(({ goal, zone, value, limit, limit_is, unit, met, attempted = true }) =>
    ({ goal, zone, value, limit, state: met ? "met" : attempted ? "missed" : "untried", words: `${text(value, unit)}, ${limit_is === "least" ? "at least" : "at most"} ${text(limit, unit)}` }));
}

const kWords = { met: "✓ met", kept: "✓ kept", open: "… open", missed: "✗ missed", untried: "– not attempted" };

/// The panel. `app`: that of main.js.
export class Goals {
  constructor(app) {
    this.app = app;
    this.box = document.getElementById("goals");
    this.meters = new WeakMap();   // of each Shown
    this.reports = new Map();      // file of a report: its figures, null: not there yet or not usable
    this.shown = { list: [], verdict: "" };
  }

  meter_of(source) {
    if (!source?.bone?.goals) return null;
    if (!this.meters.has(source)) this.meters.set(source, { meter: new GoalMeter(source.bone.goals), next: 0 });
    return this.meters.get(source);
  }
  /// Takes the latest row of a session.
  take(source) { this.meter_of(source)?.meter.take(source, source.row); }

  /// Brings the meter of a recording to the row that is shown.
  follow(source) {
    const kept = this.meter_of(source);
    if (source.index + 1 < kept.next) Object.assign(kept, { meter: new GoalMeter(source.bone.goals), next: 0 });
    for (; kept.next <= source.index; ++kept.next) kept.meter.take(source, source.row_at(kept.next));
    return kept.meter;
  }

  /// Returns the figures of the report, if the session or the playback is at its end and they have come.
  report_at_end(is_playback) {
    const { app } = this, { playback } = app;
    const is_end = is_playback ? playback.time_s >= playback.end_s : app.state.state === "ended";
    const recording = app.folder?.recordings.find(({ file }) => file === playback.file);
    const file = is_playback ? recording?.report : app.state.report;
    if (!is_end || !file) return null;
    if (!this.reports.has(file)) {
      this.reports.set(file, null);
      get_text(file_query("/api/report", { file })).then((html) => {
        this.reports.set(file, JSON.parse(new DOMParser().parseFromString(html, "text/html").getElementById("report").textContent));
        app.changed();
      }).catch(() => {});  // no verdict; the panel says so
    }
    return this.reports.get(file);
  }

  draw(source, is_playback) {
    const goals = source?.row && source.bone?.goals;
    this.box.hidden = !goals;
    if (!goals) return (this.shown = { list: [], verdict: "" });
    const meter = is_playback ? this.follow(source) : this.meter_of(source).meter;
    const report = this.report_at_end(is_playback);
    const last = source.punctures().at(-1)?.t_s ?? null;
    const seen = meter.standing(last), list = report ? judged(report) : seen;
    const met = list.filter(({ state }) => state === "met").length, missed = list.filter(({ state }) => state === "missed");
    const untried = list.filter(({ state }) => state === "untried").length;
    const verdict = report ? `Verdict of the report: ${met} of ${list.length} goals met${untried ? `, ${untried} not attempted` : ""}${missed.length ? `; missed: ${missed.map(({ goal, zone }) => zone ?? goal).join(", ")}` : ""}.`
      : `Goals so far${meter.unseen_s > 0 ? ` (without ${meter.unseen_s.toFixed(0)} s that this page has not seen)` : ""}: ${missed.length ? `${missed.length} of ${list.length} missed` : "none missed"}.`;
    this.shown = { t_s: meter.t_s, list, seen, verdict, is_final: Boolean(report) };
    this.box.firstElementChild.textContent = verdict;
    const rows = this.box.lastElementChild;
    while (rows.children.length > list.length) rows.lastChild.remove();
    list.forEach(({ goal, zone, state, words }, i) => {
      const row = rows.children[i] ?? rows.appendChild(document.createElement("li"));
      if (!row.children.length) row.append(document.createElement("b"), document.createElement("span"), document.createElement("i"));
      row.dataset.state = state;
      [zone ?? goal, words, kWords[state]].forEach((text, k) => { if (row.children[k].textContent !== text) row.children[k].textContent = text; });
    });
  }
}
