// SPDX-License-Identifier: GPL-3.0-or-later
// Draws a page of a review from the JSON that review.cpp writes.
const review = data("review");

const short = (value) => number(value, 4);
const signed = (value) => (value > 0 ? "+" : "") + short(value);
const increase = (difference, field) => signed(difference[field] - difference[`${field}_before`]);

// The address of a page of this review, or of a card on it.
const pageAddress = (page, scan) => encodeURIComponent(review.pages[page]) + (scan === undefined ? "" : `#${encodeURIComponent(scan)}`);

function pageLinks(name) {
  if (review.pages.length === 1) return [];
  const links = review.pages.flatMap((file, k) => [k === review.page ? element("b", {}, k + 1) : element("a", { href: pageAddress(k) }, k + 1), " "]);
  return [element("nav", { "aria-label": name }, element("p", {}, "page ", ...links))];
}

function differencesTable({ scans, further }) {
  if (scans.length === 0) return [paragraph("All assets are the same.")];
  const rows = scans.map((d) => [d.page === undefined ? d.scan : element("a", { href: pageAddress(d.page, d.scan) }, d.scan), d.kind,
    ...(d.kind === "changed" ? [number(d.hausdorff_mm, 3), d.worst_slice ?? "", increase(d, "area_mm2"), increase(d, "triangles")] : ["", "", "", ""]),
    increase(d, "bytes")]);
  return [table(["scan", "what", "#distance mm", "#slice", "#area mm\u00b2", "#triangles", "#bytes"], rows, { caption: "Differences, worst first" }),
    ...(further > 0 ? [paragraph(`and ${further} more; --json lists all`)] : [])];
}

function differenceText(d) {
  if (d.kind !== "changed") return d.kind;
  let out = `${number(d.hausdorff_mm, 3)} mm`;
  if (d.worst_slice !== null) out += ` in slice ${d.worst_slice}`;
  out += `, area ${increase(d, "area_mm2")} mm\u00b2, ${increase(d, "triangles")} triangles, ${increase(d, "bytes")} bytes`;
  if (d.slices_only_now > 0) out += `, ${d.slices_only_now} slices only now`;
  if (d.slices_only_before > 0) out += `, ${d.slices_only_before} slices only before`;
  return out;
}

function assetText({ error, slice, slices, size_mm, triangles, bytes }) {
  if (error) return paragraph(error, "bad");
  if (slice === undefined) return paragraph("no triangles", "");
  return element("p", {}, `slice ${slice} (${slices} in all), ${size_mm.map((mm) => number(mm, 3)).join(" x ")} mm`, element("br", {}),
    `${triangles} triangles, ${number(bytes / 1e3, 3)} kB`);
}

function cardOf({ name, asset, before, difference, reason, links, warnings = [] }) {
  const picture = (of) => (of?.src
    ? element("img", { loading: "lazy", decoding: "async", alt: "middle slice", width: 168, height: 168, src: of.src })
    : element("div", { class: "none" }));
  const bad = [...(difference ? [differenceText(difference)] : []), ...(reason ? [reason] : []),
    ...warnings.map(({ code, sentence }) => `${code}: ${sentence}`)];
  const kinds = ["report", "asset"].filter((kind) => links?.[kind] !== undefined);
  return element("div", { class: before ? "card two" : "card", id: name },
    element("div", { class: "pictures" }, picture(asset), ...(before ? [picture(before)] : [])),
    element("p", {}, element("b", {}, name)),
    ...(asset ? [assetText(asset)] : []),
    ...bad.map((text) => paragraph(text, "bad")),
    ...(links ? [element("p", { class: "links" }, ...kinds.map((kind) => element("a", { href: links[kind], "aria-label": `${kind} of ${name}` }, kind)))] : []));
}

// The bar that searches, filters and sorts by the index of all pages. The address's fragment holds its state, as in
// "#?name=head&show=failed", so that it can be shared; a scan's name cannot begin with "?".
const kShow = { all: "all scans", done: "done", failed: "failed", damaged: "damaged", warned: "with warnings", different: "different" };
const kFlags = { done: 1, failed: 2, damaged: 4, different: 8, warned: 16 };  // as in review.cpp
const kSort = { page: "order of the pages", name: "name", bytes: "bytes", triangles: "triangles", slices: "slices" };
const kOrder = { up: "ascending", down: "descending" };
const kUsual = { name: "", show: "all", sort: "page", order: "up" };
const kRows = 50;  // rows of the table that are added at a time

const choice = (values) => element("select", {}, ...Object.entries(values).map(([value, text]) => element("option", { value }, text)));

// The places of the scans that fit, sorted. Scans without the figure stand last in either order.
function found({ name, show: kind, sort, order }) {
  const { names, flags } = review.index;
  const part = name.trim().toLowerCase(), flag = kFlags[kind], sign = order === "down" ? -1 : 1;
  const places = [...names.keys()].filter((k) => names[k].toLowerCase().includes(part) && (flag === undefined || (flags[k] & flag) !== 0));
  if (sort === "page") return order === "down" ? places.reverse() : places;
  if (sort === "name") {
    const { compare } = new Intl.Collator("en", { numeric: true });
    return places.sort((a, b) => sign * compare(names[a], names[b]) || a - b);
  }
  const values = review.index[sort];
  return places.sort((a, b) => (values[a] === null) - (values[b] === null) || sign * (values[a] - values[b]) || a - b);
}

