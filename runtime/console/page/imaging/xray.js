// SPDX-License-Identifier: Apache-2.0
// The X-ray of the page: positions of the C-arm, shots, screening while a key is held, and two monitors, the second of which keeps the last
// picture of another position. In a session the loop counts, and a picture appears when the loop has counted it. In playback X-ray
// is always on and costs nothing.
import { post } from "../api.js";
import { by_id } from "../elements.js";
import { while_pressed } from "../keys.js";
import { NumberField } from "../numbers.js";
import { project, view_of } from "./c_arm.js";
import { Picture } from "./picture.js";
import { XrayPictures } from "./xray_pictures.js";

const kLarge = 512, kSmall = 320, kHold_ms = 200, kPulse_ms = 15;
const kSameNeedle_s = 1;  // of a row that comes so much later, the needle may be elsewhere than it was in a shot
const kPositions = { ap: [0, 0], lateral: [90, 0] };
// The elements in which a letter means something: in a list it chooses an entry. The entries of the list Width begin with digits.
const kTyping = "input:not([type]), input[type=text], textarea, select:not(#xray-width)";

/// One picture on the page: a canvas with a line of text below.
class Monitor {
  constructor(id) {
    this.canvas = by_id(id);
    this.context = this.canvas.getContext("2d");
    this.caption = by_id(`${id}-caption`);
  }
  /// `shown`: {picture, needle, key: the position of the C-arm, shot, words}.
  show(shown, is_inverted) {
    const { picture, needle, shot, words } = shown, { size } = picture;
    if (this.canvas.width !== size) this.canvas.width = this.canvas.height = size;
    if (this.image?.width !== size) this.image = new ImageData(size, size);
    picture.draw(this.image.data, needle, shot, is_inverted);
    this.context.putImageData(this.image, 0, 0);
    this.last = shown;
    this.caption.textContent = words;
  }
  copy_from(other, is_inverted) {
    if (other.last) this.show(other.last, is_inverted);
  }
  clear() {
    this.last = null;
    this.caption.textContent = "";
    this.context.clearRect(0, 0, this.canvas.width, this.canvas.height);
  }
}

