// SPDX-License-Identifier: Apache-2.0
// drive_review.mjs JSON: the pages of a review, as their reader uses them. The argument: {chromium, out, large, small, scans, queries: [{state,
// names}], different, by_bytes}. `large` is the address of a review of several pages, `small` that of one page that compares two stores.
// Prints {failures}; pictures go to the folder `out`.
import axe from "axe-core";
import { driver } from "./browser.mjs";

const kPerPage = 240, kRows = 50;  // cards of a page; rows that the table shows at first
const { given, browser } = await driver();
const same = (found, wanted, what) => browser.check(JSON.stringify(found) === JSON.stringify(wanted),
  `${what}: ${found.length} found, ${wanted.length} wanted; ${JSON.stringify(found).slice(0, 300)} instead of ${JSON.stringify(wanted).slice(0, 300)}`);

const rows = page => page.evaluate(() => [...document.querySelectorAll("table:not([hidden]) tbody tr")].map(row => row.cells[0].textContent));
const cards = page => page.evaluate(() => [...document.querySelectorAll(".card")].filter(card => card.checkVisibility()).map(({ id }) => id));
const count = page => page.locator("output").textContent();
const isInView = (page, id) => page.evaluate(id => {
  const { top, bottom } = [...document.querySelectorAll(".card")].find(card => card.id === id).getBoundingClientRect();
  return bottom > 0 && top < innerHeight;
}, id);

async function allRows(page) {
  await page.evaluate(() => {
    const more = [...document.querySelectorAll("button")].find(({ textContent }) => /more rows$/.test(textContent));
    while (!more.hidden) more.click();
  });
  return rows(page);
}

const control = (page, name) => page.getByRole("combobox", { name, exact: true });

async function choose(page, { name, show, sort, order }) {
  await page.getByLabel("Name contains").fill(name);
  await control(page, "Show").selectOption(show);
  await control(page, "Sort by").selectOption(sort);
  await control(page, "Order").selectOption(order);
}

async function accessible(page, name) {
  await page.evaluate(axe.source);
  for (const { id, nodes } of (await page.evaluate(() => window.axe.run(document, { resultTypes: ["violations"] }))).violations) {
    browser.fail(`${name}: axe finds ${id} at ${nodes.slice(0, 3).map(({ target, failureSummary }) => `${target} (${failureSummary})`).join("; ")}`);
  }
}

const page = await browser.open(given.large);
browser.check(await count(page) === `${given.scans.length} scans`, `the bar says ${await count(page)}`);
same(await cards(page), given.scans.slice(0, kPerPage), "the first page's cards");
browser.check(!(await page.locator("table").isVisible()), "a table before a search");
await browser.shot(page, "first_page");

for (const { state, names } of given.queries) {
  const what = JSON.stringify(state);
  await choose(page, state);
  same(await allRows(page), names, `${what}: rows`);
  const here = new Set(given.scans.slice(0, kPerPage));
  same(await cards(page), names.filter(name => here.has(name)), `${what}: cards`);
  browser.check(await count(page) === `${names.length} of ${given.scans.length} scans`, `${what}: the bar says ${await count(page)}`);
}

// The whole way by keyboard, a reload, and a result on another page.
await page.getByRole("button", { name: "Reset" }).click();
same(await rows(page), [], "the rows after a reset");
same(await cards(page), given.scans.slice(0, kPerPage), "the cards after a reset");
browser.check(!page.url().includes("#"), `the address after a reset is ${page.url()}`);
browser.check(await page.evaluate(() => document.activeElement.type === "search"), "after a reset the search has no focus");
await page.keyboard.type("head_4");
await page.keyboard.press("Tab");
await page.keyboard.press("ArrowDown");
for (let tabs = 0; tabs < 2; ++tabs) await page.keyboard.press("Tab");
await page.keyboard.press("ArrowDown");
const wanted = given.queries.find(({ state }) => state.show === "done").names.filter(name => name.includes("head_4")).reverse();
same(await rows(page), wanted.slice(0, kRows), "by keyboard");
await page.keyboard.press("Enter");
await browser.shot(page, "search");
await accessible(page, "search");
const address = page.url();
browser.check(address === `${given.large}#?name=head_4&show=done&order=down`, `the address is ${address}`);
await page.reload();
same(await rows(page), wanted.slice(0, kRows), "after a reload");
for (let tabs = 0; tabs < 40 && await page.evaluate(() => !document.activeElement.closest("tbody")); ++tabs) await page.keyboard.press("Tab");
await page.keyboard.press("Enter");
await page.waitForURL(url => url.hash === `#${wanted[0]}`);
browser.check(given.scans.indexOf(wanted[0]) >= kPerPage && page.url() !== `${given.large}#${wanted[0]}`, `the result ${wanted[0]} is on ${page.url()}`);
browser.check(await isInView(page, wanted[0]), `the card of ${wanted[0]} is not in view`);
browser.check(await page.locator("form").count() === 0, "a bar on a page without an index");
await accessible(page, "third page");
await page.goBack();
same(await rows(page), wanted.slice(0, kRows), "after going back");

// Odd names, and a fragment that nobody has checked.
await choose(page, { name: "_proto", show: "all", sort: "page", order: "up" });
same(await cards(page), ["__proto__"].filter(name => given.scans.indexOf(name) < kPerPage), "the card of __proto__");
await page.goto(`${given.large}#?show=nothing&sort=__proto__&order=&name=%3Cimg%3E`);
same(await rows(page), [], "a fragment that is wrong");
browser.check(await control(page, "Show").inputValue() === "all" && await control(page, "Sort by").inputValue() === "page", "wrong words of a fragment are taken");

// One page: its own cards are filtered and sorted. Links lead to cards and files.
const small = await browser.open(given.small);
same(await cards(small).then(found => found.slice(0, 2)), given.different, "those that differ come first");
await accessible(small, "small review");
await browser.shot(small, "small", { fullPage: true });
await control(small, "Show").selectOption("different");
same(await cards(small), given.different, "those that differ");
await choose(small, { name: "", show: "all", sort: "bytes", order: "down" });
same(await cards(small), given.by_bytes, "by bytes");
browser.check(await small.locator("caption", { hasText: "Found" }).count() === 0, "a table of pages in a review of one page");
browser.check(!(await small.locator("table").isVisible()), "the differences are shown during a search");
await small.goto(`${given.small}#second`);
browser.check(await control(small, "Sort by").inputValue() === "page", "the link to a card does not end the search");
await small.getByRole("link", { name: "second", exact: true }).click();
browser.check(await isInView(small, "second"), "a row of the differences does not lead to its card");
await small.getByRole("link", { name: "report of second" }).click();
await small.waitForURL(url => url.pathname.endsWith("/reports/second.json"));
browser.check((await small.locator("body").textContent()).includes('"triangles"'), "the link to the report shows something else");
await browser.finish();
