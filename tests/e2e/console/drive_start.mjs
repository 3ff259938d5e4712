// SPDX-License-Identifier: Apache-2.0
// drive_start.mjs JSON: opens the pages of a console with --start. The argument: {link, view_link, chromium}. Prints {failures}.
import { driver, set_hidden } from "./browser.mjs";

const { given, browser, until } = await driver();
const open = (link) => browser.open(link);

const audience = await open(given.view_link);
await until(audience, `trocar.is_connected && trocar.state.state === "idle"`, "the audience's page before the session");
await audience.waitForTimeout(500);
if (await audience.evaluate(`trocar.state.state !== "idle"`)) browser.fail("the audience's page started a session");
// A page that was hidden before any session comes back.
await set_hidden(audience, true);
await set_hidden(audience, false);
await audience.waitForTimeout(500);
await until(audience, `trocar.is_connected && document.getElementById("state").textContent === "Idle"`, "the page after it was hidden before any session");
const { origin, hash } = new URL(given.link);
const scene_to_start = async () => (await (await fetch(`${origin}/api/folder`, { headers: { authorization: `Bearer ${hash.slice(1)}` } })).json()).start;
if (!(await scene_to_start())) browser.fail("no scene to start before the first session");
const operator = await open(given.link);
await until(operator, `trocar.state.state === "running" && trocar.tab === "session" && trocar.row`, "the session that starts with the page");
const session = await operator.evaluate("trocar.session");
await operator.click("#stop");
await until(operator, `trocar.state.state === "ended"`, "the end of the session");
// Another scene is shown: the session that has ended is still said to have ended.
await operator.click(`nav [data-to="folder"]`);
await operator.evaluate(`{ const list = document.getElementById("start-scene"); list.value = [...list.options].find(({ value }) => value !== list.value).value; list.dispatchEvent(new Event("change")); }`);
await until(operator, `!trocar.row`, "the bone of another scene");
await until(operator, `document.getElementById("state").textContent === "Ended"`, "the state after another scene is shown");
await operator.reload();
await until(operator, `trocar.is_connected`, "the page after a reload");
await operator.waitForTimeout(500);
if (await operator.evaluate(`trocar.state.state !== "ended" || trocar.session !== ${JSON.stringify(session)}`)) browser.fail("a reload of the page started another session");
if (await scene_to_start()) browser.fail("a page may start the scene of --start again");
await browser.finish();
