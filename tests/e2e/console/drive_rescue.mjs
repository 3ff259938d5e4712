// SPDX-License-Identifier: Apache-2.0
// drive_rescue.mjs JSON: the emergency stop and Restart when other things happen: a report has the focus, the session starts, hangs in a pause or
// is restarted, the console stands still, the link is a new one. The argument: {link, view_link, pid, chromium, out}. Prints {failures}.
import { driver, pill } from "./browser.mjs";

const { given, browser, check, until, get } = await driver();

// ---- a link with another token, in the tab of this page ----
const page = await browser.open(given.view_link);
await until(page, `trocar.role === "view"`, "the audience's page");
await Promise.all([page.waitForEvent("load"), page.goto(given.link)]);  // the page loads itself again
await until(page, `window.trocar?.role === "operator"`, "the operator's link in the tab of the audience");
check(await get(page, "location.hash") === "", "the token stays in the address");

const start = (scene, seconds) => browser.start(page, scene, { seconds });
const session = () => get(page, "trocar.session");
const is_over = `["ended", "idle", "lost"].includes(trocar.state.state)`;
async function expect_none(what) {
  await until(page, is_over, `the end: ${what}`);
  await page.waitForTimeout(2000);
  check(await get(page, is_over), `${what}: a session began that nobody started`);
}

// ---- Restart starts the same again, also on a page that has not started it ----
await start("scenes/outside.json", 600);
const first = await session();
await page.reload();
await until(page, `window.trocar?.state.state === "running" && trocar.row`, "the session after loading the page again");
await page.click("#restart");
await until(page, `trocar.state.state === "running" && trocar.session !== "${first}" && trocar.row && trocar.row.t_s[0] < 300`, "another session after Restart");
check(await get(page, "trocar.state.request.scene") === "scenes/outside.json" && await get(page, "trocar.state.request.duration_s") === 600,
  `Restart has started ${JSON.stringify(await get(page, "trocar.state"))}`);

// ---- an emergency stop withdraws Restart ----
await page.evaluate(() => {
  document.getElementById("restart").click();
  document.dispatchEvent(new KeyboardEvent("keydown", { key: "Escape", bubbles: true }));
});
await expect_none("Restart and the emergency stop");

// ---- Stop while a session starts ----
await page.evaluate(() => document.getElementById("start").click());
await until(page, `trocar.state.state === "starting" || trocar.state.state === "running"`, "a start", 5000);
await page.evaluate(() => document.getElementById("stop").click());
await expect_none("Stop while a session starts");

// ---- pause, zero forces, resume ----
await start("scenes/outside.json", 600);
await page.click("#pause");
await until(page, `${pill} === "Paused"`, "a pause");
await browser.picture(page, "paused");
await page.click("#zero");
await page.click("#pause");
await until(page, `${pill} === "Forces off"`, "forces that were switched off in a pause");
await page.click("#recover");
await until(page, `${pill} === "Running"`, "forces again");

// ---- Esc while the report of another session has the focus ----
await page.click("[data-to=folder]");
await page.locator("#recordings button", { hasText: "Report" }).first().click();
await page.frameLocator("#report-frame").locator("main").click();
await page.waitForTimeout(300);
await page.keyboard.press("Escape");
await until(page, `${pill} === "Emergency stop"`, "Esc in a report");
await page.click("#report-close");
await page.click("#recover");
await until(page, `${pill} === "Running"`, "the session after the release");

// ---- a session that hangs in a pause ----
await page.click("#pause");
await until(page, `${pill} === "Paused"`, "a pause before the session hangs");
process.kill(await get(page, "trocar.pid"), "SIGSTOP");
await until(page, `${pill} === "No answer"`, "the alarm of a session that hangs in a pause", 5000);
await page.keyboard.press("Escape");
await until(page, `${pill} === "Session lost"`, "the end of a session that hangs in a pause", 5000);

// ---- a console that stands still ----
await start("scenes/outside.json", 600);
process.kill(given.pid, "SIGSTOP");
await until(page, `${pill} === "No connection"`, "a console that stands still", 10000);
await page.keyboard.press("Escape");
await until(page, `/not delivered/.test(trocar.words)`, "an emergency stop that is not answered", 5000);
process.kill(given.pid, "SIGCONT");
await until(page, "trocar.is_connected", "the console that goes on");
await until(page, `${pill} === "Emergency stop"`, "the emergency stop, delivered late", 20000);
await until(page, `!/not delivered/.test(trocar.words) && /Release the stop/.test(trocar.words)`, "the advice, once the stop is delivered", 2000);
await page.keyboard.press("Shift+Q");
await until(page, is_over, "the end");
await browser.finish();
