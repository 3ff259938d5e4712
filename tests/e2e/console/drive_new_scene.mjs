// SPDX-License-Identifier: Apache-2.0
// drive_new_scene.mjs JSON: entry and target by clicks, and the scene that the console makes of them, in the console's page. The argument:
// {link, view_link, out, entry, beside}; `entry` is a position in {B} on the topmost slice, and
// `beside` one on the bone 18 mm below that slice. Prints one JSON object: {failures, chosen}, where
// `chosen` has the texts of the points at each step.
import { driver } from "./browser.mjs";

const chosen = {};
const { given, browser, check } = await driver({ chosen });
const page = await browser.open(given.link);
const get = (expression) => page.evaluate(expression);
const until = (expression, what, timeout) => browser.until(page, expression, what, timeout);
const words = () => page.innerText("#plan-words");
const texts = async () => ({ entry: await page.inputValue("#plan-entry"), target: await page.inputValue("#plan-target"), depth: await page.inputValue("#plan-depth") });
const fill = async (name, text) => {
  await page.fill(`#plan-${name}`, text);
  await page.keyboard.press("Tab");
};
const numbers = (text) => text.split(", ").map(Number);

/// Clicks at a pixel of the view.
async function click_at([x, y]) {
  const box = await page.locator("#canvas").boundingBox();
  await page.mouse.click(box.x + x, box.y + y);
}
const pixel_of = (at_m) => get(`trocar.pixel_of(${JSON.stringify(at_m)})`);

await until("trocar.bone_shown_ms !== null", "the bone");
await page.selectOption("#start-scene", "scenes/vertebra.json");
await until("trocar.slices.length === 35", "the vertebra");

// ---- before any point ----
check(await page.isHidden("#plan-bar"), "the bar of a new scene is there before it was asked for");
await click_at(await pixel_of(given.entry));
check(!(await get("trocar.planning.points.entry")), "a click without a new scene sets a point");
await page.click("#plan-open");
check(/Click on the bone where the needle enters/.test(await words()) && await page.isDisabled("#plan-make"), `at first: ${await words()}`);

// ---- the entry by a click on a slice seen from above ----
await page.click("[data-view=section]");
await page.waitForTimeout(300);
await click_at(await pixel_of(given.entry));
await until("trocar.planning.points.entry", "the entry");
chosen.section = await texts();
const entry = await get("trocar.planning.points.entry");
check(Math.hypot(...entry.map((x, k) => x - given.entry[k])) < 3e-4, `clicked at ${given.entry}, the entry is ${entry}`);
check(/at the target/.test(await words()) && await page.getAttribute("#plan-pick-target", "aria-pressed") === "true", `after the entry: ${await words()}`);
await fill("depth", "18");
await until("trocar.planning.points.target", "the target by its depth");
const below = await get("trocar.planning.points.target");
check(Math.hypot(below[0] - entry[0], below[1] - entry[1], below[2] - entry[2] + 0.018) < 1e-9, `18 mm below ${entry} is ${below}`);
await browser.picture(page, "section");
// The cross-section is at the target now, and a click moves it there; the second click of a double click does nothing.
const { beside } = given;
await until(`Math.abs(trocar.section_z_m - ${below[2]}) < 1.1e-3`, "the cross-section at the target, in the next frame");
const canvas = await page.locator("#canvas").boundingBox(), [bx, by] = await pixel_of(beside);
await page.mouse.dblclick(canvas.x + bx, canvas.y + by);
const moved = await get("trocar.planning.points");
check(Math.hypot(moved.target[0] - beside[0], moved.target[1] - beside[1]) < 3e-4 && JSON.stringify(moved.entry) === JSON.stringify(entry), `a double click at ${beside}, pixel ${[bx, by]} of ${JSON.stringify(canvas)}, where there is ${JSON.stringify(await get(`trocar.pick(${bx}, ${by})`))}, gives ${JSON.stringify(moved)}`);
await fill("target", "");
await fill("depth", "18");
await page.waitForTimeout(400);

// ---- the target by a click in a plane of the CT: 10 mm to the patient's left, 5 mm to the head ----
await page.click("[data-picture=ct]");
await until("trocar.imaging.why === ''", "the planes of the CT", 60000);
await page.waitForTimeout(800);
await page.setViewportSize({ width: 1920, height: 1080 });  // a click is at a whole pixel, which is less than 0.6 mm there
await page.waitForTimeout(800);
const before = numbers((await texts()).target), plane = await page.locator("#ct-coronal").boundingBox();
const per_mm = Math.min(plane.width, plane.height) / 80;
await page.mouse.click(plane.x + plane.width / 2 + 10 * per_mm, plane.y + plane.height / 2 - 5 * per_mm);
await page.waitForTimeout(300);
const after = numbers((await texts()).target);
check(Math.abs(after[0] - before[0] - 10) < 0.6 && Math.abs(after[1] - before[1]) < 0.2 && Math.abs(after[2] - before[2] - 5) < 0.6, `a click in the coronal plane moves the target from ${before} to ${after}`);
await page.setViewportSize({ width: 1280, height: 720 });
await page.waitForTimeout(400);
await browser.picture(page, "planes");
await page.click("[data-picture=ct]");

