// SPDX-License-Identifier: GPL-3.0-or-later
// Draws a preview. preview: formats/session/preview.schema.json. page: its texts and picture.
const preview = data("preview"), page = data("page");

const by_label = () => table(["#label", "#voxels", "#material"],
  preview.label_voxels.map(({ label: value, voxels }) => [value, voxels, page.material.includes(value) ? "yes" : "no"]),
  { caption: "Labels in the slices shown" });
const by_change = () => table(["#change", `#${page.control}`, "#area mm\u00b2", "#outlines"],
  preview.changes.map((c) => [number(c.change, 4), number(c.threshold, 4), number(c.area_mm2), c.outlines]), { caption: `Another ${page.control}` });

show(page.title, "full", element("h1", {}, page.title),
  element("p", {}, page.size, element("br", {}), page.options),
  ...preview.warnings.map(({ code, sentence }) => paragraph(`Warning (${code}): ${sentence}`, "bad")),
  element("img", { alt: "Contact sheet of the slices with their outlines", ...page.picture }),
  pair(preview.label_voxels ? by_label() : by_change(),
    table(["#slice", "#z mm", "#area mm\u00b2", "#outlines"], preview.slices.map((s) => [s.index, number(s.z_mm), number(s.area_mm2), s.outlines]),
      { caption: "Slices shown" })),
  ...(page.changes ? [paragraph(`Another ${page.control}: ${page.changes}`, "")] : []));