// The table of what is found on all pages, for a review of several pages: its elements, and the function that fills it.
function foundTable() {
  const { names, flags, bytes, triangles, slices } = review.index;
  const row = (k) => {
    const page = Math.floor(k / review.per_page), status = Object.keys(kFlags).filter((flag) => flags[k] & kFlags[flag]).map((flag) => kShow[flag]).join(", ");
    return [element("a", { href: pageAddress(page, names[k]) }, names[k]), status, bytes[k] ?? "", triangles[k] ?? "", slices[k] ?? "", page + 1];
  };
  const holder = element("div", {}), more = element("button", { type: "button", hidden: "" });
  let places = [], shown = 0;
  const fill = () => {
    shown = Math.min(shown + kRows, places.length);
    const rows = places.slice(0, shown).map(row);
    holder.replaceChildren(...(rows.length
      ? [table(["scan", "status", "#bytes", "#triangles", "#slices", "#page"], rows, { caption: "Found on all pages" })] : []));
    more.hidden = shown === places.length;
    more.textContent = `Show ${Math.min(kRows, places.length - shown)} more rows`;
  };
  more.addEventListener("click", fill);
  return { elements: [holder, more], set: (found_places) => { [places, shown] = [found_places, 0]; fill(); } };
}

// The bar and what it finds: their elements, and the function that takes the bar's state from a fragment. `shownCards` are this page's,
// which are moved and hidden within `cards`. The differences are hidden during a search.
function bar(differences, cards, shownCards) {
  const { different, ...withoutDifferent } = kShow, { names, further } = review.index, hasPages = review.pages.length > 1;
  const controls = { name: element("input", { type: "search", autocomplete: "off", spellcheck: "false" }),
    show: choice(review.differences ? kShow : withoutDifferent), sort: choice(kSort), order: choice(kOrder) };
  const reset = element("button", { type: "button" }, "Reset"), count = element("output", {}), here = element("p", { hidden: "" });
  const form = element("form", { role: "search", "aria-label": "scans" }, ...Object.entries({ name: "Name contains", show: "Show", sort: "Sort by", order: "Order" })
    .map(([key, text]) => element("label", {}, text, controls[key])), reset, count);
  const results = hasPages ? foundTable() : { elements: [], set: () => {} };

  const find = () => {
    const state = Object.fromEntries(Object.entries(controls).map(([key, control]) => [key, control.value]));
    const changed = Object.entries(state).filter(([key, value]) => value !== kUsual[key]), isChanged = changed.length > 0;
    const places = found(state), onPage = places.filter((k) => k < shownCards.length).map((k) => shownCards[k]);
    count.textContent = isChanged ? `${places.length} of ${names.length} scans` : `${review.scans} scans`;
    differences.hidden = isChanged;
    results.set(isChanged ? places : []);
    here.hidden = !isChanged || !hasPages || places.length === 0;
    here.textContent = `${onPage.length} of them are on this page${onPage.length > 0 ? ":" : "."}`;
    for (const card of shownCards) card.hidden = true;
    for (const card of onPage) card.hidden = false;
    cards.append(...onPage);
    return changed;
  };
  const set = (state) => {
    for (const [key, control] of Object.entries(controls)) {
      control.value = state[key] ?? kUsual[key];
      if (control.selectedIndex === -1) control.value = kUsual[key];
    }
  };
  const change = () => {
    const changed = find();
    history.replaceState(null, "", changed.length > 0 ? `#?${new URLSearchParams(changed)}` : location.href.split("#")[0]);
  };
  form.addEventListener("input", change);
  form.addEventListener("submit", (event) => event.preventDefault());
  reset.addEventListener("click", () => {
    set({});
    change();
    controls.name.focus();
  });
  return {
    elements: [form, ...(further > 0 ? [paragraph(`The search covers the first ${names.length} scans, but not the last ${further}.`, "bad")] : []),
      ...results.elements, here],
    set: (fragment) => {
      set(fragment.startsWith("#?") ? Object.fromEntries(new URLSearchParams(fragment.slice(2))) : {});
      find();
    } };
}

const countsText = ({ done, failed, damaged, warned, bytes }) =>
  `${done} assets of ${short(bytes / 1e6)} MB, ${failed} failed scans, ${damaged} damaged entries` +
  `${warned > 0 ? `, ${warned} scans with warnings` : ""}. Pictures: the middle slice with its mesh and outline, grey by HU.`;

const shownCards = review.cards.map(cardOf);
const differences = element("div", {}, ...(review.differences ? differencesTable(review.differences) : []));
const cards = element("div", { class: "cards" }, ...shownCards);
const search = review.index ? bar(differences, cards, shownCards)
  : { elements: [element("p", {}, element("a", { href: pageAddress(0) }, `Search, filter and sort all ${review.scans} scans on page 1`))], set: () => {} };
show("Review of a store", "full", element("h1", {}, "Review of a store"),
  ...(review.counts ? [paragraph(countsText(review.counts))] : []), ...pageLinks("pages"), ...search.elements,
  differences, cards, ...pageLinks("pages, again"));

// The browser looks for the fragment's card before the cards exist, and a scan may be named as another element of the page.
function followFragment() {
  search.set(location.hash);
  const k = review.cards.findIndex(({ name }) => `#${encodeURIComponent(name)}` === location.hash || `#${name}` === location.hash);
  if (k >= 0) shownCards[k].scrollIntoView();
}
addEventListener("hashchange", followFragment);
followFragment();
