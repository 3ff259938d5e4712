// SPDX-License-Identifier: Apache-2.0
// Which X-ray picture is computed next and which are kept (imaging/xray_pictures.js), what the page says after a pause (words.js), and when
// Restart starts (restart.js), in node. TROCAR_PAGE is the folder of the page.
import assert from "node:assert/strict";
import test from "node:test";
import { pathToFileURL } from "node:url";

// api.js looks for a token in the address.
for (const [name, value] of Object.entries({ location: { hash: "" }, sessionStorage: { getItem: () => null }, addEventListener: () => {} }))
  Object.defineProperty(globalThis, name, { value, configurable: true });
const page = pathToFileURL(`${process.env.TROCAR_PAGE}/`);
const { XrayPictures } = await import(new URL("imaging/xray_pictures.js", page));
const { describe } = await import(new URL("words.js", page));
const { Restart } = await import(new URL("restart.js", page));
const { number_fault, read_number, read_point } = await import(new URL("numbers.js", page));
const { Notices } = await import(new URL("notices.js", page));
const { in_plane_m } = await import(new URL("imaging/ct_planes.js", page));

// ---- X-ray ----
const kFine = 512, kUsual = [{ key: "ap" }, { key: "lateral" }];
/// Computes what is wanted, one after the other, and returns the keys and sizes in this order.
function computed(pictures, wanted, most = 100) {
  const all = [];
  for (let next; all.length < most && (next = pictures.next(wanted, kFine));) {
    pictures.put(next.key, { size: next.size }, wanted);
    all.push([next.key, next.size]);
  }
  return all;
}

test("the present position has a coarse picture first, and then a fine one", () => {
  const pictures = new XrayPictures(), wanted = [{ key: "30" }, ...kUsual];
  const keys = ["30", "ap", "lateral"];
  assert.deepEqual(computed(pictures, wanted), [...keys.map((key) => [key, 160]), ...keys.map((key) => [key, kFine])]);
  assert.equal(pictures.next(wanted, kFine), null);
  assert.deepEqual(computed(pictures, [{ key: "ap" }, ...kUsual]), [], "a position that is wanted twice");
});

test("positions that the C-arm has left are not computed, and take no picture from the present one", () => {
  const pictures = new XrayPictures(), places = (key) => [{ key }, { key: "of a shot" }, ...kUsual];
  for (let turn = 5; turn <= 90; turn += 5) {
    computed(pictures, places(`${turn}`), 1);  // the worker is slower than the C-arm
    assert.ok(pictures.has(`${turn}`) && pictures.count <= 5);
  }
  const wanted = places("90"), keys = wanted.map(({ key }) => key);
  assert.deepEqual(computed(pictures, wanted).map(([key]) => key), [...keys.slice(1), ...keys]);
  for (const old of ["5", "10", "15", "20", "25", "30"]) pictures.put(old, { size: kFine }, wanted);
  for (const key of keys) assert.ok(pictures.is_fine(key, kFine), key);
});

test("a picture that comes late replaces no finer one, and a larger monitor gets a finer one", () => {
  const pictures = new XrayPictures();
  pictures.put("ap", { size: 320 }, kUsual);
  pictures.put("ap", { size: 160 }, kUsual);
  assert.equal(pictures.get("ap").size, 320);
  assert.equal(pictures.next([{ key: "ap" }], 320), null);
  assert.equal(pictures.next([{ key: "ap" }], kFine).size, kFine);
});

// ---- words ----
test("after a pause the page says Running when a row of after the pause has come", () => {
  const shown = (row, events) => ({ about: {}, events, value: (name, otherwise) => row[name] ?? otherwise });
  const said = (row, events) => describe({ shown: shown(row, events), state: { state: "running" }, is_connected: true }).state;
  const row = { t_s: 2, safety: 2, paused: 0 }, resumed = [{ kind: "paused", t_s: 2 }, { kind: "resumed", t_s: 2 }];
  assert.equal(said(row, []), "Running");
  assert.equal(said(row, resumed), "Paused");
  assert.equal(said({ ...row, t_s: 2.001, paused: 1 }, resumed), "Paused");
  assert.equal(said({ ...row, t_s: 2.001, safety: 3, fault: 1 }, resumed), "Fault");
  assert.equal(said({ ...row, t_s: 2.001 }, resumed), "Running");
});

