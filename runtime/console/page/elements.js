// SPDX-License-Identifier: Apache-2.0
// Finds and makes elements of the page. Texts, which may come from files and programs, are set by textContent only.

export const by_id = (id) => document.getElementById(id);

export function element(tag, name = "", text = "") {
  const made = document.createElement(tag);
  if (name) made.className = name;
  if (text) made.textContent = text;
  return made;
}

/// Replaces the entries of a list. The chosen one stays chosen if it is among the new ones, too; otherwise the entry without a value is.
export function set_options(list, options) {
  const { value: chosen } = list;
  list.replaceChildren(...options);
  list.value = options.some(({ value }) => value === chosen) ? chosen : "";
}
