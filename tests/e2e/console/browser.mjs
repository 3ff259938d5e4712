// SPDX-License-Identifier: Apache-2.0
// A headless Chromium with the console's page, for drivers: opening, waiting, pictures. Failures are collected, and reported at the end.
import axe from "axe-core";
import { chromium } from "playwright-core";
import { layout_faults } from "./layout.mjs";

const kArguments = ["--no-sandbox", "--use-gl=angle", "--use-angle=gl-egl", "--ignore-gpu-blocklist", "--disable-background-timer-throttling"];

/// Pictures are for people: without TROCAR_PICTURES none are taken, and only what they would show is checked.
const kTakesPictures = Boolean(process.env.TROCAR_PICTURES);
const kSizes = [[390, 844], [844, 390], [1024, 768], [1280, 720], [1920, 1080], [3840, 2160]];

export class Browser {
  failures = [];

  /// `given`: {chromium, out}. `out` is the folder of the pictures. `results`: what a driver prints besides its failures.
  static async launch(given, results = {}) {
    const made = new Browser();
    made.given = given;
    made.results = results;
    // The failures so far are reported even if a step throws.
    process.on("uncaughtException", (error) => {
      made.fail(`the driver stopped: ${error.stack}`);
      made.report();
      process.exit(0);
    });
    made.browser = await chromium.launch({ executablePath: given.chromium, args: kArguments });
    return made;
  }

  report() { console.log(JSON.stringify({ failures: this.failures, ...this.results })); }

  async finish() {
    await this.browser.close();
    this.report();
  }

  /// Failures are also printed at once, in case the driver is stopped.
  fail(words) {
    this.failures.push(words);
    console.error(words);
  }
  check(condition, words) { if (!condition) this.fail(words); }

  /// Opens a link in a browser window of its own. `context`: playwright's options of that window. The page may only ask for what the link's
  /// server has, or for a file in the link's folder or below.
  async open(link, context = {}) {
    const { origin } = new URL(link), allowed = origin === "null" ? new URL(".", link).href : origin;
    const page = await (await this.browser.newContext({ viewport: { width: 1280, height: 720 }, colorScheme: "dark", ...context })).newPage();
    page.setDefaultTimeout(30000);
    page.on("pageerror", (error) => this.fail(`the page threw: ${error.stack}`));
    page.on("request", (request) => this.check(request.url().startsWith(allowed) || /^(blob|data):/.test(request.url()), `the page asked for ${request.url()}`));
    await page.goto(link);
    return page;
  }

  /// Waits until the expression over the page's test view is true. (The page's policy forbids playwright's own way.)
  async until(page, expression, what, timeout_ms = 30000) {
    for (const end = Date.now() + timeout_ms; Date.now() < end; await page.waitForTimeout(20)) if (await page.evaluate(expression)) return true;
    this.fail(`${what}: did not happen within ${timeout_ms / 1000} s; the page says "${await page.evaluate("trocar.words")}" and ${JSON.stringify(await page.evaluate("trocar.hand"))}`);
    return false;
  }

  /// Starts a session of a scene from the form, with these entries of its other lists, and waits until `begun` is true of it.
  async start(page, scene, { select = {}, seconds, begun = `trocar.state.state === "running" && trocar.row?.safety[0] === 2` } = {}) {
    await page.click("[data-to=folder]");
    for (const [name, value] of Object.entries({ scene, ...select })) await page.selectOption(`#start-${name}`, value);
    if (seconds) await page.fill("#start-duration", String(seconds));
    const before = await page.evaluate("trocar.session");
    await page.click("#start");
    await this.until(page, `trocar.session !== ${JSON.stringify(before)} && ${begun}`, `the start of ${scene}`);
  }

  async shot(page, name, options = {}) {
    if (kTakesPictures) await page.screenshot({ path: `${this.given.out}/${name}.png`, ...options });
  }
  /// Lets motions of the view end before a picture; without pictures only the layout.
  settle(page, ms) {
    return kTakesPictures ? page.waitForTimeout(ms) : page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  }

