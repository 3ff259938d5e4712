// SPDX-License-Identifier: Apache-2.0
// Torques against their limits, joint and workspace limits, pose, slices and events. Texts are set by textContent only.
import { element } from "./elements.js";
import { is_by_operator } from "./words.js";

const kAxes = ["x", "y", "z"], kDegrees = 180 / Math.PI;
const kTickParts = ["waking", "device", "law", "publishing"];  // parts of a tick that make it late, in the order of the column missed_by
const kShownEvents = 100;

/// Like toFixed(), but without a minus before zero.
const fixed = (value, digits) => value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1");

/// Returns the angle to the nearest joint limit, in rad. For a recording it is computed from the angles (four for each leg), if the
/// limits are known.
function joint_margin(shown) {
  const angles = shown.values("motor_angle_rad"), limits = shown.about.joint_limits_rad;
  if (shown.columns.has("joint_margin") || !angles || !(limits?.length >= 4)) return shown.value("joint_margin");
  return Math.min(...Array.from(angles, (angle, k) => Math.min(angle - limits[k % 4][0], limits[k % 4][1] - angle)));
}

/// False if the facts of a session, or the columns of a recording, say that the device has no motors of its own. True: not known.
const has_motors = ({ is_recording, columns, about }) => (is_recording ? columns.has("tau_Nm") : about.motor_peak_torque_Nm !== null);
/// The same for limits of joints.
const has_joints = ({ is_recording, columns, about }) => (is_recording ? columns.has("motor_angle_rad") : about.joint_limits_rad?.length !== 0);

class Row {
  constructor(box, name, kind) {
    this.gauge = element("span", `gauge ${kind}`);
    this.bar = element("i");
    this.gauge.append(this.bar);
    this.value = element("span", "value", "–");
    this.limit = element("span", "limit");
    this.parts = [element("span", "name", name), this.gauge, this.value, this.limit];
    box.append(...this.parts);
  }
  hide(is_hidden) {
    for (const part of this.parts) part.hidden = is_hidden;
  }
  text(value, limit = "") {
    if (this.value.textContent !== value) this.value.textContent = value;
    if (this.limit.textContent !== limit) this.limit.textContent = limit;
  }
  /// Fills the bar from the left end; 1 is full.
  fill(fraction) {
    this.bar.style.transform = `scaleX(${Math.min(1, Math.max(0, fraction || 0))})`;
    this.gauge.classList.toggle("near", fraction > 0.9);
  }
  /// Fills the bar from the middle to the left (-1) or right (1) end.
  swing(fraction) {
    const safe = Math.min(1, Math.max(-1, fraction || 0));
    this.bar.style.transform = `translateX(50%) scaleX(${safe / 2})`;
    this.gauge.classList.toggle("near", Math.abs(safe) > 0.9);
  }
  /// Shows a mark between the left (0) and the right end (1).
  point(fraction) {
    this.bar.style.left = `${100 * Math.min(1, Math.max(0, fraction || 0))}%`;
    this.gauge.classList.toggle("near", fraction < 0.05 || fraction > 0.95);
  }
}

export class Gauges {
  constructor() {
    this.torques_panel = document.getElementById("torques");
    const torques = document.querySelector("#torques .rows"), limits = document.querySelector("#limits .rows");
    this.torques = [];
    for (let leg = 1; leg <= 4; ++leg) for (const joint of [1, 4]) this.torques.push(new Row(torques, `Leg ${leg} θ${joint}`, "centred"));
    this.joint = new Row(limits, "Joint limit", "");
    this.plate = kAxes.map((axis) => new Row(limits, `Plate ${axis}`, "point"));
    this.tilt = new Row(limits, "Plate tilt", "");
    this.heat = new Row(limits, "Motor heat", "");
    limits.append(element("span", "name", "Tip x, y, z"), (this.tip = element("span", "value wide", "–")));
    limits.append(element("span", "name", "Missed ticks"), (this.missed = element("span", "value wide", "–")));
    limits.append(element("span", "name", "Missed by"), (this.cause = element("span", "value wide", "–")));
    this.events_box = document.getElementById("events");
    const counts = document.getElementById("slice-counts");
    this.cells = document.getElementById("slice-cells");
    this.count_texts = ["", "touched", "punctured"].map((key) => {
      const text = element("span");
      counts.append(element("span", `key ${key}`), text);
      return text;
    });
  }

  update(shown) {
    this.torques_panel.hidden = !has_motors(shown);
    this.heat.hide(!has_motors(shown));
    this.joint.hide(!has_joints(shown));
    const torques = shown.values("tau_Nm"), now = shown.values("tau_limit_Nm");
    const peak = shown.about.motor_peak_torque_Nm;
    for (const [k, row] of this.torques.entries()) {
      const torque = torques?.[k], limit = now?.[k] ?? peak;
      row.text(torque === undefined ? "–" : fixed(torque, 2), limit ? `of ${limit.toFixed(1)}` : "");
      row.swing((torque ?? 0) / (limit || shown.largest_torque_Nm || 1));
    }
    this.update_limits(shown);
    this.update_slices(shown);
    this.update_events(shown);
  }

