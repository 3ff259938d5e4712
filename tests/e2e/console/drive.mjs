// SPDX-License-Identifier: Apache-2.0
// drive.mjs JSON: drives the console's page in a headless Chromium as an operator would. The argument: {link, view_link, console_pid,
// out, scenes}. Prints one JSON object: {failures, figures, sessions}; pictures go to the folder `out`.
import { execFileSync } from "node:child_process";
import { writeFileSync } from "node:fs";
import { driver, pill, seek, set_hidden } from "./browser.mjs";

const figures = {}, sessions = {};
const { given, browser, check, until, get } = await driver({ figures, sessions });
const size = { small: { width: 1280, height: 720 }, wall: { width: 3840, height: 2160 } };

const open = (link) => browser.open(link);
/// Like until(), but presses Recover in each fault.
async function until_recovered(page, expression, what) {
  for (const end = Date.now() + 30000; Date.now() < end; await page.waitForTimeout(200)) {
    if (await get(page, expression)) return;
    if ((await page.innerText("#state")).startsWith("Fault")) await page.click("#recover", { timeout: 1000 }).catch(() => {});
  }
  browser.fail(`${what}: did not happen within 30 s; the page says "${await get(page, "trocar.words")}"`);
}
const picture = (page, name) => browser.picture(page, name);
const start = (page, scene, { device = "inproc", clock = "" } = {}) => browser.start(page, scene, { select: { device, clock },
  begun: `trocar.state.state === "${clock === "virtual" ? "ended" : "running"}" && trocar.row` });
async function ended(page, name) {
  await until(page, `trocar.state.state === "ended"`, `the end of ${name}`);
  sessions[name] = (await get(page, "trocar.state")).recording;
}

// ---- opening: lists, and bone on the screen ----
const page = await open(given.link);
await until(page, "trocar.bone_shown_ms !== null", "the bone of the first scene");
figures.bone_shown_ms = Math.round(await get(page, "trocar.bone_shown_ms"));
figures.renderer = await get(page, "trocar.renderer");
for (const [list, names] of [["scenes", given.scenes], ["assets", ["sample.glb"]]]) {
  const text = await page.innerText(`#${list}`);
  for (const name of names) check(text.includes(name), `${name} is not among the ${list}`);
}
check(await page.inputValue("#start-scene") === "beside.json", "the page does not begin with a scene of whole bone");
check(await page.locator("#scenes img, #scenes b, #start-scene img").count() === 0, "a file's name became HTML");
check(!page.url().includes("#"), "the token stays in the address");


// ---- three slices ----
await start(page, "three_slices.json");
await until(page, "trocar.slices.length === 3", "three slices");
const whole = await get(page, "trocar.slices");
await page.locator("#canvas-box").screenshot({ path: `${given.out}/bone_three_slices.png` });
await until(page, `trocar.events.filter((event) => event.kind === "puncture").length === 3`, "three punctures");
await until(page, "trocar.slices.every((slice) => slice.cuts === 1)", "three holes");
await ended(page, "three_slices");
const cut = await get(page, "trocar.slices");
cut.forEach((slice, k) => check(slice.vertices > whole[k].vertices || slice.triangles !== whole[k].triangles, `slice ${slice.slice}: its mesh has not changed`));
const totals = await get(page, "trocar.totals");
check(totals.loaded === 3 && totals.punctured === 3 && totals.touched === 3, `slices loaded, touched, punctured: ${JSON.stringify(totals)}`);
check((await page.innerText("#slice-counts")).replace(/\s+/g, " ").includes("3 punctured"), "the page does not say that 3 slices are punctured");

// ---- a needle through a vertebra: pictures and frames ----
await start(page, "vertebra.json");
await until(page, "trocar.surface_triangles > 1000 && trocar.slices.length === 35", "the surface and the slices of the vertebra");
const frames_of = async (seconds) => {
  const before = await get(page, "[trocar.frames, performance.now()]");
  await page.waitForTimeout(1000 * seconds);
  const after = await get(page, "[trocar.frames, performance.now()]");
  return +(1000 * (after[0] - before[0]) / (after[1] - before[1])).toFixed(1);
};
await page.waitForTimeout(1200);  // the resolution has followed
figures.fps_surface = await frames_of(2);
figures.scale_surface = +(await get(page, "trocar.scale")).toFixed(2);
// The surface is coarse exactly if the resolution is reduced.
await until(page, `trocar.scale < 1 && trocar.surface_triangles > 10000 ? trocar.drawn_surface_triangles > 3000 && trocar.drawn_surface_triangles < 20000
  : trocar.drawn_surface_triangles === trocar.surface_triangles`, "the surface, coarse at a reduced resolution", 2000);
