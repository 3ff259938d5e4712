// SPDX-License-Identifier: Apache-2.0
// drive_trouble.mjs JSON: what the page says of sessions in trouble, and what its keys do. The argument: {link, view_link, chromium, out}.
// Prints {failures}; pictures go to the folder `out`.
import { driver, pill } from "./browser.mjs";

const { given, browser, check, until, get } = await driver();

const page = await browser.open(given.link);
await until(page, "trocar.bone_shown_ms !== null", "the bone of the first scene");

// ---- a scene with broken JSON has its reason ----
check(/broken\.json/.test(await page.innerText("#scenes")), "a scene with broken JSON is not listed");
await browser.accessible(page, "folder");
await browser.sizes(page, "folder");

const start = (scene, seconds) => browser.start(page, scene, { seconds });
const pid = () => get(page, "trocar.pid");

// ---- the space key presses what has the focus, and never ends a session ----
await start("scenes/outside.json", 600);
await until(page, `document.querySelector("#caption").innerText.includes("mm from the tip")`, "the caption with the target");
const away_mm = /sphere: target, ([0-9.]+) mm from the tip/.exec(await page.innerText("#caption"))?.[1];
const tip_z_m = await get(page, "trocar.row.tool_m[2]");
check(Math.abs(away_mm - 1000 * (tip_z_m - 0.11)) < 1, `the target is said to be ${away_mm} mm away, with the tip at ${tip_z_m} m`);
await browser.sizes(page, "running");
await page.focus("#pause");
await page.keyboard.press("Space");
await until(page, `${pill} === "Paused"`, "the space key on the button Pause");
await page.keyboard.press("Space");
await until(page, `${pill} === "Running"`, "the space key on the button Resume");
await page.focus("[data-view=tool]");
await page.keyboard.press("Space");
await until(page, `document.querySelector("[data-view=tool]").getAttribute("aria-pressed") === "true"`, "the space key on a view's button");
check(await get(page, "trocar.state.state") === "running", "the space key ended the session");
await page.evaluate(() => document.activeElement.blur());
await page.keyboard.press("Space");
await until(page, `${pill} === "Paused"`, "the space key on the view");
await page.keyboard.press("Space");
await until(page, `${pill} === "Running"`, "going on by the space key on the view");
await page.click("#zero");
await until(page, `${pill} === "Forces off"`, "zero forces");
await page.keyboard.press("Space");
await until(page, `${pill} === "Paused"`, "the space key after a click on a button");
await browser.accessible(page, "paused");
await page.evaluate(() => document.activeElement.blur());
await page.keyboard.press("Space");
check(await page.locator("#events li.fault").count() === 0, `a pause is shown as a fault: ${await page.innerText("#events")}`);
await page.click("#recover");
await until(page, `${pill} === "Running"`, "forces again");

// ---- Esc on a page of the audience ----
const audience = await browser.open(given.view_link);
await until(audience, `trocar.role === "view" && trocar.row`, "the audience's page");
const [begin_s] = await get(audience, "trocar.history_s"), late_s = await get(audience, "trocar.row.t_s[0]");
check(late_s > 2 && begin_s < 0.5, `a page that came after ${late_s} s shows the force from ${begin_s} s on`);
await audience.keyboard.press("Escape");
await until(audience, `/Esc commands nothing/.test(trocar.words)`, "what Esc means for the audience");
await page.waitForTimeout(500);
check(await get(page, pill) === "Running", "Esc of the audience stopped the session");
await browser.picture(audience, "audience");
await browser.accessible(audience, "audience");
await audience.click("#emergency");
await until(page, `${pill} === "Emergency stop"`, "the emergency stop of the audience");
await browser.picture(page, "emergency_stop");
await browser.accessible(page, "emergency_stop");
await browser.sizes(page, "emergency_stop");
check(await page.innerText("#recover") === "Release the stop", `the button of the release says ${await page.innerText("#recover")}`);
await page.click("#recover");
await until(page, `${pill} === "Running"`, "the session after the release");

// ---- Esc during a recovery ----
await page.click("#zero");
await until(page, `${pill} === "Forces off"`, "zero forces before the recovery");
await page.evaluate(() => { document.getElementById("recover").click(); });
await until(page, `${pill} === "Recovering"`, "the recovery", 5000);
await page.keyboard.press("Escape");
await until(page, `${pill} === "Emergency stop"`, "the emergency stop during a recovery");
await page.waitForTimeout(700);
check(await get(page, pill) === "Emergency stop", "the stop released itself");
await page.click("#recover");
await until(page, `${pill} === "Running"`, "the session after the second release");

// ---- a session that hangs ----
process.kill(await pid(), "SIGSTOP");
await until(page, `${pill} === "No answer"`, "the alarm of a hung session", 3000);
check(await get(page, `document.getElementById("status").dataset.level`) === "bad", "the alarm is not red");
await until(page, `/s ago/.test(document.getElementById("clock").textContent)`, "the age of the data", 3000);
await browser.picture(page, "no_data");
await browser.accessible(page, "no_data");
process.kill(await pid(), "SIGCONT");
await until(page, `${pill} === "Running"`, "the session that goes on");
await page.keyboard.press("Shift+Q");
await until(page, `trocar.state.state === "ended"`, "the end by Shift and Q");

// ---- a start that fails leaves nothing of the session before ----
await page.click("[data-to=folder]");
await page.selectOption("#start-scene", "scenes/lost.json");
await page.click("#start");
await until(page, `${pill} === "Not started"`, "a start that fails");
check(/no_such\.glb/.test(await get(page, "trocar.words")), `the reason: ${await get(page, "trocar.words")}`);
check(/field Asset/.test(await get(page, "trocar.words")) && !/--asset/.test(await get(page, "trocar.words")), `the advice: ${await get(page, "trocar.words")}`);
await until(page, `!/emergency_stop/.test(document.getElementById("events").textContent)`, "events that are gone");
check(await get(page, "trocar.row") === null && await get(page, `document.getElementById("clock").textContent`) === "", "the session before is still on the page");
await browser.picture(page, "not_started");
await browser.accessible(page, "not_started");
await browser.sizes(page, "not_started");

// ---- colours that the system prefers, or forces ----
const forced = await browser.open(given.link, { colorScheme: "light", forcedColors: "active" });
await until(forced, "trocar.bone_shown_ms !== null", "the bone with forced colours");
check(await get(forced, "document.documentElement.dataset.theme") === "light", "the page does not follow the system's light theme");
check(await forced.evaluate(() => getComputedStyle(document.querySelector(".gauge")).forcedColorAdjust) === "none", "gauges lose their colours");
await browser.picture(forced, "forced_colours");
await browser.finish();
