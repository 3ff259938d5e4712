// SPDX-License-Identifier: Apache-2.0
// The data of a session or a recording that the panels show: rows by column name, the history of the force, and the bone.

/// The position of each column in a row. A missing column has the value `otherwise`.
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
    const at = this.at.get(name);
    return at ? row[at[0]] : otherwise;
  }
  /// Returns the values of a column; null if there is no such column.
  values(row, name) {
    const at = this.at.get(name);
    return at ? row.subarray(at[0], at[0] + at[1]) : null;
  }
}

/// Force over time and depth. If there are more than 4000 points, each pair is replaced by its point with the larger force, so that
/// peaks stay.
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
  /// Interrupts the curve. Called because the page was hidden.
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

/// Returns the bone of /api/bone as typed arrays.
export function read_bone({ json, floats, uints }) {
  const mesh = (part) => ({ positions: floats(part.vertices), triangles: uints(part.triangles), hu: part.hu ? floats(part.hu) : null });
  const slices = json.slices.map((slice) => ({ slice: slice.slice, z_m: slice.z_m, cuts: 0, ...mesh(slice) }));
  return { surface: json.surface ? mesh(json.surface) : null, slices, tool: json.tool, goals: json.goals, lps_mm_of_device: json.lps_mm_of_device,
    top_m: Math.max(...slices.map(({ z_m }) => z_m)) };
}

/// Returns the triangle of a slice at x, y with the weights of its second and third corner; null outside its material.
function triangle_at({ positions, triangles }, x, y) {
  for (let k = 0; k < triangles.length; k += 3) {
    const a = triangles[k], b = triangles[k + 1], c = triangles[k + 2];
    const bx = positions[2 * b] - positions[2 * a], by = positions[2 * b + 1] - positions[2 * a + 1];
    const cx = positions[2 * c] - positions[2 * a], cy = positions[2 * c + 1] - positions[2 * a + 1];
    const px = x - positions[2 * a], py = y - positions[2 * a + 1];
    const area = bx * cy - by * cx;
    const v = (px * cy - py * cx) / area, w = (bx * py - by * px) / area;
    if (v >= 0 && w >= 0 && v + w <= 1) return { a, b, c, v, w };
  }
  return null;
}

export const is_material = (slice, x, y) => triangle_at(slice, x, y) !== null;

/// Returns the HU of a slice at x, y; null outside its material or if there is no HU.
export function hu_at(slice, x, y) {
  const { hu } = slice, at = hu && triangle_at(slice, x, y);
  return at ? hu[at.a] + at.v * (hu[at.b] - hu[at.a]) + at.w * (hu[at.c] - hu[at.a]) : null;
}

/// Returns the unit vector up the tool's shaft in {B}: the axis in the plate's frame, turned by the plate's quaternion.
export function axis_of(source) {
  const [w, x, y, z] = source.values("q"), [a, b, c] = source.bone.tool.axis_in_plate;
  const t = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * t[0] + y * t[2] - z * t[1], b + w * t[1] + z * t[0] - x * t[2], c + w * t[2] + x * t[1] - y * t[0]];
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
  /// Returns the force on the hand that the torques produce.
  force(row = this.row) {
    const wrench = row && this.columns.values(row, "wrench_delivered");
    return wrench ? Math.hypot(wrench[0], wrench[1], wrench[2]) : NaN;
  }
  /// Returns true if the device has been read. Before that the positions in the row mean nothing.
  is_placed(row = this.row) { return this.columns.value(row, "safety", 1) !== 0; }
  /// Returns the depth of the tip below the first slice; negative above it.
  depth_mm(row = this.row) {
    const tool = row && this.columns.values(row, "tool_m");
    return tool ? this.depth_of(tool[2]) : NaN;
  }
  depth_of(z_m) {
    const top = this.bone?.top_m ?? this.about.sheets?.[0]?.z_m;
    return top !== undefined ? 1000 * (top - z_m) : NaN;
  }
  /// Takes the force since the session began, as the console has kept it: t_s, force, height of the tip of each point.
  take_history(points) {
    this.history.clear();
    for (let i = 0; i + 2 < points.length; i += 3) this.history.push(points[i], points[i + 1], this.depth_of(points[i + 2]));
  }
  take(row) {
    this.row = row;
    if (!this.is_placed(row)) return;
    this.history.add(this.value("t_s"), this.force(), this.depth_mm());
  }
  punctures() { return this.events.filter(({ kind }) => kind === "puncture"); }
  break_throughs() { return this.events.filter(({ kind }) => kind === "break_through"); }
}
