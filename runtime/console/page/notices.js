// SPDX-License-Identifier: Apache-2.0
// What the status line says of something that failed. A notice ends with its cause: when the same thing succeeds, when the session has gone
// on to another state, or after kShown_ms. It does not hide what the page says of a session in trouble.
const kShown_ms = 12000;

export class Notices {
  #said = new Map();  // cause: {words, timer}, the newest last

  /// `changed` is called after each change.
  constructor(changed) { this.changed = changed; }

  /// Says it until end(cause), and with `lasts` not only for kShown_ms. Empty words end it.
  say(cause, what, { lasts = false } = {}) {
    this.end(cause);
    const words = what instanceof Error ? what.message : String(what || "");
    if (!words) return;
    this.#said.set(cause, { words, lasts, timer: lasts ? undefined : setTimeout(() => this.end(cause), kShown_ms) });
    this.changed();
  }

  end(cause) {
    const said = this.#said.get(cause);
    if (!said) return;
    clearTimeout(said.timer);
    this.#said.delete(cause);
    this.changed();
  }

  /// Ends those that are said for a time only.
  end_passing() { for (const [cause, { lasts }] of [...this.#said]) if (!lasts) this.end(cause); }

  /// The words of the newest notice that lasts, otherwise of the newest; "" if there is none.
  get words() {
    const all = [...this.#said.values()];
    return (all.findLast(({ lasts }) => lasts) ?? all.at(-1))?.words ?? "";
  }
}
