// SPDX-License-Identifier: Apache-2.0
// The keys that move the needle, and the buttons on the screen that act like them.
import { while_pressed } from "../keys.js";

const kMoves = { ArrowRight: ["right", 1], ArrowLeft: ["right", -1], ArrowUp: ["away", 1], ArrowDown: ["away", -1], KeyF: ["along", 1], KeyR: ["along", -1] };

const is_typing = ({ target }) => target instanceof HTMLSelectElement || target instanceof HTMLTextAreaElement || (target instanceof HTMLInputElement && !["checkbox", "button"].includes(target.type));

export class HandKeys {
  #down = new Set();
  #is_fine = false;

  /// `on_toggle` is called when H is pressed; `is_held()` says whether the hand holds the needle.
  constructor(on_toggle, is_held) {
    addEventListener("keydown", (event) => {
      this.#is_fine = event.shiftKey;
      // Ctrl+R and others stay with the browser. With the command key, macOS reports no release of other keys.
      if (event.ctrlKey || event.metaKey || event.altKey) return this.#down.clear();
      if (is_typing(event)) return;
      if (event.code === "KeyH" && !event.repeat) on_toggle();
      if (!is_held() || !(event.code in kMoves)) return;
      event.preventDefault();  // arrows would scroll the page of a small window
      this.#down.add(event.code);
    });
    addEventListener("keyup", (event) => {
      this.#is_fine = event.shiftKey;
      this.#down.delete(event.code);
    });
  }

  /// Lets `button` act like the key `code` while it is pressed.
  add_button(button, code) {
    while_pressed(button, (is_pressed) => (is_pressed ? this.#down.add(code) : this.#down.delete(code)));
  }

  release() { this.#down.clear(); }

  /// Returns the push of all keys that are down: {right, away, along, is_fine}; null: none.
  push() {
    if (!this.#down.size) return null;
    const push = { right: 0, away: 0, along: 0, is_fine: this.#is_fine };
    for (const code of this.#down) push[kMoves[code][0]] += kMoves[code][1];
    return push;
  }
}
