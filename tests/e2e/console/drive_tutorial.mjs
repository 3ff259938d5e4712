// SPDX-License-Identifier: Apache-2.0
// drive_tutorial.mjs JSON: the tutorial's step in the console, as its reader does it. The argument: {link, view_link, chromium, out}. Prints
// {failures}; the tutorial's two pictures go to the folder `out`.
import { driver, seek } from "./browser.mjs";

const { given, browser, check, until } = await driver();

const page = await browser.open(given.link);
await until(page, "trocar.bone_shown_ms !== null", "the bone of the first scene");
await page.click("[data-to=folder]");
await page.selectOption("#start-scene", "puncture.json");
await page.click("#start");
await until(page, `trocar.row && trocar.row.t_s[0] > 0.1 && Math.abs(trocar.row.tip_N[0]) > 28`, "a force of 28 N");
await browser.picture(page, "tutorial_session");
await until(page, `trocar.events.some(({ kind }) => kind === "puncture")`, "the puncture");
const { text } = await page.evaluate(`trocar.events.find(({ kind }) => kind === "puncture")`);
check(/^slice 101 punctured .*N at the tip, .*N on the hand/.test(text), `the event says ${text}`);
await until(page, `trocar.state.state === "ended"`, "the end");

await page.click("[data-to=folder]");
await page.locator("#recordings").getByText("Play", { exact: true }).first().click();
await until(page, "trocar.playback.end_s > 3", "the recording");
await seek(page, 0.92);
await page.waitForTimeout(700);
await browser.picture(page, "tutorial_playback");

await browser.finish();
