// SPDX-License-Identifier: Apache-2.0
// Planes of the CT through the tip: axial, coronal, sagittal, and one along the needle, with window and level, and the needle drawn in them.
import { by_id } from "../elements.js";
import { NumberField } from "../numbers.js";
import { cross, dot, hu_at } from "./volume.js";

const kSize = 176, kNeedle_m = 0.12, kRedraw_ms = 100;
const kInPlane_m = 0.0015;  // what is farther from a plane is drawn as a projection
const minus = (v) => v.map((x) => -x);
const unit = (v) => v.map((x) => x / Math.hypot(...v));

/// Grey level of a HU, as DICOM defines it for a linear window (PS3.3, C.11.2.1.2.1).
export function grey_of(hu, level, width) {
  if (hu <= level - 0.5 - (width - 1) / 2) return 0;
  if (hu > level - 0.5 + (width - 1) / 2) return 255;
  return Math.round(((hu - (level - 0.5)) / (width - 1) + 0.5) * 255);
}

/// The directions to the right and upwards of the planes, as radiologists look at them: the patient's right is on the left.
/// `axis`: up the needle's shaft.
export function plane_axes({ left, back, head }, axis) {
  const aside = cross(axis, left), across = Math.hypot(...aside) > 0.2 ? cross(aside, axis) : cross(cross(axis, back), axis);
  return { axial: [left, minus(back)], coronal: [left, head], sagittal: [back, head], needle: [unit(across), axis] };
}

/// Fills a square picture of HU around a position: `out` has size * size values, NaN where nothing is stored.
export function sample_plane(volume, middle, [right, up], width_m, size, out) {
  const step = width_m / size;
  for (let row = 0; row < size; ++row) {
    const y = (size / 2 - row - 0.5) * step;
    for (let column = 0; column < size; ++column) {
      const x = (column + 0.5 - size / 2) * step;
      out[row * size + column] = hu_at(volume, [0, 1, 2].map((k) => middle[k] + x * right[k] + y * up[k]));
    }
  }
  return out;
}

/// How much of the needle, from its tip on, lies in a plane through the tip: within kInPlane_m of it. `right` and `up` span the plane.
export function in_plane_m(axis, [right, up]) {
  const away = Math.abs(dot(axis, cross(right, up)));
  return away * kNeedle_m <= kInPlane_m ? kNeedle_m : kInPlane_m / away;
}

/// Angles of the needle's way in: cranio-caudal to the head, medio-lateral to the patient's left, in degrees.
export function angles_of({ left, back, head }, axis) {
  const way = minus(axis), degrees = 180 / Math.PI;
  return { cranial_deg: Math.asin(Math.max(-1, Math.min(1, dot(way, head)))) * degrees,
    lateral_deg: Math.atan2(dot(way, left), Math.abs(dot(way, back))) * degrees };
}

export class CtPlanes {
  /// `act`: {needle(): {tip, axis, radius_m} or null, pick(position), error(words)}; a click on a plane picks its position in {B}.
  constructor(act) {
    this.act = act;
    this.planes = ["axial", "coronal", "sagittal", "needle"].map((name) => {
      const canvas = by_id(`ct-${name}`);
      canvas.width = canvas.height = kSize;
      canvas.addEventListener("click", (event) => this.#pick(name, canvas, event));
      return { name, canvas, context: canvas.getContext("2d"), image: new ImageData(kSize, kSize) };
    });
    this.hu = new Float32Array(kSize * kSize);
    this.next = 0;
    const changed = () => this.#redraw();
    this.level = new NumberField("ct-level", { changed, refused: act.error });
    this.window = new NumberField("ct-window", { changed, refused: act.error });
    by_id("ct-width").addEventListener("change", changed);
    by_id("ct-preset").addEventListener("change", ({ target }) => {
      const [level, width] = target.value.split(" ").map(Number);
      if (!(width > 0)) return;
      this.level.value = level;
      this.window.value = width;
      this.#redraw();
    });
  }

  set_volume(volume) {
    this.volume = volume?.bone ? volume : null;
    for (const { context } of this.planes) context.clearRect(0, 0, kSize, kSize);
    this.#redraw();
  }

  #pick(name, canvas, event) {
    const plane = this.planes.find((each) => each.name === name);
    if (!this.volume || !plane.shows || event.detail > 1) return;  // the second click of a double click does nothing
    const { tip, axes: [right, up] } = plane.shows;
    // The square picture is in the middle of its box.
    const { left, top, width, height } = canvas.getBoundingClientRect(), side = Math.min(width, height), m = Number(by_id("ct-width").value) / 1000;
    const x = m * (event.clientX - left - width / 2) / side, y = m * (top + height / 2 - event.clientY) / side;
    if (Math.max(Math.abs(x), Math.abs(y)) <= m / 2) this.act.pick(tip.map((at, k) => at + x * right[k] + y * up[k]));
  }