test("a refused request is said, until a new fault or a recovery", () => {
  const shown = (row, events) => ({ about: {}, events, value: (name, otherwise) => row[name] ?? otherwise });
  const said = (events) => describe({ shown: shown({ t_s: 2, safety: 3, fault: 1, paused: 0 }, events), state: { state: "running" }, is_connected: true }).words;
  const stop = { kind: "fault", fault: "emergency_stop", meaning: "the emergency stop is pressed" };
  const refused = { kind: "recovery_refused", fault: "emergency_stop", why: "the device's emergency stop is pressed; release it" };
  assert.doesNotMatch(said([stop]), /Refused/);
  assert.match(said([stop, refused]), /^Refused: The device's emergency stop is pressed; release it\. .*press Release the stop/);
  assert.doesNotMatch(said([stop, refused, stop]), /Refused/);
});

test("a session that has ended is not called one that did not begin, whatever bone the page shows", () => {
  const said = (has_begun, exit_code) => describe({ has_begun, shown: null, state: { state: "ended", message: "", exit_code }, is_connected: true });
  for (const [has_begun, exit_code, state, level] of [[true, 0, "Ended", "wait"], [true, 4, "Ended", "bad"], [false, 3, "Not started", "bad"]])
    assert.deepEqual([said(has_begun, exit_code).state, said(has_begun, exit_code).level], [state, level]);
});

test("the page warns while less than ten minutes of recording fit on the disk", () => {
  const said = (recording_left_s, row = {}, state = "running") => describe({ shown: { about: {}, events: [], value: (name, otherwise) => ({ t_s: 2, safety: 2, recording_left_s, ...row })[name] ?? otherwise },
    state: { state }, is_connected: true });
  for (const [left_s, time] of [[599, "about 9 minutes"], [60, "about 1 minute"], [59, "less than a minute"], [0, "less than a minute"]]) {
    assert.equal(said(left_s).level, "wait");
    assert.match(said(left_s).words, new RegExp(`^The disk has space for ${time} of recording`));
  }
  for (const left_s of [600, 1e6, Infinity, undefined]) assert.deepEqual([said(left_s).level, said(left_s).words], ["good", "The tool touches nothing."]);
  assert.match(said(30, { paused: 1 }, "paused").words, /^The disk has space for less than a minute.* time is stopped/);
  assert.equal(said(30, { safety: 3, fault: 2 }).level, "bad");
});

// ---- Restart ----
test("Restart starts the session again when it has ended, unless it was stopped in an emergency or is lost", async () => {
  globalThis.fetch = async () => ({ ok: true });
  for (const [over, expected] of [[{ state: "ended" }, 1], [{ state: "ended", emergency_stop: true }, 0], [{ state: "lost" }, 0]]) {
    const started = [];
    const session = { request: () => ({ scene: "a.json" }), fields: () => ({}), is_running: () => true };
    const restart = new Restart({ ...session, start: (body) => started.push(body) });
    await restart.press();
    restart.session_over(over);
    restart.session_over({ state: "ended" });  // it does not wait for another end
    assert.equal(started.length, expected, JSON.stringify(over));
  }
});

// ---- numbers ----
test("a number has a decimal point or a decimal comma, and nothing else is one", () => {
  for (const [text, value] of [["12.5", 12.5], ["12,5", 12.5], [" 7 ", 7], ["-3,25", -3.25], ["\u22123", -3], ["+.5", 0.5], ["1,", 1], ["1.250", 1.25]]) assert.equal(read_number(text), value, text);
  for (const text of ["", "1.234,5", "1,234.5", "1,250", "-1,000", "12,5 mm", "1e3", "0x10", "Infinity", "NaN", "1 2", "--1", ",", "1,2,3"]) assert.equal(read_number(text), null, text);
});

test("a point is three numbers, also with decimal commas, and never two or six", () => {
  const at = [37.5, 206.1, -67.9];
  for (const text of ["37.5, 206.1, -67.9", "37,5 206,1 -67,9", "37,5; 206,1; -67,9", "37.5,206.1,-67.9", " 37.5 206.1\t-67.9 ", "37,5, 206,1, -67,9"]) assert.deepEqual(read_point(text), at, text);
  assert.deepEqual(read_point("1,2,3"), [1, 2, 3]);
  for (const text of ["", "1, 2", "37,5,206,1,-67,9", "1 2 3 4", "one, 2, 3", "1,2 3", "10001, 0, 0", "1,,2 3 4"]) assert.equal(read_point(text), null, text);
});

test("a field's limits are said with what was typed", () => {
  const rule = { min: 1, max: 300, what: "Depth mm" };
  assert.equal(number_fault("", rule), "");
  assert.equal(number_fault("12,5", rule), "");
  assert.match(number_fault("301", rule), /Depth mm: 301 is not within 1 and 300/);
  assert.match(number_fault("1.234,5", rule), /1\.234,5 is not one number/);
  assert.match(number_fault("2,5", { ...rule, whole: true }), /not a whole number/);
});

// ---- notices ----
test("a notice ends with its cause, and one that lasts is said before others", () => {
  let changes = 0;
  const notices = new Notices(() => ++changes);
  notices.say("stop", "not delivered", { lasts: true });
  notices.say("page", new Error("the disk is full"));
  assert.equal(notices.words, "not delivered");
  notices.end("stop");
  assert.equal(notices.words, "the disk is full");
  notices.say("page", "");
  assert.equal(notices.words, "");
  notices.say("page", "for a time");
  notices.say("view", "until it is back", { lasts: true });
  notices.end_passing();
  assert.equal(notices.words, "until it is back");
  notices.end("view");
  assert.equal(changes, 8);
});

// ---- the needle in a plane ----
test("the needle is drawn solid only within 1.5 mm of the plane", () => {
  const x = [1, 0, 0], y = [0, 1, 0], z = [0, 0, 1], most = in_plane_m(x, [x, y]);
  assert.ok(Math.abs(in_plane_m(z, [x, y]) - 0.0015) < 1e-12);
  assert.equal(most, 0.12);
  const tilt = Math.PI / 6;
  assert.ok(Math.abs(in_plane_m([Math.cos(tilt), 0, Math.sin(tilt)], [x, y]) - 0.003) < 1e-12);
});
