// SPDX-License-Identifier: Apache-2.0
// drive_devices.mjs JSON: chooses and tests a device in the console's page. The argument: {link, view_link, plain_link, chromium, out,
// device, dead, secret}; the console of `plain_link` lists no device, and no page may show `secret`. Prints {failures}; pictures go to
// the folder `out`.
import { driver } from "./browser.mjs";

const { given, browser, check, until, get } = await driver();

const focused = `document.activeElement.id`;
const is_over = `document.getElementById("test-result").checkVisibility()`;
const kOutside = "scenes/outside.json", kLive = "scenes/live.json";

/// Opens the dialog with the device that is chosen, and checks what it says before the test.
async function ask_for_test(page, name) {
  await page.click("#test-open");
  const said = await page.innerText("#test-box");
  check(/gets no force/.test(said) && /support it/.test(said) && said.includes(name), `before the test the page says: ${said}`);
  check(await get(page, focused) === "test-start", `the dialog has the focus on ${await get(page, focused)}`);
}

// ---- the list, by keys, and what the browser remembers ----
const page = await browser.open(given.link);
await until(page, "trocar.bone_shown_ms !== null", "the bone of the first scene");
const names = await page.locator("#start-device option").evaluateAll((all) => all.map(({ value, textContent }) => [value, textContent]));
check(JSON.stringify(names) === JSON.stringify([["inproc", "simulated in the process"], [given.device, `${given.device} (simulated)`], [given.dead, given.dead]]), `the devices: ${JSON.stringify(names)}`);
check(await page.isDisabled("#test-open"), "the device in the process can be tested");
await page.getByRole("combobox", { name: "Device", exact: true }).focus();
await page.keyboard.press("ArrowDown");
await page.reload();
await until(page, `document.getElementById("start-device").value === ${JSON.stringify(given.device)}`, "the device that the browser remembers");

// ---- a live hand: the reason instead of a start ----
await page.selectOption("#start-scene", kLive);
await until(page, `document.getElementById("start-note").checkVisibility()`, "the reason against a live hand");
await page.click("#start");
await until(page, `/held from this page, which is for the device simulated in the process/.test(trocar.words)`, "the reason after Start");
check(await get(page, `trocar.state.state === "idle"`), "a session of a live hand was started with another device");
await browser.picture(page, "live_hand");
await page.selectOption("#start-device", "inproc");
await until(page, `!document.getElementById("start-note").checkVisibility()`, "no reason with the device in the process");
await page.selectOption("#start-device", given.device);
await page.selectOption("#start-scene", kOutside);

// ---- a test, by keys ----
await until(page, `!document.getElementById("test-open").disabled`, "the button of the test");
await ask_for_test(page, given.device);
await browser.picture(page, "test_before");
await page.keyboard.press("Enter");
await until(page, `document.getElementById("test-running").checkVisibility()`, "the test that runs");
check(await page.isDisabled("#test-close") && await get(page, focused) === "test-stop", "a test that runs can be closed");
await browser.picture(page, "test_runs");
await until(page, is_over, "the end of the test");
const verdict = await page.innerText("#test-verdict"), troubles = await page.locator("#test-troubles li").count();
check(/^A session at this rate (should hold|will not hold well)\.$/.test(verdict) && /should/.test(verdict) === (troubles === 0), `the verdict: ${verdict}, ${troubles} troubles`);
check(!await page.isVisible("#test-numbers"), "the numbers are shown before they are asked for");
await page.focus("#test-details summary");
await page.keyboard.press("Enter");
await until(page, `document.getElementById("test-numbers").checkVisibility()`, "the numbers");
check(/round trip.*median.*\n\s+up to/.test(await page.innerText("#test-numbers")), `the numbers: ${await page.innerText("#test-numbers")}`);
await page.waitForTimeout(200);
await browser.picture(page, "test_over", true);
await page.focus("#test-close");
await page.keyboard.press("Enter");
check(!await page.isVisible("#test-box") && await get(page, focused) === "test-open", "the dialog does not close");

// ---- a test that is stopped, and one of a dead device ----
await ask_for_test(page, given.device);
await page.click("#test-start");
await page.waitForTimeout(500);
await page.keyboard.press("Space");
await until(page, is_over, "the end of a test that is stopped", 5000);
check(/^The test was stopped before its end\./.test(await page.innerText("#test-verdict")), `a stopped test: ${await page.innerText("#test-verdict")}`);
await page.click("#test-close");
await page.selectOption("#start-device", given.dead);
await until(page, `!document.getElementById("test-open").disabled`, "the button of the test of a dead device");
await ask_for_test(page, given.dead);
await page.click("#test-start");
await until(page, is_over, "the test of a dead device");
check(/^trocar-run: 127\.0\.0\.1:9: no device answers there/.test(await page.innerText("#test-verdict")), `a dead device: ${await page.innerText("#test-verdict")}`);
await browser.picture(page, "test_dead");
await page.click("#test-close");

// ---- a session on the device ----
await page.selectOption("#start-device", given.device);
await page.click("#start");
const caption = `document.getElementById("caption").firstChild.textContent`;
await until(page, `trocar.state.state === "running" && trocar.row && ${caption}.includes(${JSON.stringify(given.device)})`, "the session with its device's name");
await page.waitForTimeout(500);
await browser.picture(page, "session");
await page.click("[data-to=folder]");
await until(page, `document.getElementById("test-open").disabled`, "no test while a session runs");
await page.click("[data-to=session]");
await page.keyboard.press("Shift+Q");
await until(page, `trocar.state.state === "ended"`, "the end of the session");
await page.click("#ended-report");
await until(page, `document.getElementById("report-device").textContent.includes(${JSON.stringify(given.device)})`, "the device's name with the report");
await page.waitForTimeout(1000);
await browser.picture(page, "report");
await page.click("#report-close");
await page.click("[data-to=folder]");
await until(page, `document.getElementById("recordings").textContent.includes(${JSON.stringify(`device: ${given.device}`)})`, "the device's name in the list");
await browser.picture(page, "list");
// A session that does not begin: trocar-run's own line.
await page.selectOption("#start-device", given.dead);
await page.click("#start");
await until(page, `/no device answers there/.test(trocar.words)`, "trocar-run's line about a dead device");
check(!(await page.content()).includes(given.secret), "the page has a path");
await page.close();

// ---- the audience, and a console without devices ----
const audience = await browser.open(given.view_link);
await until(audience, "trocar.is_connected", "the audience's page");
await audience.click("[data-to=folder]");
check(!await audience.isVisible("#device-choice"), "the audience can choose a device");
await audience.close();
const plain = await browser.open(given.plain_link);
await until(plain, `document.getElementById("start-scene").value !== ""`, "the page of a console without devices");
check(!await plain.isVisible("#device-choice"), "there is a choice without devices");
await plain.close();
await browser.finish();