  /// The needle through whose tip the planes are; without one the middle of the bone.
  #shown() { return this.act.needle() ?? { tip: this.volume.middle_m, axis: this.volume.patient.head, is_absent: true }; }

  #redraw() {
    this.keys = {};
  }

  /// Draws one of the planes, if the needle has moved since it was drawn.
  frame(now) {
    if (!this.volume || by_id("ct-box").hidden || now - (this.drawn_at ?? 0) < kRedraw_ms / this.planes.length) return;
    const needle = this.#shown();
    const key = [...needle.tip, ...needle.axis].map((x) => x.toFixed(4)).join();
    const plane = this.planes[this.next++ % this.planes.length];
    if (this.keys[plane.name] === key) return;
    this.keys[plane.name] = key;
    this.drawn_at = now;
    this.#draw(plane, needle);
  }

  #draw(plane, needle) {
    const { context, image } = plane;
    const axes = plane_axes(this.volume.patient, needle.axis)[plane.name], width_m = Number(by_id("ct-width").value) / 1000;
    plane.shows = { tip: needle.tip, axes };
    sample_plane(this.volume, needle.tip, axes, width_m, kSize, this.hu);
    const level = this.level.value ?? 0, width = this.window.value ?? 1;
    const words = new Uint32Array(image.data.buffer);
    this.hu.forEach((hu, i) => { words[i] = Number.isNaN(hu) ? 0xff281c14 : 0xff000000 | grey_of(hu, level, width) * 0x010101; });
    context.putImageData(image, 0, 0);
    if (needle.is_absent) return;
    // Solid where the needle lies in the plane, at its width; dashed where only its projection does.
    const scale = kSize / width_m, at = (m) => [0.5 * kSize + m * scale * dot(needle.axis, axes[0]), 0.5 * kSize - m * scale * dot(needle.axis, axes[1])];
    const solid_m = in_plane_m(needle.axis, axes);
    context.strokeStyle = "#ff8a4c";
    for (const [from_m, to_m, width, dashes] of [[0, solid_m, Math.max(1.5, 2 * needle.radius_m * scale), []], [solid_m, kNeedle_m, 1.5, [4, 4]]]) {
      if (from_m === to_m) continue;
      context.lineWidth = width;
      context.setLineDash(dashes);
      context.beginPath();
      context.moveTo(...at(from_m));
      context.lineTo(...at(to_m));
      context.stroke();
    }
    context.setLineDash([]);
    context.lineWidth = 1.5;
    context.strokeStyle = "#56b4e9";
    context.beginPath();
    context.arc(kSize / 2, kSize / 2, 4, 0, 2 * Math.PI);
    context.stroke();
  }

  /// Draws the words below the planes. `target_mm`: distance of the tip from the scene's target; NaN: it has none. `depth_mm`: below the first slice.
  draw({ depth_mm, target_mm, why }) {
    const needle = this.act.needle();
    if (why || !this.volume || !needle) return void (by_id("ct-words").textContent = why || "");
    const { cranial_deg, lateral_deg } = angles_of(this.volume.patient, needle.axis), hu = hu_at(this.volume, needle.tip);
    const tilt = `${Math.abs(cranial_deg).toFixed(0)}° to the ${cranial_deg >= 0 ? "head" : "feet"}, ${Math.abs(lateral_deg).toFixed(0)}° to the patient's ${lateral_deg >= 0 ? "left" : "right"}`;
    const parts = [`${Number.isNaN(hu) ? "no HU stored" : `${Math.round(hu)} HU`} at the tip`, `needle points ${tilt}`];
    if (Number.isFinite(depth_mm)) parts.push(`${Math.abs(depth_mm).toFixed(1)} mm ${depth_mm >= 0 ? "below" : "above"} the first slice`);
    if (this.planes.some(({ shows }) => shows && in_plane_m(needle.axis, shows.axes) < kNeedle_m)) parts.push(`dashed: more than ${1000 * kInPlane_m} mm from the plane`);
    if (Number.isFinite(target_mm)) parts.push(`${target_mm.toFixed(1)} mm from the target`);
    by_id("ct-words").textContent = parts.join("; ");
  }
}
