// SPDX-License-Identifier: Apache-2.0
// What the page finds in the rows of a recording (playback.js, goals.js), in node. TROCAR_PAGE is the folder of the page.
import assert from "node:assert/strict";
import test from "node:test";
import { pathToFileURL } from "node:url";

// api.js looks for a token in the address.
for (const [name, value] of Object.entries({ location: { hash: "" }, sessionStorage: { getItem: () => null }, addEventListener: () => {} }))
  Object.defineProperty(globalThis, name, { value, configurable: true });
const page = pathToFileURL(`${process.env.TROCAR_PAGE}/`);
const { Playback, Recorded } = await import(new URL("playback.js", page));
const { GoalMeter } = await import(new URL("goals.js", page));

const kFree = 0, kContact = 1, kPunctured = 2, kRunning = 2, kFault = 3;  // ContactPhase, SafetyState
const kColumns = { t_s: 1, tool_m: 3, wrench_delivered: 6, phase: 1, safety: 1, front_z_m: 1, tip_N: 1, embedded_m: 1 };

/// A recording of the force law `cutting`. `rows`: [height of the tip, front, x of the tip, safety state]. Row i is at i seconds.
function recorded(rows, slices) {
  const columns = Object.entries(kColumns).map(([name, count]) => ({ name, count }));
  const values = rows.flatMap(([z, front, x = 0, safety = kRunning], i) => [i, x, 0, z, 0, 0, 0, 0, 0, 0, kFree, safety, front, 3, 0]);
  const shown = new Recorded({ json: { columns, rows: rows.length }, doubles: () => Float64Array.from(values) });
  const positions = new Float32Array([-0.01, -0.01, 0.01, -0.01, 0.01, 0.01, -0.01, 0.01]), triangles = new Uint32Array([0, 1, 2, 0, 2, 3]);
  shown.set_bone({ slices: slices.map((z_m, slice) => ({ slice, z_m, positions, triangles })), top_m: slices[0] });
  return shown;
}
const punctures = (shown) => shown.all_events.map(({ kind, slice, t_s }) => [kind, slice, t_s]);

test("the lowest slice is punctured although the row in which the front left the bone is missing", () => {
  const shown = recorded([[0.104, 0.1025], [0.1015, 0.1015], [0.1012, 0.1012], [0.1003, 0], [0.09, 0], [0.104, 0]], [0.102, 0.101]);
  assert.deepEqual(punctures(shown), [["puncture", 0, 1], ["puncture", 1, 3]]);
  assert.deepEqual(punctures(recorded([[0.104, 0.102], [0.1019, 0.102], [0.1, 0]], [0.102])), [["puncture", 0, 2]], "a single slice");
});

test("where there is no front because the tip is beside the bone or the session has a fault, nothing is punctured", () => {
  const beside = [[0.104, 0.1025], [0.104, 0, 0.05], [0.09, 0, 0.05], [0.104, 0, 0.05]];
  assert.deepEqual(punctures(recorded(beside, [0.102, 0.101])), []);
  const later = recorded([...beside, [0.104, 0.1025], [0.1015, 0.1015], [0.1, 0]], [0.102, 0.101]);
  assert.deepEqual(punctures(later), [["puncture", 0, 5], ["puncture", 1, 6]], "the bone is cut afterwards");
  assert.deepEqual(punctures(recorded([[0.104, 0.1025], [0.1015, 0.1015], [0.1, -0, 0, kFault]], [0.102, 0.101])), [["puncture", 0, 1]]);
});

test("the time of a goal begins with a puncture if there was no contact before, and is never negative", () => {
  const at = (t_s, phase, z) => Float64Array.from([t_s, 0, 0, z, 0, 0, 0, 0, 0, 0, phase, kRunning, 0, 0, 0]);
  const { columns } = recorded([[0.104, 0]], [0.102]);
  const force = () => 0, meter = (goals) => Object.assign(new GoalMeter({ time_max_s: 1, ...goals }), { shown: { columns, force } });
  const took = (goals, rows, last_puncture_s) => {
    const one = meter(goals);
    for (const row of rows) one.take(one.shown, row);
    return one.standing(last_puncture_s).find(({ goal }) => goal === "time").value;
  };
  assert.equal(took({}, [at(0, kFree, 0.104), at(1, kPunctured, 0.1), at(1.5, kContact, 0.09), at(2, kPunctured, 0.08)], 2), 1);
  const target = { at_m: [0, 0, 0.103], radius_m: 0.001 };
  assert.equal(took({ target }, [at(0, kFree, 0.11), at(1, kFree, 0.103), at(2, kContact, 0.1)], null), 0);
});

test("the recording that was chosen last is shown, although an earlier one arrives later", async () => {
  const waiting = [];
  const bytes = (rows) => {
    const text = JSON.stringify({ columns: [{ name: "t_s", count: 1 }], rows, rows_at: [0, rows], events: [] }).padEnd(512 - 4);
    const file = new ArrayBuffer(512 + 8 * rows);
    new DataView(file).setUint32(0, 508, true);
    new Uint8Array(file).set(new TextEncoder().encode(text), 4);
    new Float64Array(file, 512).set(Array.from({ length: rows }, (_, i) => i));
    return file;
  };
  globalThis.fetch = (path) => new Promise((resolve) => waiting.push([path, (rows) => resolve(new Response(bytes(rows)))]));
  const answer = (k, rows) => waiting[k][1](rows);
  const playback = new Playback();
  const large = playback.open("large one.csv", ""), small = playback.open("small.csv", "");
  assert.equal(waiting[0][0], "/api/recording?file=large+one.csv");
  answer(1, 2);
  assert.equal(await small, true);
  answer(0, 5);
  assert.equal(await large, false);
  assert.deepEqual([playback.file, playback.first.count], ["small.csv", 2]);

  const second = playback.compare("large one.csv", "");
  assert.equal(await playback.compare("", ""), true);
  answer(2, 5);
  assert.equal(await second, false, "none was chosen later");
  assert.equal(playback.first.second, null);

  // The page asks again while the first answer is on its way. Each answer is shown, and the second recording stays beside the first.
  const once = playback.open("a.csv", ""), again = playback.open("a.csv", "");
  answer(3, 3);
  assert.equal(await once, true);
  const beside = playback.compare("b.csv", "");
  answer(4, 3);
  assert.equal(await again, true);
  answer(5, 4);
  assert.equal(await beside, true);
  assert.deepEqual([playback.first.count, playback.first.second.count], [3, 4]);

  // Choosing no second recording does not stop the first from being opened; a failed request does not stop an older one.
  const opened = playback.open("c.csv", "");
  await playback.compare("", "");
  const failed = playback.open("missing.csv", "");
  waiting[7][1] = null;
  answer(6, 7);
  assert.equal(await opened, true);
  assert.deepEqual([playback.file, playback.first.count, playback.first.second ?? null], ["c.csv", 7, null]);
  failed.catch(() => {});
});
