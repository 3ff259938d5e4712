// SPDX-License-Identifier: Apache-2.0
// Plays a recording with its scene, and a second one to compare with.
import { file_query, get_container } from "./api.js";
import { Shown, axis_of, is_material, read_bone } from "./data.js";

const kContact = 1, kRunning = 2;  // ContactPhase, SafetyState
const kMaxCurvePoints = 6000;

/// A Shown that has all its rows.
export class Recorded extends Shown {
  constructor({ json, doubles }) {
    super(json.columns, json.about);
    this.is_recording = true;
    this.rows = doubles(json.rows_at ?? [0, json.rows * json.columns.reduce((sum, { count }) => sum + count, 0)]);
    this.count = json.rows;
    this.all_events = json.events ?? [];
    this.is_cut = json.is_cut;
    this.largest_torque_Nm = 0;
    const at = this.columns.at.get("tau_Nm");
    for (let i = 0; at && i < this.count; ++i)
      for (let k = 0; k < at[1]; ++k) this.largest_torque_Nm = Math.max(this.largest_torque_Nm, Math.abs(this.row_at(i)[at[0] + k]));
    this.times = Float64Array.from({ length: this.count }, (_, i) => this.columns.value(this.row_at(i), "t_s"));
  }
  row_at(i) { return this.rows.subarray(i * this.columns.width, (i + 1) * this.columns.width); }
  get end_s() { return this.times[this.count - 1] ?? 0; }

  set_bone(bone) {
    this.bone = bone;
    this.history.clear();
    this.touched_at = new Map();
    this.find_punctures();
    const every = Math.max(1, Math.ceil(this.count / kMaxCurvePoints));
    for (let i = 0; i < this.count; ++i) {
      const row = this.row_at(i);
      const slice = this.columns.value(row, "active_slice", -1);
      if (this.columns.value(row, "phase") === kContact && !this.columns.has("front_z_m") && !this.touched_at.has(slice)) this.touched_at.set(slice, this.times[i]);
      if (i % every === 0 && this.is_placed(row)) this.history.push(this.times[i], this.force(row), this.depth_mm(row));
    }
  }
  /// Finds punctures in a recording of the force law `cutting`, which has the front instead of punctures. A slice is cut through when
  /// the front has passed the lower side of its slab, half-way to the next slice. It is touched when the front is in the slab.
  find_punctures() {
    const slices = this.bone?.slices ?? [];
    if (!this.columns.has("front_z_m") || !slices.length) return;
    this.all_events = this.all_events.filter(({ kind }) => kind !== "puncture");
    const half = (k) => 0.5 * Math.abs(k + 1 < slices.length ? slices[k].z_m - slices[k + 1].z_m : (slices[k - 1]?.z_m ?? Infinity) - slices[k].z_m);
    let next = 0, before = null;  // the front of the row before; null: no row had one so far
    for (let i = 0; i < this.count; ++i) {
      const row = this.row_at(i), front = this.columns.value(row, "front_z_m"), tip = this.columns.values(row, "tool_m");
      if (!this.is_placed(row)) continue;
      // In a running session 0 says that no uncut bone is below the tip. The row in which the front left the bone can be missing, because
      // the console does not send every row of a long recording. Then the slices above the tip through which it came are cut through.
      const is_through = front === 0 && Boolean(before) && this.columns.value(row, "safety", kRunning) === kRunning;
      for (let k = next; k < slices.length && (front !== 0 || is_through); ++k) {
        if (is_through ? tip[2] >= slices[k].z_m : front > slices[k].z_m - half(k) + 1e-7) break;
        const is_cut = is_material(slices[k], tip[0], tip[1]);
        if (is_cut || !is_through) next = k + 1;
        if (before === null || !is_cut) continue;
        // The forces are those before it, as a live session states them.
        const last = this.row_at(Math.max(0, i - 1)), tip_N = this.columns.value(last, "tip_N"), hand_N = this.force(last);
        const text = `slice ${slices[k].slice} punctured at ${this.times[i].toFixed(3)} s: ${tip_N.toFixed(2)} N at the tip, ${hand_N.toFixed(2)} N on the hand`;
        this.all_events.push({ kind: "puncture", t_s: this.times[i], slice: slices[k].slice, tool_z_m: tip[2], tip_N, hand_N, text });
      }
      if (front !== 0 || before !== null) before = front;
      if (front === 0) continue;
      const slice = slices[next];
      if (slice && !this.touched_at.has(slice.slice) && this.columns.value(row, "embedded_m", 0) > 0 && front <= slice.z_m + half(next) && is_material(slice, tip[0], tip[1]))
        this.touched_at.set(slice.slice, this.times[i]);
    }
    this.all_events.sort((a, b) => a.t_s - b.t_s);
  }
  /// Returns the index of the last row at or before t.
  index_at(t) {
    let low = 0, high = this.count - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.times[middle] <= t) low = middle;
      else high = middle - 1;
    }
    return low;
  }
  go_to(t) {
    this.index = this.index_at(t);
    this.row = this.row_at(this.index);
    const now = this.times[this.index];
    this.events = this.all_events.filter(({ t_s }) => t_s <= now);
    this.pierced = new Set(this.punctures().map(({ slice }) => slice));
  }
  /// Returns the values of a column. For touched and punctured slices they are computed from the events and the rows so far.
  values(name) {
    const slices = this.bone?.slices ?? [], now = this.row ? this.times[this.index] : 0;
    if (name === "sheet_touched") return slices.map(({ slice }) => Number(this.touched_at.get(slice) <= now || (this.pierced?.has(slice) ?? false)));
    if (name === "sheet_punctured") return slices.map(({ slice }) => Number(this.pierced?.has(slice) ?? false));
    if (name === "axis" && this.bone && this.row) return axis_of(this).map((x) => -x);  // down the shaft, as a snapshot has it
    return super.values(name);
  }
}

