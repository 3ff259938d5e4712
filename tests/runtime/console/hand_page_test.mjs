// SPDX-License-Identifier: Apache-2.0
// The hand's arithmetic (hand/motion.js) and what it feels (hand/feel.js), in node. TROCAR_PAGE is the folder of the page.
import assert from "node:assert/strict";
import test from "node:test";
import { pathToFileURL } from "node:url";

const page = pathToFileURL(`${process.env.TROCAR_PAGE}/`);
const { across, deflection, kFine, moved, pushed, rotation_vector, share_of, sum, wheel_m } = await import(new URL("hand/motion.js", page));
const { Feel } = await import(new URL("hand/feel.js", page));

const near = (a, b, what) => assert.ok(Math.hypot(...a.map((x, k) => x - b[k])) < 1e-12, `${what}: ${a} is not ${b}`);

test("a stick is dead at rest, continuous at the edge, finer near it, odd, and full at the end", () => {
  for (const rest of [0, 0.05, -0.119]) assert.equal(deflection(rest), 0);
  assert.ok(deflection(0.121) < 1e-5 && deflection(0.121) > 0);
  assert.ok(Math.abs(deflection(0.56) - 0.25) < 1e-12);
  assert.equal(deflection(-0.56), -deflection(0.56));
  assert.equal(deflection(1), 1);
  assert.equal(deflection(-1.02), -1);
});

test("a notch of the wheel is 0.4 mm however the browser counts it, and at most that", () => {
  assert.equal(wheel_m({ deltaX: 0, deltaY: 100, deltaMode: 0, shiftKey: false }), 0.0004);
  assert.equal(wheel_m({ deltaX: 0, deltaY: -400, deltaMode: 0, shiftKey: false }), -0.0004);
  assert.ok(Math.abs(wheel_m({ deltaX: 0, deltaY: 3, deltaMode: 1, shiftKey: false }) - 0.000396) < 1e-9);
  assert.ok(Math.abs(wheel_m({ deltaX: 0, deltaY: 4, deltaMode: 0, shiftKey: false }) - 0.000016) < 1e-12);  // a trackpad
  assert.equal(wheel_m({ deltaX: 100, deltaY: 0, deltaMode: 0, shiftKey: true }), 0.0004 * kFine);  // Shift swaps the axes
});

test("the directions across the tool are unit vectors, at right angles to it and to each other, right being the screen's", () => {
  const axes = [[0, 0, -1], [0.6, 0, -0.8], [0, 1, 0]], cameras = [[1, 0, 0], [0.88, 0.47, 0], [0, 0, 1], [0, 0, -1]];
  const dot = (a, b) => a.reduce((total, x, k) => total + x * b[k], 0);
  for (const axis of axes) for (const camera of cameras) {
    const { right, away } = across(axis, camera);
    for (const one of [right, away]) assert.ok(Math.abs(Math.hypot(...one) - 1) < 1e-12 && Math.abs(dot(one, axis)) < 1e-12);
    assert.ok(Math.abs(dot(right, away)) < 1e-12 && dot(right, camera) > -1e-12);
  }
  const upright = across([0, 0, -1], [1, 0, 0]);
  near(upright.right, [1, 0, 0], "right");
  near(upright.away, [0, 1, 0], "away");
});

test("Shift is a fifth; opposite keys cancel; along is down the tool", () => {
  const directions = { ...across([0, 0, -1], [1, 0, 0]), axis: [0, 0, -1] };
  near(pushed({ right: 0, away: 0, along: 1, is_fine: false }, "keys", directions, 0.5), [0, 0, -0.006], "F for half a second");
  near(pushed({ right: 1, away: -1, along: 0, is_fine: true }, "keys", directions, 1), [0.0024, -0.0024, 0], "arrows with Shift");
  near(pushed({ right: 0, away: 0, along: -1, is_fine: false }, "pad", directions, 1), [0, 0, 0.02], "the left trigger");
});

test("the target stays within the box, moves freely inside it, and without a box is not limited", () => {
  const box = { min_m: [-0.03, -0.03, 0.08], max_m: [0.03, 0.03, 0.17] };
  near(moved([0, 0, 0.1], [0.01, -0.01, 0.02], box), [0.01, -0.01, 0.12], "inside");
  near(moved([0, 0, 0.1], [1, -1, -1], box), [0.03, -0.03, 0.08], "at the corner");
  near(moved([0, 0, 0.1], [1, 0, 0], undefined), [1, 0, 0.1], "no box");
});

test("a rotation vector turns by the quaternion's angle, of the shorter way", () => {
  near(rotation_vector([1, 0, 0, 0]), [0, 0, 0], "none");
  near(rotation_vector([Math.cos(0.2), 0, Math.sin(0.2), 0]), [0, 0.4, 0], "0.4 about y");
  near(rotation_vector([-Math.cos(0.2), 0, -Math.sin(0.2), 0]), [0, 0.4, 0], "the same rotation");
});

test("the share of the force is between 0 and 1", () => {
  assert.deepEqual([-1, 0, 10, 40, 60].map((force) => share_of(force, 40)), [0, 0, 0.25, 1, 1]);
  near(sum([[2, [1, 0, 0]], [-1, [0, 1, 1]]]), [2, -1, -1], "sum");
});

// ---- what is felt ----
const at = (t_s, force_N, more = {}) => ({ t_s, force_N, cut_J: 0, break_throughs: 0, ...more });
const felt_of = (rows) => {
  const feel = new Feel();
  return rows.map((row) => feel.take(row, 40));
};
const names = (felt) => Object.keys(felt).filter((name) => felt[name] > 0).join(" ");

test("contact is felt once, and again only after the tool was free", () => {
  const felt = felt_of([at(0, 0), at(0.1, 0.5), at(0.2, 1.2), at(0.3, 0.8), at(0.4, 1.5), at(0.5, 0.1), at(0.6, 2)]);
  assert.deepEqual(felt.map(names), ["", "", "contact", "", "", "", "contact"]);
});

test("crunch follows the growth of the work of cutting, not its value, and is louder with more power", () => {
  const felt = felt_of([at(0, 0.9, { cut_J: 5 }), at(0.02, 0.9, { cut_J: 5 }), at(0.04, 0.9, { cut_J: 5.001 }), at(0.06, 0.9, { cut_J: 5.006 }), at(0.08, 0.9, { cut_J: 5.006 })]);
  assert.deepEqual(felt.map(names), ["", "", "crunch", "crunch", ""]);
  assert.ok(felt[3].crunch > felt[2].crunch && felt[3].crunch <= 1);
});

test("a break is the loop's event and nothing else", () => {
  assert.deepEqual(felt_of([at(0, 20), at(0.02, 5, { break_throughs: 1 }), at(0.04, 5, { break_throughs: 1 })]).map(names), ["contact", "breach", ""]);
  assert.deepEqual(felt_of([at(0, 20), at(0.02, 30, { punctures: 1 }), at(0.04, 5, { punctures: 2 })]).map(names), ["contact", "", ""]);
});

test("nothing is felt from before the needle was taken, nor when another session begins", () => {
  const feel = new Feel();
  feel.take(at(5, 30, { cut_J: 1, break_throughs: 3 }), 40);
  feel.reset();
  assert.equal(names(feel.take(at(6, 30, { cut_J: 2, break_throughs: 5 }), 40)), "");
  assert.equal(names(feel.take(at(0, 0, { cut_J: 0, break_throughs: 0 }), 40)), "");
  assert.equal(names(feel.take(at(0.02, 0, { cut_J: 0, break_throughs: 0 }), 40)), "");
});