await page.locator("#canvas-box").screenshot({ path: `${given.out}/bone_vertebra.png` });
await page.selectOption("#shown", "all");
await page.waitForTimeout(1000);
figures.fps_slices = await frames_of(2);
figures.scale_slices = +(await get(page, "trocar.scale")).toFixed(2);
check(await get(page, `trocar.events.some((event) => event.kind === "puncture")`), "nothing of the vertebra was punctured");
await page.selectOption("#shown", "near");

// ---- a hidden page comes back with the present state, and has lost no event ----
await set_hidden(page, true);
await page.waitForTimeout(700);
const hidden_t = (await get(page, "trocar.row")).t_s[0];
await set_hidden(page, false);
await until(page, `trocar.row.t_s[0] > ${hidden_t} + 0.3 || trocar.state.state === "ended"`, "the present state after the page was hidden");
await ended(page, "vertebra");
await until(page, "trocar.drawn_surface_triangles === trocar.surface_triangles", "the whole surface when nothing moves");
const numbers = await get(page, "trocar.events.map((event) => event.seq)");
check(numbers.every((seq, k) => seq === k + 1) && await get(page, "trocar.missed") === 0, "events are missing or doubled after the page was hidden");
const live_punctures = await get(page, `trocar.events.filter((event) => event.kind === "puncture")`);
check(live_punctures.length > 5 && live_punctures.every(({ text }) => /N at the tip, [0-9.]+ N on the hand/.test(text)), `punctures without both forces: ${live_punctures[0]?.text}`);

// ---- the spring network: the sheet under the tool bends ----
await start(page, "network_middle.json");
await until(page, "trocar.row.penetration_m[0] > 0.002 && trocar.shape.deepest_m > 0.0015", "a bending sheet");
await picture(page, "bending");
await ended(page, "network");

// ---- an audience ----
const audience = await open(given.view_link);
await until(audience, `trocar.role === "view" && trocar.bone_shown_ms !== null`, "the audience's page");
check(await audience.locator(".operator:visible").count() === 0, "the audience has controls");
await audience.close();

// ---- restart of the device ----
// A machine that stalls for some ms causes faults of its own: recover from them, and if one comes first, begin again.
let fault = "", recoveries = 0;
for (let attempt = 0; attempt < 5 && !["no_data", "link_lost"].includes(fault); ++attempt) {
  if (attempt > 0) {
    await page.keyboard.press("Shift+Q");
    await ended(page, "stood_still");
  }
  await start(page, "waiting.json", { device: "sim" });
  await until_recovered(page, "trocar.row.safety[0] === 2 && trocar.row.t_s[0] > 0.3", "a session that runs with its device");
  const children = execFileSync("ps", ["-o", "pid=,comm=", "--ppid", String(given.console_pid)], { encoding: "utf8" });
  const device = /^\s*(\d+)\s+trocar-device-s/m.exec(children);
  check(device, `the console has no device process: ${children}`);
  if (device) process.kill(Number(device[1]), "SIGKILL");
  await until(page, `${pill}.startsWith("Fault")`, "a fault when the device process is killed");
  fault = await get(page, `trocar.events.findLast((event) => event.kind === "fault")?.fault`);
  recoveries = await get(page, `trocar.events.filter((event) => event.kind === "recovered").length`);
}
check(["no_data", "link_lost"].includes(fault), `the fault is ${fault}`);
check(/[a-z]{4,}.*[.] .*Recover/.test(await page.innerText("#words")), `the fault's words do not say what to do: ${await page.innerText("#words")}`);
for (const theme of ["dark", "light"]) {
  await picture(page, `fault_${theme}`);
  await page.click("#theme");
}
await browser.accessible(page, "fault");
await browser.sizes(page, "fault");
await page.click("#recover");
await until_recovered(page, `trocar.events.filter((event) => event.kind === "recovered").length > ${recoveries} && ${pill} === "Running"`, "the recovery on command");
await page.keyboard.press("Shift+Q");
await ended(page, "device_killed");