export class Xray {
  /// `act`: {needle(): {tip, axis, radius_m} or null, is_operator(), mode(): "live", "playback" or "none", error(words)}.
  constructor(act) {
    this.act = act;
    this.live = new Monitor("xray-live");
    this.other = new Monitor("xray-other");
    this.pictures = new XrayPictures();
    this.drawn = 0;
    this.is_screening = this.is_held = this.is_inverted = false;
    this.turn_deg = this.tilt_deg = 0;
    for (const name of Object.keys(kPositions)) by_id(`xray-${name}`).addEventListener("click", () => this.move_to(...kPositions[name]));
    const changed = () => this.move_to(this.turn.value, this.tilt.value);
    this.turn = new NumberField("xray-turn", { changed, refused: act.error });
    this.tilt = new NumberField("xray-tilt", { changed, refused: act.error });
    by_id("xray-width").addEventListener("change", () => this.move_to(this.turn_deg, this.tilt_deg));
    by_id("xray-invert").addEventListener("change", (event) => {
      this.is_inverted = event.target.checked;
      for (const monitor of [this.live, this.other]) monitor.copy_from(monitor, this.is_inverted);
    });
    by_id("xray-shot").addEventListener("click", () => this.#take_shot());
    while_pressed(by_id("xray-screen"), (is_pressed) => this.#hold(is_pressed));
    addEventListener("keydown", (event) => {
      if (by_id("xray-box").hidden || event.repeat || event.ctrlKey || event.altKey || event.metaKey) return;
      if (event.target instanceof Element && event.target.closest(kTyping)) return;
      if (event.code === "KeyX") this.#take_shot();
      if (event.code === "KeyC") this.#hold(true);
    });
    addEventListener("keyup", ({ code }) => { if (code === "KeyC") this.#hold(false); });
    addEventListener("blur", () => this.#hold(false));
    addEventListener("visibilitychange", () => { if (document.hidden) this.#hold(false); });
  }

  /// Takes a scan: read_volume() and the bytes of its container, which the worker reads for itself; null: there is no X-ray.
  set_volume(volume, container) {
    this.worker?.terminate();
    this.worker = null;
    this.volume = volume?.bone ? volume : null;
    this.is_ready = this.is_working = false;
    this.failed = "";
    this.pictures.clear();
    this.shot = this.pending = null;
    for (const monitor of [this.live, this.other]) monitor.clear();
    if (!this.volume) return;
    this.worker = new Worker(new URL("./xray_worker.js", import.meta.url), { type: "module" });
    this.worker.onmessage = ({ data }) => this.#take(data);
    this.worker.onerror = (event) => {
      this.is_ready = false;
      this.failed = `The X-ray cannot be computed: ${event.message}`;
      this.act.error(this.failed);
    };
    this.worker.postMessage({ container });
    this.move_to(0, 0);
  }

  #view_of(turn_deg, tilt_deg) { return view_of(this.volume, turn_deg, tilt_deg, Number(by_id("xray-width").value) / 1000); }
  #key_of(turn_deg, tilt_deg) { return `${turn_deg} ${tilt_deg} ${by_id("xray-width").value}`; }
  get view() { return this.#view_of(this.turn_deg, this.tilt_deg); }
  get key() { return this.#key_of(this.turn_deg, this.tilt_deg); }

  /// Moves the C-arm. The last picture stays until another one is taken.
  move_to(turn_deg, tilt_deg) {
    this.turn.value = this.turn_deg = turn_deg ?? 0;
    this.tilt.value = this.tilt_deg = tilt_deg ?? 0;
    for (const [name, [turn, tilt]] of Object.entries(kPositions))
      by_id(`xray-${name}`).setAttribute("aria-pressed", String(turn === this.turn_deg && tilt === this.tilt_deg));
    // The sum along the rays depends on the position only, so it is ready when a picture is taken.
    this.#work();
  }

  /// Pixels of a fine picture. Small monitors need fewer, which are there sooner.
  get size() { return this.live.canvas.clientWidth * devicePixelRatio > 300 ? kLarge : kSmall; }

  /// The positions whose pictures are needed: the present one, that of a shot whose fine picture is not there yet, and the two usual ones,
  /// whose pictures are computed before anybody asks for them.
  #wanted() {
    const usual = Object.values(kPositions).map(([turn, tilt]) => ({ key: this.#key_of(turn, tilt), view: this.#view_of(turn, tilt) }));
    return [{ key: this.key, view: this.view }, ...(this.pending ? [this.pending] : []), ...usual];
  }

  /// Gives the worker what is needed most, if it is idle. A monitor that is not on the page needs nothing, and has no size.
  #work() {
    if (!this.is_ready || this.is_working || !this.live.canvas.clientWidth) return;
    const next = this.pictures.next(this.#wanted(), this.size);
    if (!next) return;
    this.is_working = true;
    this.worker.postMessage(next);
  }

  #take(message) {
    if (message.ready) this.is_ready = true;
    else {
      const { key, size, view, sum, is_covered } = message, { pending } = this;
      this.is_working = false;
      this.pictures.put(key, new Picture(view, size, sum, is_covered), this.#wanted());
      if (pending?.key === key) {
        this.#show(pending.needle, key, pending.where);
        if (this.pictures.is_fine(key, this.size)) this.pending = null;
      }
    }
    this.#work();
  }

  /// Sends one request after the other, so that the end of screening comes last. What is repeated waits for nothing.
  #post(take, is_repeated = false) {
    if (is_repeated && this.is_posting) return;
    this.is_posting = true;
    const one = async () => {
      try {
        await post("/api/xray", { take });
      } catch (error) {
        this.#hold(false, false);
        this.act.error(error.message);
      }
      if (this.posts === mine) this.is_posting = false;
    };
    const mine = (this.posts ?? Promise.resolve()).then(one);
    this.posts = mine;
  }

  #can_take() { return this.act.mode() === "live" && this.act.is_operator() && this.is_ready && !this.failed; }

  #take_shot() {
    if (this.#can_take()) this.#post("shot");
  }

  #hold(is_held, says_so = true) {
    if (is_held === this.is_held || (is_held && !this.#can_take())) return;
    this.is_held = is_held;
    clearInterval(this.holding);
    if (is_held) this.holding = setInterval(() => this.#post("screening", true), kHold_ms);
    if (says_so) this.#post(is_held ? "screening" : "nothing");
  }

  /// Another session has begun: X-ray is off.
  new_session() {
    this.is_screening = false;
    this.shot = null;
    this.#hold(false, false);
  }

  take_events(events) {
    for (const { kind } of events) {
      if (kind === "xray_on") this.is_screening = true;
      if (kind === "xray_off" || kind === "ended") this.is_screening = false;
    }
    // Only the last shot is shown. The C-arm may move before its picture is there.
    const shot = events.filter(({ kind }) => kind === "xray_shot").at(-1);
    if (!shot || !this.volume || this.act.mode() !== "live") return;
    this.shot = { t_s: shot.t_s, key: this.key, view: this.view, where: this.#where() };
  }

  /// The session's row is of the time `t_s`. A shot is shown with the needle of the first row that is not older. If that row is much later,
  /// as it is on a page that was hidden, this page does not know where the needle was, and shows no picture.
  take_row(t_s) {
    const { shot } = this;
    if (!shot || !(t_s >= shot.t_s)) return;
    this.shot = null;
    if (this.act.mode() !== "live") return;
    if (t_s - shot.t_s > kSameNeedle_s) {
      this.live.caption.textContent = "A later picture was taken while this page was not connected.";
      return;
    }
    const needle = this.act.needle();
    this.#show(needle, shot.key, shot.where);
    if (this.pictures.is_fine(shot.key, this.size)) return;
    this.pending = { ...shot, needle };
    this.#work();
  }

  #where() {
    const name = Object.keys(kPositions).find((each) => kPositions[each][0] === this.turn_deg && kPositions[each][1] === this.tilt_deg);
    return name === "ap" ? "AP" : name === "lateral" ? "Lateral" : `${this.turn_deg}° turned, ${this.tilt_deg}° tilted`;
  }

  #show(needle, key = this.key, where = this.#where()) {
    const picture = this.pictures.get(key);
    if (!picture) return;
    const tissue = this.volume.context ? "training only" : "bone only; training only";
    ++this.drawn;
    if (this.live.last?.key !== key) this.other.copy_from(this.live, this.is_inverted);
    this.live.show({ picture, needle, key, shot: this.drawn, words: `${where}; ${tissue}` }, this.is_inverted);
    this.tip_px = needle ? project(picture.view, picture.size, needle.tip) : null;
  }

  /// Draws the next picture while X-ray is on.
  frame(now) {
    if (!this.volume || by_id("xray-box").hidden) return;
    const mode = this.act.mode(), is_on = mode === "playback" || (mode === "live" && this.is_screening);
    if (!is_on || now - (this.drawn_at ?? -Infinity) < kPulse_ms) return;
    const needle = this.act.needle(), at = needle ? [...needle.tip, ...needle.axis].join() : "";
    if (this.act.mode() === "playback" && at === this.drawn_needle && this.live.last?.key === this.key && this.live.last.picture === this.pictures.get(this.key)) return;
    if (!this.pictures.has(this.key)) return;
    this.drawn_at = now;
    this.drawn_needle = at;
    this.#show(needle);
  }

  /// True while pictures follow the needle.
  get is_on() { return this.is_screening && this.act.mode() === "live" && Boolean(this.volume) && !by_id("xray-box").hidden; }

  /// Draws the counts and what can be pressed. `shots`, `seconds`: NaN if they are not counted.
  draw({ shots, seconds, why }) {
    this.#work();  // the monitors may have come onto the page, or have grown
    const can = this.#can_take() && !why;
    for (const id of ["xray-shot", "xray-screen"]) by_id(id).disabled = !can;
    by_id("xray-screen").setAttribute("aria-pressed", String(this.is_screening));
    by_id("xray-count").textContent = why || this.failed || (Number.isFinite(shots) ? `${shots} ${shots === 1 ? "shot" : "shots"}, ${seconds.toFixed(1)} s of screening` : "");
  }
}