// ---- the entry on the surface, in perspective; a drag turns the view and sets nothing ----
await page.click("[data-view=perspective]");
await page.waitForTimeout(500);
await page.click("#plan-pick-entry");
await page.waitForTimeout(400);
const box = await page.locator("#canvas").boundingBox(), middle = [Math.round(box.width / 2), Math.round(box.height / 2)];
await click_at(middle);
await page.waitForTimeout(300);
const on_surface = await get("trocar.planning.points.entry"), drawn = await pixel_of(on_surface);
check(Math.hypot(drawn[0] - middle[0], drawn[1] - middle[1]) < 1, `a click at ${middle} sets a point that is drawn at ${drawn}`);
await page.mouse.move(box.x + middle[0], box.y + middle[1] + 40);
await page.mouse.down();
await page.mouse.move(box.x + middle[0] + 60, box.y + middle[1] + 40, { steps: 5 });
await page.mouse.up();
check(JSON.stringify(await get("trocar.planning.points.entry")) === JSON.stringify(on_surface), "a drag sets the entry");

// ---- points by their numbers; what no needle can do, in words ----
await fill("entry", "one, two");
await until("/one, two: a point is three numbers in mm/.test(trocar.words)", "the refusal of a point");
check(await page.inputValue("#plan-entry") === "one, two" && await page.isDisabled("#plan-make"), "a point that is refused is emptied, or can be made into a scene");
await fill("entry", "5000, 0, 0");
await fill("target", "");
await page.fill("#plan-name", "nowhere");
await page.click("#plan-make");
await until("!trocar.planning.is_making && trocar.planning.result", "the answer about a point outside", 60000);
check(/the needle meets no bone there/.test(await page.innerText("#plan-verdict")), `an entry outside of the bone: ${await page.innerText("#plan-verdict")}`);
await browser.picture(page, "refused");

// ---- the scene ----
await fill("entry", chosen.section.entry);
await fill("depth", "15");
await page.fill("#plan-name", "../x");
check(await page.isDisabled("#plan-make"), "a name that leads out of the folder can be made");
await page.fill("#plan-name", "clicked");
chosen.made = await texts();
await page.click("#plan-make");
await until("trocar.planning.is_making", "the making");
check(await page.isVisible("#plan-stop") && await page.isDisabled("#plan-close"), "a scene that is being made cannot be stopped");
await browser.picture(page, "making");
await until("!trocar.planning.is_making && trocar.planning.result?.scene === 'clicked.json'", "the scene", 120000);
check(/clicked.json is written and chosen. The check found nothing wrong./.test(await page.innerText("#plan-verdict")), `the verdict: ${await page.innerText("#plan-verdict")}`);
check(await page.inputValue("#start-scene") === "clicked.json" && await page.inputValue("#plan-name") === "clicked-2", "the new scene is not chosen, or no new name is proposed");
const kept = await texts();
check(kept.entry === chosen.made.entry && kept.target === chosen.made.target, `the points are gone: ${JSON.stringify(kept)}`);
await browser.picture(page, "made");
await browser.accessible(page, "made");
await browser.sizes(page, "made");

// ---- its slices, and a session with it ----
await page.fill("#start-duration", "2");
await page.click("#start");
await until("trocar.row && trocar.row.t_s[0] > 0.1", "the session of the new scene");
await until("trocar.goals.list.map(({ goal }) => goal).join() === 'target,entry,corridor'", "the goals of the new scene");
check(await page.isHidden("#plan-bar"), "the bar of a new scene stays in a session");
await browser.picture(page, "session");
await until("trocar.state.state === 'ended'", "its end");

// ---- after a session, on the same scene; a tab that is left while a scene is made ----
await page.click("[data-to=folder]");
await page.click("#plan-open");
await until("/Click on the bone/.test(document.getElementById('plan-words').textContent)", "points on the scene whose session has ended");
await fill("entry", chosen.section.entry);
await fill("target", chosen.section.entry);
check(/must lie below the entry/.test(await words()) && await page.isDisabled("#plan-make"), `a target at the entry: ${await words()}`);
await fill("target", "");
await page.fill("#plan-name", "elsewhere");
await page.click("#plan-make");
await page.click("[data-to=playback]");
check(await page.isHidden("#plan-bar"), "the bar of a new scene is there in playback");
await until("!trocar.planning.is_making && !trocar.planning.is_open", "the end of the making in another tab", 120000);

// ---- an asset without a scene; a scene whose slices do not lie as in the scan ----
await page.click("[data-to=folder]");
await page.selectOption("#start-scene", "scenes/apart.json");
await until("trocar.slices.length === 3", "the slices far apart");
await page.click("#plan-open");
await until("/do not lie as in the scan/.test(document.getElementById('plan-words').textContent)", "why no points can be chosen");
check(await page.isDisabled("#plan-make"), "a scene can be made of no points");
await page.click("#plan-close");
await page.locator("#assets button", { hasText: "New scene" }).first().click();
check(/thickest/.test(await words()) && await page.isHidden("#plan-points"), `of an asset: ${await words()}`);
await page.fill("#plan-name", "thickest");
await page.uncheck("#plan-live");
await page.click("#plan-make");
await until("!trocar.planning.is_making && trocar.planning.result?.scene === 'thickest.json'", "the scene of an asset", 120000);
check(/Click on the bone/.test(await words()), `on the new scene points can be chosen: ${await words()}`);
await browser.picture(page, "of_asset");

// ---- an audience makes nothing ----
const audience = await browser.open(given.view_link);
await browser.until(audience, "trocar.bone_shown_ms !== null", "the audience's page");
check(await audience.isHidden("#plan-open") && !(await audience.locator("#assets button").count()), "an audience is offered a new scene");

await browser.finish();
