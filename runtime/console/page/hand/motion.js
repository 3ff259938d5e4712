// SPDX-License-Identifier: Apache-2.0
// How far a key, the wheel or a stick moves the target of the hand. Positions are in {B}, in metres, as arrays of three numbers. This
// file uses neither the browser nor three.js.

const kKeys_m_per_s = 0.012, kPad_m_per_s = 0.02, kNotch_m = 0.0004, kNotch_px = 100, kLine_px = 33;
const kDeadZone = 0.12;
export const kFine = 0.2;  // factor of every motion while Shift (or a shoulder button) is held

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/// Returns the sum of the vectors, each times its factor: [[factor, vector], ...].
export const sum = (terms) => [0, 1, 2].map((k) => terms.reduce((total, [factor, vector]) => total + factor * vector[k], 0));

/// Returns the unit vectors "right" and "away" across the tool, as the operator sees them. `axis` points down the tool to its tip;
/// `camera_right` is the direction to the right on the screen. A camera that looks sideways along the plane still has both.
export function across(axis, camera_right) {
  const up = sum([[-1, axis]]);
  let right = sum([[1, camera_right], [-dot(camera_right, up), up]]);
  if (Math.hypot(...right) < 0.1) right = sum([[1, [1, 0, 0]], [-up[0], up]]);
  right = sum([[1 / Math.hypot(...right), right]]);
  return { right, away: cross(up, right) };
}

/// Returns the deflection of a stick or trigger, -1 to 1, squared, so that small deflections move the needle finely. Within the dead
/// zone it is 0, because a stick at rest does not report exactly 0.
export function deflection(value) {
  const beyond = Math.min(1, (Math.abs(value) - kDeadZone) / (1 - kDeadZone));
  return beyond > 0 ? Math.sign(value) * beyond * beyond : 0;
}

/// Returns how far a turn of the wheel moves the needle along the tool, m; down is forward. Trackpads report many small turns, and some
/// browsers swap the axes while Shift is held.
export function wheel_m({ deltaX, deltaY, deltaMode, shiftKey }) {
  const turned = (deltaY || deltaX) * (deltaMode === 1 ? kLine_px : deltaMode === 2 ? kNotch_px : 1);
  return Math.max(-1, Math.min(1, turned / kNotch_px)) * kNotch_m * (shiftKey ? kFine : 1);
}

/// Returns the motion of the target in `passed_s` seconds. `push` is {right, away, along}, each -1 to 1; `from` is "keys" or "pad".
export function pushed({ right, away, along, is_fine }, from, directions, passed_s) {
  const m = (from === "pad" ? kPad_m_per_s : kKeys_m_per_s) * passed_s * (is_fine ? kFine : 1);
  return sum([[m * right, directions.right], [m * away, directions.away], [m * along, directions.axis]]);
}

/// Returns the rotation vector, rad, of the unit quaternion w, x, y, z.
export function rotation_vector([w, x, y, z]) {
  const sine = Math.hypot(x, y, z);
  if (sine < 1e-12) return [0, 0, 0];
  const angle = 2 * Math.atan2(sine, Math.abs(w)) * Math.sign(w || 1);
  return [x, y, z].map((part) => part / sine * angle);
}

/// Returns `position` moved by `by` and kept within the box {min_m, max_m}; without a box it is not limited.
export function moved(position, by, box) {
  return position.map((from, k) => {
    const to = from + by[k];
    return box ? Math.max(box.min_m[k], Math.min(box.max_m[k], to)) : to;
  });
}

/// Returns how far the force is on the way to the largest force of the scale: 0 to 1.
export const share_of = (force_N, scale_N) => Math.max(0, Math.min(1, force_N / scale_N));
