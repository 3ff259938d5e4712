// SPDX-License-Identifier: Apache-2.0
// drive_outside.mjs JSON: a page for which the console has no place, one behind a tunnel, and one whose console has a full disk. The
// argument: {full_link, full_view_link, tunnel, disk_link or null, chromium, out}. Prints {failures}.
import { driver, pill } from "./browser.mjs";

const { given, browser, check, until } = await driver();

// ---- sixteen pages of an audience ----
const seventeenth = await browser.open(given.full_view_link);
await until(seventeenth, `${pill} === "No place"`, "the page of a seventeenth audience");
await browser.accessible(seventeenth, "no_place");
const operator = await browser.open(given.full_link);
await until(operator, `trocar.is_connected && trocar.role === "operator"`, "the operator's page beside sixteen of an audience");

// ---- a tunnel whose ports differ ----
const tunnel = await browser.open(given.tunnel);
const words = await tunnel.innerText("body");
check(/--public-url/.test(words) && /ssh -L/.test(words) && !words.startsWith("{"), `through a tunnel the browser shows ${words}`);

// ---- a full disk ----
if (given.disk_link) {
  const page = await browser.open(given.disk_link);
  await page.click("[data-to=folder]");
  await page.selectOption("#start-scene", "scenes/three_slices.json");
  await page.fill("#start-duration", "30");
  await page.click("#start");
  await until(page, `trocar.state.state === "ended"`, "the end by a full disk", 60000);
  check(/disk/.test(await page.evaluate("trocar.words")), `of a full disk the page says ${await page.evaluate("trocar.words")}`);
  check(await page.evaluate(`document.getElementById("status").dataset.level`) === "bad", "a full disk is not shown in red");
  await browser.accessible(page, "full_disk");
  await browser.sizes(page, "full_disk");
}
await browser.finish();
