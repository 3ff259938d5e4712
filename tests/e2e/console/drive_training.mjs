// SPDX-License-Identifier: Apache-2.0
// drive_training.mjs JSON: trainee, goals, history and ghost in the console's page. The argument: {link, view_link, out}. Prints one JSON
// object: {failures, goals, sessions}; `goals` has what the page showed at the end of each session and of each playback.
import { driver, seek } from "./browser.mjs";

const goals = {}, sessions = {};
const { given, browser, check } = await driver({ goals, sessions });
const page = await browser.open(given.link);
const get = (expression) => page.evaluate(expression);
const until = (expression, what) => browser.until(page, expression, what);

const start = (scene, clock = "virtual") => browser.start(page, scene, { select: { clock }, begun: "trocar.row" });

// ---- who does it ----
for (const [name, value] of [["trainee", "A-17"], ["course", "spine_2026"], ["attempt", "1"]]) await page.fill(`#start-${name}`, value);
await page.reload();
await until("trocar.bone_shown_ms !== null", "the page again");
check(await page.inputValue("#start-trainee") === "A-17" && await page.inputValue("#start-course") === "spine_2026", "the browser does not keep the trainee");
await page.fill("#start-trainee", "Jane Doe");
await page.click("#start");
await page.waitForTimeout(500);
check(await get("trocar.state.state") === "idle", "a session has started with a name instead of a code");
await page.fill("#start-trainee", "A-17");
// Another course begins with the first attempt, also no course. Without course and trainee there is nothing to count.
for (const [name, value, attempt] of [["attempt", "3", "3"], ["course", "", "1"], ["trainee", "", ""], ["trainee", "A-17", "1"],
  ["attempt", "3", "3"], ["course", "spine_2026", "1"]]) {
  await page.fill(`#start-${name}`, value);
  check(await page.inputValue("#start-attempt") === attempt, `after ${name} "${value}" the attempt is "${await page.inputValue("#start-attempt")}"`);
}
await browser.picture(page, "form");

// ---- goals, live and at the end; then in playback ----
for (const scene of ["scenes/met.json", "scenes/broken.json"]) {
  await start(scene);
  await until("trocar.state.state === 'ended' && trocar.goals.is_final", `the verdict of ${scene}`);
  goals[scene] = { live: await get("trocar.goals") };
  sessions[scene] = (await get("trocar.state")).recording;
  check((await page.innerText("#goals")).includes(goals[scene].live.verdict), "the verdict is not on the page");
  await browser.picture(page, `verdict_${scene.replace(/\W/g, "_")}`);
  await page.click("#ended-play");
  await until(`trocar.playback.file === ${JSON.stringify(sessions[scene])} && trocar.goals.t_s < 0.1`, `the playback of ${scene}`);
  await seek(page, 0.5);
  await until("!trocar.goals.is_final && trocar.goals.t_s > 3", "the middle of the playback");
  goals[scene].middle = await get("trocar.goals");
  await browser.picture(page, `goals_${scene.replace(/\W/g, "_")}`);
  await seek(page, 1);
  await until("trocar.goals.is_final", "the verdict at the end of the playback");
  goals[scene].playback = await get("trocar.goals");
  await seek(page, 0.1);
  await until("!trocar.goals.is_final && trocar.goals.t_s < 1", "goals after going back");
  goals[scene].back = await get("trocar.goals");
}
check(await page.inputValue("#start-attempt") === "3", `after two attempts the form says ${await page.inputValue("#start-attempt")}`);

// ---- a ghost beside a session in real time ----
await page.click("[data-to=session]");
await page.waitForTimeout(300);
await page.selectOption("#ghost", sessions["scenes/met.json"]);
await start("scenes/met.json", "");
await until("trocar.ghost_row && trocar.row.t_s[0] > 1", "the ghost");
const times = await get("[trocar.ghost_row.t_s[0], trocar.row.t_s[0]]");
check(Math.abs(times[0] - times[1]) < 0.1, `the ghost is at ${times[0]} s, the session at ${times[1]} s`);
check((await page.innerText("#goals")).includes("Goals so far"), "no goals while the session runs");
await browser.picture(page, "ghost");
await page.click("#theme");
await browser.picture(page, "ghost_light");
await page.click("#stop");
await until("trocar.state.state === 'ended'", "the end of the session with a ghost");

// ---- history ----
await page.click("[data-to=folder]");
await page.waitForTimeout(500);
await page.click("#open-history");
await page.waitForTimeout(2000);
const frame = page.frames().find((each) => each.url().startsWith("blob:"));
const words = frame ? await frame.locator("main").innerText() : "";
for (const wanted of ["Trainee A-17, course spine_2026", "largest force"]) check(words.includes(wanted), `the history lacks ${wanted}: ${words.slice(0, 300)}`);
check(await page.innerText("#report-title") === "History of sessions", "the dialog's title");
await browser.picture(page, "history");
await page.click("#report-close");
await browser.finish();