// ---- playback, two recordings, report ----
await start(page, "beside.json", { clock: "virtual" });
await ended(page, "beside");
await page.click("[data-to=folder]");
const entry = (file) => page.locator("#recordings li", { has: page.locator(".file", { hasText: file }) });
await entry(sessions.vertebra).waitFor();
await entry(sessions.vertebra).getByText("Play", { exact: true }).click();
await until(page, "trocar.playback.end_s > 8 && trocar.slices.length === 35", "the recording of the vertebra");
for (const share of [0.9, 0.25, 0.55]) {
  await seek(page, share);
  const { time_s, end_s } = await get(page, "trocar.playback");
  check(Math.abs(time_s - share * end_s) < 0.002 * end_s, `sought ${share} of ${end_s} s, got ${time_s} s`);
  const found = await get(page, "trocar.playback_row.t_s[0]");
  check(Math.abs(found - time_s) < 0.003, `the row at ${time_s} s is of ${found} s`);
}
// Recordings have no column for the tool's axis: it follows from the plate's rotation.
const axis = await get(page, "trocar.playback_axis");
check(axis !== null && Math.abs(Math.hypot(...axis) - 1) < 1e-9 && axis[2] < -0.5, `the tool's axis in playback is ${axis}`);
check(await get(page, "trocar.playback.events") > 0, "no puncture of the recording is shown");
// Each puncture has one time, one force at the tip and one on the hand, live and in playback.
const played = (await get(page, "trocar.playback.all_events")).filter(({ kind }) => kind === "puncture");
check(played.length === live_punctures.length, `${played.length} punctures in playback, ${live_punctures.length} live`);
for (const { slice, t_s, tip_N, hand_N, text } of live_punctures) {
  const again = played.find((event) => event.slice === slice);
  const same = again && [[t_s, again.t_s], [tip_N, again.tip_N], [hand_N, again.hand_N]].every(([one, other]) => Math.abs(one - other) < 1e-6);
  check(same && again.text.startsWith(text.split(", depth")[0]), `live: ${text}; in playback: ${again?.text}`);
}
await page.click("#play");
await until(page, "trocar.playback.time_s > 0.6 * trocar.playback.end_s", "playing");
await page.click("#play");
await page.selectOption("#against", sessions.beside);
await until(page, "trocar.playback.second", "the second recording");
await seek(page, 0.4);
await browser.accessible(page, "playback");
await browser.sizes(page, "playback");
for (const [name, viewport] of Object.entries(size)) {
  await page.setViewportSize(viewport);
  for (const theme of ["dark", "light"]) {
    for (const view of ["perspective", "tool", "section"]) {
      await page.click(`[data-view=${view}]`);
      await browser.settle(page, 700);
      await picture(page, `playback_${view}_${theme}_${name}`);
    }
    await page.click("[data-to=folder]");
    await page.click("[data-view=perspective]");
    await browser.settle(page, 900);
    await picture(page, `folder_${theme}_${name}`);
    await page.click("[data-to=session]");
    await browser.settle(page, 900);
    await picture(page, `session_${theme}_${name}`);
    await page.click("[data-to=playback]");
    await page.click("#theme");
  }
}
await page.setViewportSize(size.small);
await page.click("#player-report");
await page.locator("#report-box[open]").waitFor();
await page.waitForTimeout(800);
const inside = page.frames().find((frame) => frame !== page.mainFrame());
const report = inside ? await inside.evaluate(() => document.body?.innerText ?? "").catch(() => "") : "";
check(/\bN\b/.test(report) && /Times, path and force/.test(report) && report.length > 1000, `the report did not open: "${report.slice(0, 80)}", ${await get(page, "trocar.words")}`);
await browser.shot(page, "report");
await browser.accessible(page, "report");
await browser.sizes(page, "report");

// ---- a device without motors and joints of its own ----
const shown_rows = await page.evaluate(async () => {
  const [{ Gauges }, { Shown }] = await Promise.all([import("/gauges.js"), import("/data.js")]);
  for (const rows of document.querySelectorAll("#torques .rows, #limits .rows")) rows.replaceChildren();
  const gauges = new Gauges();
  const count = (about, recorded) => {
    const columns = (recorded ?? ["p_m", "tau_Nm", "motor_angle_rad"]).map((name) => ({ name, count: 16 }));
    gauges.update(Object.assign(new Shown(columns, about), { is_recording: Boolean(recorded) }));
    const names = [...document.querySelectorAll("#torques:not([hidden]) h2, #limits .name:not([hidden])")].map((name) => name.textContent);
    return ["Joint torques, N m", "Joint limit", "Motor heat", "Plate x"].filter((name) => names.includes(name)).length;
  };
  const legs = { motor_peak_torque_Nm: 6, joint_limits_rad: [[3, 5], [-3, 0], [-1, 1], [-1, 0]] }, none = { motor_peak_torque_Nm: null, joint_limits_rad: [] };
  return { legs: count(legs), none: count(none), unknown: count({}), recorded_legs: count(none, ["tau_Nm", "motor_angle_rad"]), recorded_none: count(legs, ["device_x_m"]) };
});
for (const [name, wanted] of Object.entries({ legs: 4, none: 1, unknown: 4, recorded_legs: 4, recorded_none: 1 }))
  check(shown_rows[name] === wanted, `the rows of motors, joints and the plate: ${shown_rows[name]} of ${wanted} are shown (${name})`);

writeFileSync(`${given.out}/figures.json`, JSON.stringify(figures, null, 1));
await browser.finish();