  update_limits(shown) {
    const { about } = shown, margin = joint_margin(shown) * kDegrees;
    this.joint.text(Number.isNaN(margin) ? "–" : `${margin.toFixed(1)}°`, Number.isNaN(margin) ? "" : "away");
    this.joint.fill(1 - margin / 45);
    const plate = shown.values("p_m"), box = about.workspace;
    for (const [k, row] of this.plate.entries()) {
      if (!plate) {
        row.text("–");
        continue;
      }
      const low = box?.min_m?.[k], high = box?.max_m?.[k], mm = fixed(1000 * plate[k], 1);
      const has_box = Number.isFinite(low) && Number.isFinite(high);
      row.text(`${mm} mm`, has_box ? `${(1000 * low).toFixed(0)} to ${(1000 * high).toFixed(0)}` : "");
      row.point(has_box ? (plate[k] - low) / (high - low) : 0.5);
    }
    const q = shown.values("q");
    if (q) {
      const tilt = kDegrees * Math.acos(Math.min(1, Math.max(-1, 1 - 2 * (q[1] * q[1] + q[2] * q[2])))), max = box?.tilt_max_rad ? box.tilt_max_rad * kDegrees : NaN;
      this.tilt.text(`${tilt.toFixed(1)}°`, Number.isNaN(max) ? "" : `of ${max.toFixed(0)}°`);
      this.tilt.fill(tilt / (max || 45));
    } else this.tilt.text("–");
    const heat = shown.value("motor_heat_max");
    this.heat.text(Number.isNaN(heat) ? "–" : `${(100 * heat).toFixed(0)} %`, "of its limit");
    this.heat.fill(heat);
    const tip = shown.values("tool_m");
    this.tip.textContent = tip ? `${Array.from(tip, (v) => fixed(1000 * v, 1)).join(", ")} mm` : "–";
    const missed = shown.value("missed_deadlines"), late = shown.value("late_max_us");
    this.missed.textContent = Number.isNaN(missed) ? "–" : `${missed}${late > 0 ? `, latest ${late < 1000 ? `${late.toFixed(0)} µs` : `${(late / 1000).toFixed(1)} ms`}` : ""}`;
    // The line is short, so it has the commonest cause; the others are in the tooltip.
    const by = Array.from(shown.values("missed_by") ?? []), most = by.indexOf(Math.max(...by));
    this.cause.textContent = by[most] > 0 ? `${kTickParts[most]}, ${by[most]} times` : "–";
    this.cause.title = by.map((count, part) => `${kTickParts[part]} ${count}`).join(", ");
  }

  update_slices(shown) {
    const loaded = shown.bone?.slices.length ?? shown.about.sheets?.length ?? 0;
    if (this.cells.childElementCount !== loaded) this.cells.replaceChildren(...Array.from({ length: loaded }, () => element("i")));
    const touched = shown.values("sheet_touched"), punctured = shown.values("sheet_punctured"), active = shown.value("active_slice", -1);
    let touches = 0, punctures = 0;
    for (let k = 0; k < loaded; ++k) {
      const is_punctured = punctured?.[k] > 0, is_touched = touched?.[k] > 0 || is_punctured;
      touches += is_touched;
      punctures += is_punctured;
      const slice = shown.bone?.slices[k]?.slice;
      const name = [is_punctured ? "punctured" : is_touched ? "touched" : "", slice === active ? "active" : ""].join(" ").trim();
      if (this.cells.children[k].className !== name) this.cells.children[k].className = name;
    }
    for (const [k, words] of [`${loaded} loaded`, `${touches} touched`, `${punctures} punctured`].entries()) this.count_texts[k].textContent = words;
    this.totals = { loaded, touched: touches, punctured: punctures };
  }

  update_events(shown) {
    const { events, missed } = shown, key = `${events.length} ${missed} ${events[0]?.text} ${events.at(-1)?.text}`;
    if (shown === this.events_of && key === this.events_key) return;
    Object.assign(this, { events_of: shown, events_key: key });
    // A pause has an event of its own, "paused".
    const last = events.filter(({ kind, fault }) => kind !== "cut_shown" && !(kind === "fault" && fault === "paused")).slice(-kShownEvents).reverse();
    const lines = last.map((event) => element("li", is_by_operator(event) ? "stopped" : event.kind, event.text ?? `${event.kind} at ${event.t_s} s`));
    if (missed) lines.push(element("li", "", `${missed} earlier events are no longer known`));
    this.events_box.replaceChildren(...lines);
  }
}
