// SPDX-License-Identifier: Apache-2.0
// drive_imaging.mjs JSON: X-ray and planes of the CT in the console's page. The argument: {link, view_link, chromium, out, scene, apart,
// foreign}; `scene` is a scene whose asset has a context volume, `apart` one that has no X-ray, and `foreign` a recording whose scene is not in
// the folder. Prints one JSON object: {failures, figures, sessions}.
import { driver, events_of, seek, set_hidden } from "./browser.mjs";

const figures = {}, sessions = {};  // a session: {recording, shots, screening_s}
const { given, browser, check, until, get } = await driver({ figures, sessions }, 20000);
const counts = `({ shots: trocar.row.xray_shots[0], screening_s: trocar.row.xray_screening_s[0], words: document.getElementById("xray-count").textContent })`;

async function stop(page, name) {
  await page.keyboard.press("Shift+Q");
  await until(page, `trocar.state.state === "ended" && trocar.row.ended[0] === 1`, `the end of ${name}`);
  const counted = await get(page, counts);
  sessions[name] = { recording: (await get(page, "trocar.state")).recording, ...counted };
}
/// Grey levels of a canvas: darkest, lightest, and their sum.
const greys = (page, id) => page.evaluate((canvas_id) => {
  const canvas = document.getElementById(canvas_id), { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let [low, high, sum] = [255, 0, 0];
  for (let i = 0; i < data.length; i += 4) [low, high, sum] = [Math.min(low, data[i]), Math.max(high, data[i]), sum + data[i]];
  return { low, high, sum, size: canvas.width };
}, id);
/// Mean difference of the grey levels of two canvases of one size.
const difference = (page, ids) => page.evaluate((canvas_ids) => {
  const [a, b] = canvas_ids.map((id) => document.getElementById(id)).map((canvas) => canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data);
  return a.length === b.length ? a.reduce((sum, level, i) => sum + Math.abs(level - b[i]), 0) / (a.length * 3 / 4) : Infinity;
}, ids);
/// Presses the key X and waits for the picture; the time that it took, ms.
async function shot(page, what) {
  const [drawn, began] = await get(page, "[trocar.imaging.drawn, performance.now()]");
  await page.keyboard.press("x");
  await until(page, `trocar.imaging.drawn > ${drawn}`, `the picture of ${what}`);
  return await get(page, "performance.now()") - began;
}

const page = await browser.open(given.link);
await until(page, "trocar.bone_shown_ms !== null", "the bone of the first scene");
await browser.start(page, given.scene);

// ---- shots ----
await page.click("[data-picture=xray]");
await until(page, "trocar.imaging.positions >= 1", "the first sum along the rays");
check(await get(page, "trocar.imaging.has_context"), "the asset's context is not used");
check(await get(page, "trocar.imaging.drawn") === 0, "a picture was shown before one was taken");
figures.ap_ms = await shot(page, "AP");
const is_fine = `document.getElementById("xray-live").width > 200`;  // the first picture of a position may be a coarse one
await until(page, is_fine, "the fine AP picture");
const ap = await greys(page, "xray-live");
check(ap.low < 60 && ap.high > 180, `the AP picture has grey levels ${ap.low} to ${ap.high}`);
check((await page.innerText("#xray-live-caption")).includes("AP"), "the caption of the AP picture");
await page.click("#xray-lateral");
figures.lateral_ms = await shot(page, "the lateral picture");
await until(page, is_fine, "the fine lateral picture");
const kept = await greys(page, "xray-other");
check(Math.abs(kept.sum - ap.sum) < 1, "the second monitor does not keep the AP picture");
const apart = await difference(page, ["xray-live", "xray-other"]);  // the noise of two shots from one position is below 2
check(apart > 10 && apart < 256, `the lateral picture differs from the AP picture by ${apart} grey levels`);
check((await page.innerText("#xray-live-caption")).includes("Lateral"), "the lateral picture is the AP picture");
await page.fill("#xray-turn", "30");
await page.fill("#xray-tilt", "-20");
await page.keyboard.press("Tab");
figures.free_ms = await shot(page, "a free position");
check((await page.innerText("#xray-live-caption")).includes("30° turned, -20° tilted"), "the caption of a free position");
await until(page, "trocar.row.xray_shots[0] === 3", "the count of three shots");
check((await get(page, counts)).shots === 3, `${JSON.stringify(await get(page, counts))} after three shots`);
await browser.picture(page, "xray");
await browser.accessible(page, "xray");
// A letter in a list chooses an entry, and takes no picture. Only the main button of the mouse screens, and a finger may move on the button.
await page.focus("#ghost");
await page.keyboard.press("x");
await page.locator("#xray-screen").click({ button: "right", delay: 300 });
await page.evaluate(() => document.activeElement.blur());
await page.waitForTimeout(500);
check((await get(page, counts)).shots === 3, "a letter in a list took a picture");
check(await get(page, `${events_of("xray_on")} === 0`), "the right button of the mouse screened");
const touch_action = await get(page, `getComputedStyle(document.getElementById("xray-screen")).touchAction`);
check(touch_action === "none", "a finger that moves on the button would end screening");

// ---- screening ----
await page.click("#xray-ap");
await until(page, "trocar.imaging.positions >= 3", "the sums of three positions");
await page.keyboard.down("c");
await until(page, "trocar.imaging.is_screening", "screening");
const first = await get(page, "[trocar.imaging.drawn, performance.now()]");
await page.waitForTimeout(2000);
const second = await get(page, "[trocar.imaging.drawn, performance.now()]");
figures.pictures_per_s = 1000 * (second[0] - first[0]) / (second[1] - first[1]);
check(second[0] - first[0] >= 10, `${second[0] - first[0]} pictures in 2 s of screening`);
await browser.picture(page, "screening");
await page.keyboard.up("c");
await until(page, "!trocar.imaging.is_screening", "the end of screening");
await until(page, `${events_of("xray_shot")} === 3 && ${events_of("xray_on")} >= 1 && ${events_of("xray_off")} === ${events_of("xray_on")}`, "the events of X-ray");
await page.waitForTimeout(600);
const after = await get(page, counts);
check(after.screening_s > 1.9 && after.shots === 3, `${JSON.stringify(after)} after screening`);
check(after.words.includes("3 shots") && after.words.includes(`${after.screening_s.toFixed(1)} s`), `the page counts "${after.words}"`);
// The key is up when the window has lost the focus, and X-ray ends by itself when the page is silent.
await page.keyboard.down("c");
await until(page, "trocar.imaging.is_screening", "screening again");
await page.evaluate(() => { dispatchEvent(new Event("blur")); });
await until(page, "!trocar.imaging.is_screening", "the end of screening by blur");
await page.keyboard.up("c");
await page.evaluate(() => { window.real_fetch = window.fetch; });
await page.keyboard.down("c");
await until(page, "trocar.imaging.is_screening", "screening a third time");
await page.evaluate(() => { window.fetch = () => new Promise((_, fail) => setTimeout(() => fail(new Error("no answer")), 3000)); });  // nothing arrives any more
await until(page, "!trocar.imaging.is_screening", "the end of screening whose page is silent");
await page.keyboard.up("c");
await page.waitForTimeout(3200);
await page.evaluate(() => { window.fetch = window.real_fetch; });
// In a pause X-ray is off, however long the key is held.
await page.keyboard.down("c");
await until(page, "trocar.imaging.is_screening", "screening before a pause");
await page.click("#pause");
await until(page, `trocar.state.state === "paused" && !trocar.imaging.is_screening`, "the end of screening in a pause");
const in_pause = await get(page, "trocar.imaging.drawn");
await page.waitForTimeout(700);
check(await get(page, "trocar.imaging.drawn") === in_pause, "pictures in a pause");
await page.keyboard.up("c");
await page.click("#pause");
await until(page, `trocar.state.state === "running" && trocar.row.safety[0] === 2`, "going on after the pause");
await page.waitForTimeout(300);
check(!await get(page, "trocar.imaging.is_screening"), "X-ray is on after a pause in which the key was released");

// ---- the needle's place ----
await shot(page, "AP again");
const place = await get(page, "({ tip: trocar.imaging.tip_px, size: document.getElementById('xray-live').width })");
check(place.tip?.every((x) => x > 0 && x < place.size), `the tip is at ${place.tip} of ${place.size} pixels`);

// ---- the audience ----
const before = await get(page, events_of("xray_shot"));
const viewer = await browser.open(given.view_link, { viewport: { width: 1920, height: 1080 } });
await until(viewer, "trocar.row !== null", "the audience's page");
await viewer.click("[data-picture=ct]");
await until(viewer, "trocar.imaging.is_ready", "the scan on the audience's page");
await viewer.click("[data-picture=xray]");
await until(viewer, "trocar.imaging.positions >= 1", "the audience's sum along the rays");
check(!await viewer.isVisible("#xray-shot"), "the audience has a button for shots");
await viewer.keyboard.press("x");
await viewer.waitForTimeout(300);
check(await get(page, events_of("xray_shot")) === before, "the audience took a picture");
await page.click("#xray-ap");
await shot(page, "a picture that two pages show");
await until(viewer, "trocar.imaging.drawn >= 1", "the picture on the audience's page");
// The monitor is large enough for the fine picture, although its size was not known when the scan came.
check(await get(viewer, `document.getElementById("xray-live").clientWidth * devicePixelRatio > 300`), "the audience's monitor is small");
await until(viewer, `document.getElementById("xray-live").width === 512`, "the picture for a large monitor");
// A page that was hidden during a shot, when it draws no frames, does not show it with the needle of another time.
await viewer.evaluate(() => {
  window.real_frame = window.requestAnimationFrame;
  window.waiting_frames = [];
  window.requestAnimationFrame = (next) => window.waiting_frames.push(next);
});
await set_hidden(viewer, true);
const [hidden_drawn, hidden_shots] = await get(viewer, `[trocar.imaging.drawn, ${events_of("xray_shot")}]`);
await shot(page, "a picture that one page misses");
await page.waitForTimeout(2500);
await viewer.evaluate(() => {
  window.requestAnimationFrame = window.real_frame;
  for (const next of window.waiting_frames) requestAnimationFrame(next);
});
await set_hidden(viewer, false);
await until(viewer, `${events_of("xray_shot")} === ${hidden_shots + 1}`, "the missed shot on the audience's page");
await viewer.waitForTimeout(1000);
check(await get(viewer, "trocar.imaging.drawn") === hidden_drawn, "a shot was shown with the needle of another time");
await shot(page, "a picture after the page was hidden");
await until(viewer, `trocar.imaging.drawn > ${hidden_drawn}`, "a picture on the audience's page after it was hidden");
await viewer.close();

// ---- planes of the CT ----
await page.click("[data-picture=ct]");
await page.waitForTimeout(800);
for (const name of ["coronal", "sagittal", "needle"]) {  // the tip is above the bone, where the axial plane has nothing
  const grey = await greys(page, `ct-${name}`);
  check(grey.high - grey.low > 100, `the ${name} plane has grey levels ${grey.low} to ${grey.high}`);
}
const words = await page.innerText("#ct-words");
check(/HU (stored )?at the tip; needle points \d+° to the (head|feet), \d+° to the patient's (left|right); [\d.]+ mm (above|below) the first slice/.test(words), `below the planes stands "${words}"`);
const bone = await greys(page, "ct-coronal");
await page.selectOption("#ct-preset", "40 400");
await page.waitForTimeout(600);
check((await greys(page, "ct-coronal")).sum !== bone.sum && await page.inputValue("#ct-window") === "400", "the window for soft tissue");
await browser.picture(page, "ct");
await browser.accessible(page, "ct");
await browser.sizes(page, "ct");
await page.click("[data-picture=xray]");
await browser.sizes(page, "xray");
await page.keyboard.down("c");
await until(page, "trocar.imaging.is_screening", "screening before the end");
await stop(page, "vertebra");
check(!await get(page, "trocar.imaging.is_screening"), "X-ray is on after the end");

// ---- a hundred shots ----
await browser.start(page, given.scene);
await until(page, "trocar.imaging.is_ready && trocar.imaging.positions >= 1", "the sum along the rays of the second session");
check(await get(page, "trocar.row.xray_shots[0] === 0 && !trocar.imaging.is_screening"), "the second session began with X-ray");
await page.keyboard.up("c");
for (let i = 0; i < 100; ++i) {
  await page.keyboard.press("x");
  await page.waitForTimeout(60);
}
await until(page, `${events_of("xray_shot")} === 100`, "a hundred shots");
await until(page, "trocar.row.xray_shots[0] === 100", "a hundred shots in the snapshot");
await stop(page, "hundred");

// ---- playback ----
await page.click("#ended-play");
await until(page, `trocar.tab === "playback" && trocar.playback.end_s > 0`, "playback");
await until(page, "trocar.imaging.positions >= 1", "the sum along the rays in playback");
await seek(page, 1);
await until(page, "trocar.playback_row.xray_shots?.[0] === 100", "a hundred shots at the end of the playback");
check(await page.isDisabled("#xray-shot"), "a picture can be taken in playback");
await until(page, `document.getElementById("xray-count").textContent.includes("100 shots")`, "the count in playback");
const drawn = await get(page, "trocar.imaging.drawn");
await seek(page, 0.1);
await until(page, `trocar.imaging.drawn > ${drawn}`, "the picture at another time of the playback");
await browser.picture(page, "playback");
// The scan of one recording is not shown with another one whose scene is not in the folder.
await page.click("[data-to=folder]");
await page.locator("#recordings li", { hasText: given.foreign }).getByRole("button", { name: "Play" }).click();
await until(page, `trocar.tab === "playback" && trocar.playback.file === "${given.foreign}"`, "the playback without a scene");
await until(page, "trocar.imaging.positions === 0", "the end of the pictures of another scan");
await page.waitForTimeout(500);
check((await greys(page, "xray-live")).high === 0, "a recording without a scene has an X-ray");
await until(page, `document.getElementById("xray-count").textContent === "No scan is loaded."`, "the words without a scan");

// ---- no X-ray ----
await page.click("[data-to=folder]");
await browser.start(page, given.apart);
await until(page, `trocar.imaging.why.includes("not as far apart")`, "the reason why there is no X-ray");
await until(page, `document.getElementById("xray-shot").disabled`, "no button for a picture without X-ray");
await until(page, `document.getElementById("xray-count").textContent.includes("not as far apart")`, "the words without X-ray");
await browser.picture(page, "no_xray");
await stop(page, "apart");
await browser.finish();