  /// Takes a picture, and checks that no text is cut off or covered. `is_scrolled`: a small window in which panels are below its edge.
  async picture(page, name, is_scrolled = false) {
    await this.shot(page, name);
    for (const fault of await page.evaluate(layout_faults)) if (!is_scrolled || !/not to be seen|outside of the window/.test(fault)) this.fail(`${name}: ${fault}`);
  }

  /// Lets axe check the page in both themes: roles, names, contrast.
  async accessible(page, name) {
    for (let theme = 0; theme < 2; ++theme) {
      await page.evaluate(axe.source);
      const violations = await page.evaluate(async () => (await window.axe.run(document, { resultTypes: ["violations"], iframes: false })).violations
        .map(({ id, nodes }) => `${id} at ${nodes.map(({ target, failureSummary }) => `${target} (${failureSummary})`).slice(0, 3).join("; ")}`));
      for (const violation of violations) this.fail(`${name}, theme ${await page.evaluate("document.documentElement.dataset.theme")}: axe finds ${violation}`);
      await page.click("#theme");
    }
  }

  /// Takes a picture at every size that the page supports, and as two colour vision deficiencies see it. At each size the emergency stop is
  /// on the screen, nothing is wider than it, no text is cut off or covered, and text has one size, so that the browser's zoom enlarges it.
  async sizes(page, name) {
    const before = page.viewportSize(), size_of_text = await page.evaluate("getComputedStyle(document.body).fontSize");
    for (const [width, height] of kSizes) {
      await page.setViewportSize({ width, height });
      await this.settle(page, 300);
      await this.shot(page, `${name}_${width}x${height}`);
      const found = await page.evaluate(() => {
        const { left, right, top, bottom } = document.getElementById("emergency").getBoundingClientRect();
        return { is_there: left >= 0 && top >= 0 && right <= innerWidth && bottom <= innerHeight && right > left, wide: document.documentElement.scrollWidth - innerWidth,
          text: getComputedStyle(document.body).fontSize };
      });
      this.check(found.is_there, `${name} at ${width} x ${height}: the emergency stop is not on the screen`);
      this.check(found.text === size_of_text, `${name} at ${width} x ${height}: text has ${found.text} and ${size_of_text} elsewhere`);
      this.check(found.wide <= 0, `${name} at ${width} x ${height}: the page is ${found.wide} px too wide`);
      for (const fault of await page.evaluate(layout_faults)) if (!/outside of the window/.test(fault)) this.fail(`${name} at ${width} x ${height}: ${fault}`);
    }
    await page.setViewportSize(before);
    if (!kTakesPictures) return;
    const session = await page.context().newCDPSession(page);
    for (const type of ["deuteranopia", "tritanopia"]) {
      await session.send("Emulation.setEmulatedVisionDeficiency", { type });
      await page.screenshot({ path: `${this.given.out}/${name}_${type}.png` });
    }
    await session.send("Emulation.setEmulatedVisionDeficiency", { type: "none" });
    await session.detach();
  }
}

/// What each driver needs: its argument, the browser, and short names for what it does most. `results` is printed besides the failures.
export async function driver(results = {}, patience_ms = 30000) {
  const given = JSON.parse(process.argv[2]), browser = await Browser.launch(given, results);
  return {
    given, browser,
    check: (condition, words) => browser.check(condition, words),
    until: (page, expression, what, timeout_ms = patience_ms) => browser.until(page, expression, what, timeout_ms),
    get: (page, expression) => page.evaluate(expression),
  };
}

/// The page's word for the state of the session.
export const pill = `document.getElementById("state").textContent`;

export const events_of = (kind) => `trocar.events.filter((event) => event.kind === "${kind}").length`;

/// The page goes into the background, or comes back.
export const set_hidden = (page, is_hidden) => page.evaluate((hidden) => {
  if (hidden) Object.defineProperty(document, "hidden", { configurable: true, get: () => true });
  else delete document.hidden;
  document.dispatchEvent(new Event("visibilitychange"));
}, is_hidden);

/// Moves the playback to this part of the recording.
export const seek = (page, part) => page.evaluate((value) => {
  const slider = document.getElementById("seek");
  slider.value = String(value);
  slider.dispatchEvent(new Event("input"));
}, Math.round(1000 * part));
