// SPDX-License-Identifier: Apache-2.0
// The hand: the operator holds the needle of a live session. While it is held, each frame sends the target of the hand's spring to the
// console (protocol.md), and a worker repeats it during slow frames (live_worker.js). The tip lags behind the target by force over stiffness.
import { is_paused } from "../words.js";
import { HandBar } from "./bar.js";
import { Feel } from "./feel.js";
import { HandGamepad } from "./gamepad.js";
import { HandKeys } from "./keys.js";
import { HandMarks } from "./marks.js";
import { across, moved, pushed, rotation_vector, share_of, sum } from "./motion.js";
import { HandPointer } from "./pointer.js";
import { HandSound } from "./sound.js";

const kSendEvery_ms = 8;        // the console takes at most 125 messages a second
const kAnswer_ms = 1000, kAsked = 20;  // after this time and so many messages without "yours" the console has not given the needle
const kLongestFrame_s = 0.1;    // a key that is held through a stalled frame does not jump
const kScale_N = 40;            // force at which the colour is orange, in a scene without forces of puncture
const kDown = [0, 0, -1];

const kOther = "Another page holds the needle.";

export class Hand {
  is_held = false;
  holder = "free";              // "yours", "other" or "free", as the console says
  target = null;                // where the hand pulls the tip to, m in {B}
  force_N = NaN;
  lag_mm = NaN;
  words = "";
  sent = 0;                     // targets that were sent
  felt = { contact: 0, crunch: 0, breach: 0 };  // how often each was felt
  #rotation = [0, 0, 0];
  #sent_ms = -Infinity;
  #taken_ms = 0;
  #grip = 0;                    // number of the taking
  #sent_before = 0;             // targets that were sent before the needle was taken
  #is_confirmed = false;
  #was_paused = false;
  #feel = new Feel();
  #sound = new HandSound();
  #pad = new HandGamepad();

