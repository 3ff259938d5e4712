// SPDX-License-Identifier: Apache-2.0
// A gamepad that moves the needle: sticks across, triggers along the tool, buttons to take it and to let go; and its rumble.
import { deflection } from "./motion.js";

const kTake = 0, kLetGo = 1, kShoulders = [4, 5], kOut = 6, kIn = 7;  // buttons of the standard layout
const kCrunchEvery_ms = 60;

export class HandGamepad {
  #was_down = { take: false, let_go: false };
  #rumbled_ms = 0;

  /// Reads the gamepad. Call this once a frame. Returns {push: {right, away, along, is_fine} or null, take, let_go}; the last two are
  /// true in the frame in which their button is pressed.
  read() {
    // A gamepad without the standard layout may report its triggers as sticks that rest at -1, which would push the needle.
    this.pad = [...(navigator.getGamepads?.() ?? [])].find((one) => one?.connected && one.mapping === "standard") ?? null;
    const { pad } = this;
    const is_down = { take: Boolean(pad?.buttons[kTake]?.pressed), let_go: Boolean(pad?.buttons[kLetGo]?.pressed) };
    const answer = { push: null, take: is_down.take && !this.#was_down.take, let_go: is_down.let_go && !this.#was_down.let_go };
    this.#was_down = is_down;
    if (!pad) return answer;
    const stick = (first) => [deflection(pad.axes[first] ?? 0), deflection(pad.axes[first + 1] ?? 0)];
    const trigger = (k) => deflection(pad.buttons[k]?.value ?? 0);
    const [left, right] = [stick(0), stick(2)], used = Math.hypot(...left) >= Math.hypot(...right) ? left : right;
    const push = { right: used[0], away: -used[1], along: trigger(kIn) - trigger(kOut), is_fine: kShoulders.some((k) => pad.buttons[k]?.pressed) };
    if (push.right || push.away || push.along) answer.push = push;
    return answer;
  }

  get can_rumble() { return typeof this.pad?.vibrationActuator?.playEffect === "function" || (typeof navigator.vibrate === "function" && matchMedia("(pointer: coarse)").matches); }

  /// Plays what is felt (Feel.take) on the gamepad, or on a phone that can vibrate.
  rumble({ contact, crunch, breach }, now_ms) {
    const play = (duration, strongMagnitude, weakMagnitude) => {
      const actuator = this.pad?.vibrationActuator;
      if (typeof actuator?.playEffect === "function") actuator.playEffect("dual-rumble", { duration, strongMagnitude, weakMagnitude })?.catch?.(() => {});
      else if (matchMedia("(pointer: coarse)").matches) navigator.vibrate?.(duration);
    };
    if (breach) play(120, Math.max(0.4, breach), 0.6);
    else if (contact) play(40, 0, 0.5 * contact);
    // Each effect replaces the one before, so the weak ones are kept apart, and from the strong one.
    else if (crunch && now_ms > this.#rumbled_ms) play(50, 0, crunch);
    else return;
    this.#rumbled_ms = now_ms + (breach ? 120 : kCrunchEvery_ms);
  }
}
