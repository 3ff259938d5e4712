// SPDX-License-Identifier: Apache-2.0
// What a session or a recording consists of for the panels: rows by column name, the history of force, and the bone.

/// Where each column is in a row; a column that is not there gives `otherwise`.
export class Columns {
  constructor(list) {
    this.at = new Map();
    this.width = 0;
    for (const { name, count } of list) {
      this.at.set(name, [this.width, count]);
      this.width += count;
    }
  }
  has(name) { return this.at.has(name); }
  value(row, name, otherwise = NaN) {
    const place = this.at.get(name);
    return place ? row[place[0]] : otherwise;
  }
  /// null: no such column.
  values(row, name) {
    const place = this.at.get(name);
    return place ? row.subarray(place[0], place[0] + place[1]) : null;
  }
}

/// Force over time and depth. Of more than 4000 points, each pair is replaced by the one with the larger force, so peaks stay.
export class History {
  constructor() { this.clear(); }
  clear() {
    this.t = [];
    this.force = [];
    this.depth = [];
    this.every = 1;
    this.pending = 0;
    this.best = null;
  }
  add(t, force, depth) {
    const last = this.t[this.t.length - 1];
    if (t <= last) return;
    if (!this.best || force > this.best[1]) this.best = [t, force, depth];
    if (++this.pending < this.every) return;
    this.push(...this.best);
    this.pending = 0;
    this.best = null;
    if (this.t.length > 4000) this.thin();
  }
  /// The curve is interrupted: the page was hidden.
  gap() {
    if (this.t.length && this.force[this.force.length - 1] !== null) this.push(this.t[this.t.length - 1] + 1e-9, null, null);
  }
  push(t, force, depth) {
    this.t.push(t);
    this.force.push(force);
    this.depth.push(depth);
  }
  thin() {
    const kept = [];
    for (let i = 0; i + 1 < this.t.length; i += 2) kept.push(this.force[i] > this.force[i + 1] ? i : i + 1);
    for (const name of ["t", "force", "depth"]) this[name] = kept.map((i) => this[name][i]);
    this.every *= 2;
  }
}

/// The bone of /api/bone as typed arrays.
export function read_bone({ json, floats, uints }) {
  const mesh = (part) => ({ places: floats(part.vertices), triangles: uints(part.triangles), hu: part.hu ? floats(part.hu) : null });
  const slices = json.slices.map((slice) => ({ slice: slice.slice, z_m: slice.z_m, cuts: 0, ...mesh(slice) }));
  return { surface: json.surface ? mesh(json.surface) : null, slices, tool: json.tool, goals: json.goals,
    top_m: Math.max(...slices.map(({ z_m }) => z_m)) };
}

/// The triangle of a slice at x, y and the shares of its corners; null outside its material.
function triangle_at({ places, triangles }, x, y) {
  for (let k = 0; k < triangles.length; k += 3) {
    const a = triangles[k], b = triangles[k + 1], c = triangles[k + 2];
    const bx = places[2 * b] - places[2 * a], by = places[2 * b + 1] - places[2 * a + 1];
    const cx = places[2 * c] - places[2 * a], cy = places[2 * c + 1] - places[2 * a + 1];
    const px = x - places[2 * a], py = y - places[2 * a + 1];
    const area = bx * cy - by * cx;
    const v = (px * cy - py * cx) / area, w = (bx * py - by * px) / area;
    if (v >= 0 && w >= 0 && v + w <= 1) return { a, b, c, v, w };
  }
  return null;
}

export const is_material = (slice, x, y) => triangle_at(slice, x, y) !== null;

/// HU of a slice at x, y; null outside its material, or without HU.
export function hu_at(slice, x, y) {
  const { hu } = slice, at = hu && triangle_at(slice, x, y);
  return at ? hu[at.a] + at.v * (hu[at.b] - hu[at.a]) + at.w * (hu[at.c] - hu[at.a]) : null;
}

/// Everything that the panels show of one session or recording.
export class Shown {
  constructor(columns, about) {
    this.columns = new Columns(columns);
    this.about = about ?? {};
    this.row = null;
    this.bone = null;
    this.history = new History();
    this.events = [];
    this.missed = 0;
    this.second = null;  ///< another Shown to compare with
  }
  value(name, otherwise) { return this.row ? this.columns.value(this.row, name, otherwise) : otherwise ?? NaN; }
  values(name) { return this.row ? this.columns.values(this.row, name) : null; }
  /// On the hand: what the torques give.
  force(row = this.row) {
    const wrench = row && this.columns.values(row, "wrench_delivered");
    return wrench ? Math.hypot(wrench[0], wrench[1], wrench[2]) : NaN;
  }
  /// Has the device been read? Before that the row's places mean nothing.
  is_placed(row = this.row) { return this.columns.value(row, "safety", 1) !== 0; }
  /// Of the tip below the first slice; negative above it.
  depth_mm(row = this.row) {
    const tool = row && this.columns.values(row, "tool_m");
    const top = this.bone?.top_m ?? this.about.sheets?.[0]?.z_m;
    return tool && top !== undefined ? 1000 * (top - tool[2]) : NaN;
  }
  take(row) {
    this.row = row;
    if (!this.is_placed(row)) return;
    this.history.add(this.value("t_s"), this.force(), this.depth_mm());
  }
  punctures() { return this.events.filter(({ kind }) => kind === "puncture"); }
}