export class Playback {
  constructor() {
    this.first = null;
    this.time_s = 0;
    this.speed = 1;
    this.is_playing = false;
    // Requests are numbered. What arrives after a later request was shown is dropped.
    this.requests = this.opened = this.compared = 0;
  }

  /// Opens a recording. Returns false if another one, which was asked for later, is open already.
  async open(recording, scene) {
    const request = ++this.requests;
    const [rows, bone] = await Promise.all([
      get_container(file_query("/api/recording", { file: recording, scene })),
      scene ? get_container(file_query("/api/bone", { scene })).then(read_bone) : null]);
    if (request < this.opened) return false;
    this.opened = request;
    this.first = new Recorded(rows);
    this.first.set_bone(bone);
    this.file = recording;
    this.scene = scene;
    this.is_playing = false;
    this.go_to(0);
    return true;
  }

  /// Shows a second recording beside the first, or none. Returns false like open().
  async compare(recording, scene) {
    const request = ++this.requests;
    if (!recording) {
      this.compared = request;
      this.first.second = null;
    } else {
      const second = new Recorded(await get_container(file_query("/api/recording", { file: recording, scene })));
      if (request < Math.max(this.opened, this.compared)) return false;
      this.compared = request;
      second.set_bone(this.first.bone);
      this.first.second = second;
      this.second_file = recording;
    }
    this.go_to(this.time_s);
    return true;
  }

  get end_s() { return Math.max(this.first?.end_s ?? 0, this.first?.second?.end_s ?? 0); }
  get marks() {
    const { first } = this;
    const positions = [];
    for (const event of first?.punctures() ?? []) {
      const slice = first.bone?.slices.find((candidate) => candidate.slice === event.slice);
      if (!slice) continue;
      const tip = first.columns.values(first.row_at(first.index_at(event.t_s)), "tool_m");
      positions.push({ x: tip[0], y: tip[1], z: slice.z_m });
    }
    return positions;
  }

  go_to(t) {
    this.time_s = Math.min(Math.max(0, t), this.end_s);
    this.first?.go_to(this.time_s);
    this.first?.second?.go_to(this.time_s);
  }

  /// Advances by `passed_s` of wall-clock time. Returns true if the row has changed.
  advance(passed_s) {
    if (!this.is_playing || !this.first) return false;
    this.go_to(this.time_s + passed_s * this.speed);
    if (this.time_s >= this.end_s) this.is_playing = false;
    return true;
  }
}
