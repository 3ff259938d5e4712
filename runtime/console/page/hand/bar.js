// SPDX-License-Identifier: Apache-2.0
// The hand's bar below the view: the button that takes the needle, force and lag, switches of sound and rumble, and the help.
import { by_id } from "../elements.js";
import { share_of } from "./motion.js";

const kHelpKey = "trocar-hand-help";  // "seen" once the operator has closed the help or held the needle

/// A button that switches something on and off, which is remembered. It is on at first. (The space key would toggle a checkbox that has
/// the focus, but must stop the session.)
class Switch {
  constructor(id) {
    this.button = by_id(id);
    this.key = `trocar-${id}`;
    this.set(localStorage.getItem(this.key) !== "off");
    this.button.addEventListener("click", () => this.set(!this.is_on));
  }
  set(is_on) {
    this.is_on = is_on;
    localStorage.setItem(this.key, is_on ? "on" : "off");
    this.button.setAttribute("aria-pressed", String(is_on));
    this.button.lastChild.textContent = is_on ? "on" : "off";
  }
}

export class HandBar {
  /// `on_toggle`: takes the needle or lets it go. `keys`: HandKeys.
  constructor(on_toggle, keys) {
    this.button = by_id("hand-take");
    this.button.addEventListener("click", on_toggle);
    keys.add_button(by_id("hand-in"), "KeyF");
    keys.add_button(by_id("hand-out"), "KeyR");
    this.sound = new Switch("hand-sound");
    this.rumble = new Switch("hand-rumble");
    by_id("hand-help-open").addEventListener("click", () => (by_id("hand-help").hidden ? this.show_help() : this.hide_help()));
    by_id("hand-help-close").addEventListener("click", () => this.hide_help());
  }

  /// Shows the help if the operator has not seen it.
  offer_help() { if (localStorage.getItem(kHelpKey) !== "seen") this.show_help(); }
  show_help() { by_id("hand-help").hidden = false; }
  hide_help() {
    if (by_id("hand-help").hidden) return;
    by_id("hand-help").hidden = true;
    localStorage.setItem(kHelpKey, "seen");
  }

  draw({ is_shown, is_held, can_take, words, can_rumble }) {
    by_id("hand-bar").hidden = !is_shown;
    document.body.dataset.hand = is_shown ? (is_held ? "held" : "free") : "none";
    if (!is_shown) return;
    this.button.disabled = !is_held && !can_take;
    this.button.firstChild.textContent = is_held ? "Let go " : "Hold the needle ";
    this.button.setAttribute("aria-pressed", String(is_held));
    by_id("hand-force").hidden = by_id("hand-push").hidden = !is_held;
    this.rumble.button.hidden = !can_rumble;
    by_id("hand-words").textContent = words;
  }

  show_force(force_N, lag_mm, scale_N) {
    const share = share_of(force_N, scale_N);
    const fill = by_id("hand-force-bar").firstElementChild;
    fill.style.transform = `scaleX(${share})`;
    fill.style.background = `color-mix(in srgb, var(--orange) ${Math.round(100 * share)}%, var(--blue))`;
    by_id("hand-force-N").textContent = `${force_N.toFixed(1)} N`;
    by_id("hand-force-mm").textContent = `${lag_mm.toFixed(1)} mm behind the dot`;
  }
}
