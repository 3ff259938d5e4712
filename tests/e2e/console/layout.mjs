// SPDX-License-Identifier: Apache-2.0
// Runs in the page: texts that are cut off, outside of the window, or over each other. Returns one line for each.
export function layout_faults() {
  const kSlack_px = 2;
  const found = [], boxes = [];
  // An open dialog covers what is behind it.
  const walker = document.createTreeWalker(document.querySelector("dialog[open]") ?? document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const parent = node.parentElement;
    if (!node.data.trim() || parent.closest("script, style, option, select, dialog:not([open])")) continue;
    if (!parent.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    for (const rect of range.getClientRects()) {
      if (rect.width < 1 || rect.height < 1) continue;
      let box = { left: rect.left, top: rect.top, right: rect.right, bottom: rect.bottom };
      let is_cut = false, is_scrolled = false;
      for (let up = parent; up; up = up.parentElement) {
        const style = getComputedStyle(up);
        if (style.overflowX === "visible" && style.overflowY === "visible") continue;
        const edge = up.getBoundingClientRect();
        const before = box;
        box = { left: Math.max(box.left, edge.left), top: Math.max(box.top, edge.top), right: Math.min(box.right, edge.right), bottom: Math.min(box.bottom, edge.bottom) };
        const lost = Math.max(box.left - before.left, before.right - box.right, box.top - before.top, before.bottom - box.bottom);
        if (["auto", "scroll"].includes(style.overflowY)) is_scrolled = is_scrolled || lost > 0;
        else if (lost > kSlack_px && !is_scrolled && style.textOverflow !== "ellipsis") is_cut = true;
      }
      const words = node.data.trim().slice(0, 50);
      if (box.right <= box.left || box.bottom <= box.top) {
        if (!is_scrolled) found.push(`not to be seen: "${words}"`);
        continue;
      }
      if (is_cut) found.push(`cut off: "${words}"`);
      if (box.left < -kSlack_px || box.top < -kSlack_px || box.right > innerWidth + kSlack_px || box.bottom > innerHeight + kSlack_px) found.push(`outside of the window: "${words}"`);
      boxes.push({ ...box, words, parent });
    }
  }
  for (const [i, a] of boxes.entries())
    for (const b of boxes.slice(i + 1)) {
      const width = Math.min(a.right, b.right) - Math.max(a.left, b.left), height = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (width > kSlack_px && height > 0.25 * Math.min(a.bottom - a.top, b.bottom - b.top)) found.push(`"${a.words}" and "${b.words}" are over each other`);
    }
  for (const canvas of document.querySelectorAll(".uplot canvas")) {
    const edge = canvas.closest(".plot").getBoundingClientRect(), box = canvas.getBoundingClientRect();
    if (box.width && (box.right > edge.right + kSlack_px || box.bottom > edge.bottom + kSlack_px)) found.push("a plot is larger than its panel");
  }
  return found;
}