  /// `app` is that of main.js; its view must exist.
  constructor(app) {
    this.app = app;
    this.keys = new HandKeys(() => this.toggle(), () => this.is_held);
    this.pointer = new HandPointer(app.view.renderer.domElement, app.view.cameras, this);
    this.marks = new HandMarks(app.view.scene);
    this.bar = new HandBar(() => this.toggle(), this.keys);
    this.set_theme();
    // In the capture phase: before the key or click that takes the needle. A first gesture before that spares the needle the delay.
    for (const gesture of ["pointerdown", "keydown"]) addEventListener(gesture, () => { if (this.about) this.#sound.wake(); }, true);
    addEventListener("blur", () => this.let_go());
    document.addEventListener("visibilitychange", () => { if (document.hidden) this.let_go(); });
    addEventListener("pagehide", () => this.let_go());
  }

  set_theme() {
    const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    this.marks.set_colours(colour("--blue"), colour("--orange"), colour("--text"));
  }

  /// The session's description of the hand; null: its needle is not moved from a page.
  get about() {
    const hand = this.app.live?.about.hand;
    return hand?.live ? hand : null;
  }
  /// The force at which bar and colour end: the largest at which something of the scene is punctured.
  get scale_N() {
    const { force_law, sheets = [], layers = [] } = this.app.live?.about ?? {};
    const forces = [...(force_law === "cutting" ? [] : sheets.map((sheet) => sheet.threshold_N)), ...layers.map((layer) => layer.puncture_N)];
    return Math.max(0, ...forces.filter(Number.isFinite)) || kScale_N;
  }
  get can_take() {
    const { live, role, connected, tab, state } = this.app;
    return Boolean(this.about && role === "operator" && connected && tab === "session" && live.row && live.is_placed() && !this.app.view.is_lost && ["running", "paused"].includes(state.state));
  }
  get is_paused() { return is_paused(this.app.state, this.app.live); }
  axis() { return this.app.live?.values("axis") ?? kDown; }

  toggle() {
    if (this.is_held) this.let_go();
    else this.take();
  }

  take() {
    if (this.is_held || !this.can_take) return;
    if (this.holder === "other") return this.say(kOther);
    this.is_held = true;
    ++this.#grip;
    this.#is_confirmed = false;
    this.#taken_ms = performance.now();
    this.#sent_before = this.sent;
    this.#feel.reset();
    this.#show_held(true);
    this.begin_at_tip();
    this.say("");
    this.bar.hide_help();
    this.send();
  }

  /// Lets go at once. `why` is shown to the operator if it was not their wish.
  let_go(why = "") {
    if (!this.is_held) return;
    this.is_held = false;
    this.app.link.hold(null);
    this.keys.release();
    this.pointer.release();
    this.#show_held(false);
    this.marks.hide();
    this.say(why);
  }

  #show_held(is_held) {
    const { view } = this.app;
    view.cameras.set_drag(!is_held);
    view.allows_arrow = !is_held;  // the line to the dot shows the same force in the same place
    if (this.app.live) view.update(this.app.live);
  }

  /// Puts the target where the tip is, so that the hand exerts no force at first and nothing jumps.
  begin_at_tip() {
    this.target = Array.from(this.app.live.values("tool_m"));
    this.#rotation = rotation_vector(this.app.live.values("q"));
  }

  move(by) {
    if (this.is_held && !this.is_paused) this.target = moved(this.target, by, this.about?.box);
  }

  send(now = performance.now()) {
    if (now - this.#sent_ms < kSendEvery_ms) return;
    this.#sent_ms = now;
    this.app.link.hold([...this.target, ...this.#rotation], this.#grip);
    ++this.sent;
  }

  say(words) {
    this.words = words;
    this.draw_bar();
  }

  // ---- what comes from the console ----

  /// The console's message {"hand": holder}.
  set_holder(holder) {
    this.holder = holder;
    if (holder === "yours") this.#is_confirmed = true;
    else if (this.is_held && holder === "other") this.let_go(kOther);
    // "free" before "yours" is the answer to an earlier letting go.
    else if (this.is_held && this.#is_confirmed) this.let_go("The console let go of the needle. Take it again to continue.");
    else if (this.words === kOther && holder === "free") this.words = "";
    this.draw_bar();
  }

  take_events(events) {
    if (this.is_held && events.some(({ kind }) => kind === "resumed")) this.begin_at_tip();
    if (events.some(({ kind }) => kind === "hand_lost")) this.let_go("The session let go of the needle, because this page sent nothing for a moment. Take it again to continue.");
  }

  /// The page did not draw for a second, so that the worker let go of the needle.
  stalled() { this.let_go("This page stood still for a second, so the needle was let go. Take it again to continue."); }

  connection_lost() {
    this.let_go("The connection was lost, so the needle was let go.");
    this.holder = "free";
  }

  /// The console's message about the state of the session.
  take_state({ state }) {
    if (state === "silent") this.let_go("The session did not answer for a moment, so the needle was let go. Take it again to continue.");
    else if (!["running", "paused", "starting"].includes(state)) this.let_go();
  }

  /// A new session: whatever was said about the last one is over.
  new_session() {
    this.let_go();
    this.holder = "free";  // until the console says otherwise
    this.say("");
    if (this.about && this.app.role === "operator") this.bar.offer_help();
  }

  /// A snapshot has become the live row.
  take_snapshot() {
    const { live } = this.app, tip = live.values("tool_m");
    if (!this.is_held || !tip) return;
    if (this.#was_paused || this.is_paused) this.begin_at_tip();  // the session's hand also begins at the tip again
    this.#was_paused = this.is_paused;
    this.force_N = live.force();
    const felt = this.#feel.take({ t_s: live.value("t_s"), force_N: this.force_N, cut_J: live.value("cut_J", 0),
      break_throughs: live.value("break_throughs", 0) }, this.scale_N);
    for (const name of Object.keys(felt)) if (felt[name]) ++this.felt[name];
    if (this.bar.sound.is_on) this.#sound.play(felt);
    if (this.bar.rumble.is_on) this.#pad.rumble(felt, performance.now());
  }

  // ---- once a frame ----

  frame(now, passed_s) {
    const { push, take, let_go } = this.#pad.read();
    if (let_go) this.let_go();
    if (take && document.hasFocus()) this.take();
    if (!this.is_held) return;
    if (!this.can_take) return this.let_go();
    if (!this.#is_confirmed && now - this.#taken_ms > kAnswer_ms && this.sent - this.#sent_before > kAsked) return this.let_go("The console did not give the needle to this page.");
    const passed = Math.min(kLongestFrame_s, passed_s), axis = this.axis();
    const { right, m_per_px } = this.app.view.cameras.plane(this.target, this.app.view.height);
    const directions = { ...across(axis, right), axis };
    for (const [from, one] of [["keys", this.keys.push()], ["pad", push]]) if (one) this.move(pushed(one, from, directions, passed));
    this.send(now);
    const tip = this.app.live.values("tool_m");
    this.lag_mm = 1000 * Math.hypot(...sum([[1, this.target], [-1, tip]]));
    this.force_N = this.app.live.force();
    this.marks.show(tip, this.target, share_of(this.force_N, this.scale_N), m_per_px);
    this.app.view.is_dirty = true;
    this.bar.show_force(this.force_N, this.lag_mm, this.scale_N);
  }

  /// Draws the buttons and words, as often as the other panels.
  draw_bar() {
    this.bar.draw({ is_shown: Boolean(this.about) && this.app.tab === "session" && this.app.role === "operator", is_held: this.is_held, can_take: this.can_take && this.holder !== "other",
      words: this.words || (this.holder === "other" ? kOther : ""), can_rumble: this.#pad.can_rumble });
  }
}
