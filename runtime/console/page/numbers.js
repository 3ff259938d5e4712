// SPDX-License-Identifier: Apache-2.0
// Numbers that people type, with a decimal point or a decimal comma. (A browser's own field of numbers drops a comma that the system's
// language does not have, so that 12,5 becomes 125.)
import { by_id } from "./elements.js";

const kDecimal = /^[+-]?(\d+([.,]\d*)?|[.,]\d+)$/;

/// Returns the number that the whole text is: 12.5 for "12.5" and "12,5", null for anything else.
function decimal(text) {
  const plain = text.trim().replace(/^\u2212/, "-");
  return kDecimal.test(plain) ? Number(plain.replace(",", ".")) : null;
}

/// As decimal(), but "1,250" is nothing: it may be 1.25 or 1250.
export const read_number = (text) => (/^\D?\d{1,3},\d{3}$/.test(text.trim()) ? null : decimal(text));

/// Reads the three coordinates of "12.3, -4.5, 33", "12,3 -4,5 33" or "12,3; -4,5; 33", of at most 10 m in mm; null if there are not three.
export function read_point(text) {
  const plain = text.trim(), parts = plain.split(/[;\s]/.test(plain) ? /\s*;\s*|,?\s+/ : ",");
  const numbers = parts.map(decimal);
  return numbers.length === 3 && numbers.every((x) => x !== null && Math.abs(x) <= 1e4) ? numbers : null;
}

/// Returns what is wrong with the text of a number field, in words; "" if nothing is.
export function number_fault(text, { min, max, whole, what }) {
  if (!text.trim()) return "";
  const number = read_number(text);
  if (number === null) return `${what}: ${text.trim()} is not one number, such as ${whole ? "12" : "12.5 or 12,5"}`;
  if (whole && !Number.isInteger(number)) return `${what}: ${text.trim()} is not a whole number`;
  return number < min || number > max ? `${what}: ${number} is not within ${min} and ${max}` : "";
}

/// A text field that holds a number. Its attributes data-min, data-max and data-step say what it takes; with data-whole, whole numbers only.
/// The arrow keys change it by a step.
export class NumberField {
  /// `changed(value)` is called after each change to a number, or to null if the field is empty. `refused(words)`: the text is no number of
  /// this field; the text stays, and the field keeps its value.
  constructor(id, { changed = () => {}, refused = () => {} } = {}) {
    this.field = by_id(id);
    const { min = -Infinity, max = Infinity, step = 1, whole } = this.field.dataset;
    this.rule = { min: Number(min), max: Number(max), whole: whole !== undefined, what: this.field.closest("label").firstChild.textContent.trim() };
    this.last = read_number(this.field.value);
    const take = () => {
      const words = this.#mark(number_fault(this.field.value, this.rule));
      if (words) return refused(words);
      this.last = read_number(this.field.value);
      changed(this.last);
    };
    this.field.addEventListener("input", () => this.#mark(number_fault(this.field.value, this.rule)));
    this.field.addEventListener("change", take);
    this.field.addEventListener("keydown", (event) => {
      const way = { ArrowUp: 1, ArrowDown: -1 }[event.key];
      if (!way || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      const to = (read_number(this.field.value) ?? this.last ?? 0) + way * Number(step);
      this.value = Number(Math.max(this.rule.min, Math.min(this.rule.max, to)).toFixed(6));
      changed(this.last);
    });
  }

  /// Marks the field if its text is refused, so that a form with it cannot be sent.
  #mark(words) {
    this.field.setCustomValidity(words);
    this.field.setAttribute("aria-invalid", String(Boolean(words)));
    return words;
  }

  get is_refused() { return !this.field.validity.valid; }
  /// The last number that was taken, or null.
  get value() { return this.last; }
  set value(number) {
    this.last = number;
    this.field.value = number ?? "";
    this.#mark("");  // what the page itself says may be beyond the limits for typing
  }
}
