// SPDX-License-Identifier: Apache-2.0
// A new scene: a person chooses entry and target on the bone, and the console makes the scene and checks it.
import { get_json, post } from "../api.js";
import { by_id, element } from "../elements.js";
import { NumberField, read_point } from "../numbers.js";
import { point_text, to_device, to_patient } from "./patient_frame.js";

const kAsk_ms = 300, kMaxFailedAsks = 20, kClick_px = 5, kDoubleClick_ms = 400, kShown_m = 0.05, kLeastDepth_m = 0.001, kInProcess = "inproc", kMaxName = 32;
const minus = (a, b) => a.map((x, k) => x - b[k]);
const along = (from, way, m) => from.map((x, k) => x + m * way[k]);
const length = (v) => Math.hypot(...v);
const is_refused = (name) => by_id(`plan-${name}`).getAttribute("aria-invalid") === "true";
const last_line = (text) => (text ?? "").trim().split("\n").pop().replace(/^trocar-run: /, "");

/// Returns a name that follows this one: "a" is followed by "a-2", and that by "a-3".
function next_name(name) {
  const [, stem, number] = name.match(/^(.*?)(?:-(\d+))?$/), end = `-${Number(number ?? 1) + 1}`;
  return stem.slice(0, kMaxName - end.length) + end;
}

export class Planning {
  /// `app` has `tab`, `view` and `preview`. `act`: {changed(), error(error), scene(): the chosen one, device(), is_free(), show(): shows the
  /// chosen scene's bone, opened(), made(file)}.
  constructor(app, act) {
    this.app = app;
    this.act = act;
    this.is_open = this.is_making = false;
    this.points = {};  // entry and target in the patient's frame, mm
    by_id("plan-open").addEventListener("click", () => this.open());
    by_id("plan-close").addEventListener("click", () => this.close());
    by_id("plan-make").addEventListener("click", () => this.make());
    by_id("plan-stop").addEventListener("click", () => post("/api/command", { command: "stop" }).catch(act.error));
    by_id("plan-name").addEventListener("input", () => this.draw());
    for (const name of ["entry", "target"]) {
      by_id(`plan-pick-${name}`).addEventListener("click", () => this.choose(name));
      by_id(`plan-${name}`).addEventListener("change", ({ target }) => this.#typed(name, target.value));
    }
    this.depth = new NumberField("plan-depth", { changed: (mm) => this.#deeper(mm / 1000), refused: (words) => this.#refused(words) });
    this.#listen(by_id("canvas"));
  }

  /// A click is a press that does not move, because a drag turns the view. The second click of a double click does nothing.
  #listen(canvas) {
    let pressed = null, clicked = null;
    const is_near = (a, b) => Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY) <= kClick_px;
    canvas.addEventListener("pointerdown", (event) => { pressed = event.isPrimary && event.button === 0 ? event : null; });
    canvas.addEventListener("pointerup", (event) => {
      const is_second = clicked && event.timeStamp - clicked.timeStamp < kDoubleClick_ms && is_near(event, clicked);
      if (!this.is_active || !pressed || !is_near(event, pressed) || is_second) return;
      const box = canvas.getBoundingClientRect(), at_m = this.app.view?.pick(event.clientX - box.left, event.clientY - box.top);
      if (!at_m) return;
      clicked = event;
      this.set(this.picks, at_m);
    });
  }

  /// `asset`: the file of an asset without a scene, whose bone is not shown yet; none: the chosen scene's bone is shown.
  open(asset) {
    if (this.is_making) return;
    this.is_open = true;
    document.body.dataset.planning = "";
    this.asset = asset;
    this.points = {};
    this.picks = "entry";
    this.result = null;
    for (const name of ["entry", "target"]) by_id(`plan-${name}`).setAttribute("aria-invalid", "false");
    this.depth.value = null;
    const file = asset ?? this.act.scene()?.file ?? "scene";
    by_id("plan-name").value = `${file.replace(/^.*\//, "").replace(/\.[a-z]+$/, "").replace(/[^\w-]/g, "_").slice(0, kMaxName - 8)}-new`;
    by_id("plan-bar").hidden = false;
    this.act.opened();
    if (!asset) this.act.show();
    this.#changed();
    by_id(asset ? "plan-name" : "plan-close").focus();
    this.#resume();
  }

  close() {
    if (!this.is_open || this.is_making) return;
    this.is_open = false;
    delete document.body.dataset.planning;
    this.points = {};
    by_id("plan-bar").hidden = true;
    this.#changed();
    if (this.app.tab === "folder") by_id("plan-open").focus();
  }

  get is_active() { return this.is_open && this.app.tab === "folder"; }
  /// The bone that is shown, if points can be chosen on it: it is that of the chosen scene.
  get bone() {
    const { preview } = this.app;
    return !this.asset && preview?.scene && preview.scene === this.act.scene()?.file ? preview.bone : null;
  }
  get rows() { return this.bone?.lps_mm_of_device ?? null; }
  /// A point in {B}, m.
  place(name) { return this.points[name] && this.rows ? to_device(this.rows, this.points[name]) : null; }

  choose(name) {
    this.picks = name;
    this.#changed();
  }

  /// The view shows a bone, perhaps another one: the points of one patient mean nothing in another.
  changed_bone() {
    const { preview } = this.app, of = preview?.scene ? `${preview.scene} ${preview.asset ?? ""}` : "";
    if (of && of !== this.of) {
      this.of = of;
      if (!this.keeps_points) this.points = {};
      this.picks = "entry";
      if (!this.is_making) this.result = null;
    }
    if (this.is_open) this.#changed();
  }

  set(name, at_m) {
    if (this.is_making || !this.rows) return;
    this.act.error("");
    by_id(`plan-${name}`).setAttribute("aria-invalid", "false");
    this.depth.value = null;  // #changed() states it anew
    this.points[name] = to_patient(this.rows, at_m);
    if (name === "entry" && !this.points.target) this.picks = "target";
    this.result = null;
    this.#changed();
  }

  /// A text that is no point stays for correction, and no scene is made until it is one, or another point is chosen.
  #typed(name, text) {
    const at_mm = read_point(text), is_point = at_mm || !text.trim();
    by_id(`plan-${name}`).setAttribute("aria-invalid", String(!is_point));
    if (!is_point) return this.#refused(`${text}: a point is three numbers in mm, such as 12.3, -4.5, 33 or 12,3 -4,5 33`);
    if (at_mm && this.rows) return this.set(name, to_device(this.rows, at_mm));
    if (name === "target") delete this.points.target;
    this.#changed();
  }

  #refused(words) {
    this.act.error(words);
    this.draw();
  }

  /// True while a field holds a text that was refused.
  get #has_refused() { return this.depth.is_refused || ["entry", "target"].some((name) => is_refused(name)); }

  /// Moves the target along the way to this depth; without a target it lies straight below the entry.
  #deeper(depth_m) {
    const entry = this.place("entry");
    if (!entry || !(depth_m > 0)) return this.#changed();
    this.set("target", along(entry, this.way(), depth_m));
  }

  /// The needle's way in, of unit length, in {B}.
  way() {
    const entry = this.place("entry"), target = this.place("target");
    const way = entry && target ? minus(target, entry) : [0, 0, -1];
    return length(way) > 0 ? way.map((x) => x / length(way)) : [0, 0, -1];
  }

  /// The planned needle, for the planes of the CT; null if none is planned.
  needle() {
    const tip = this.is_active ? this.place(this.picks) ?? this.place("entry") : null;
    return tip ? { tip, axis: this.way().map((x) => -x), radius_m: this.bone.tool.radius_m } : null;
  }

  #changed() {
    const entry = this.place("entry"), target = this.place("target");
    for (const name of ["entry", "target"]) if (!is_refused(name)) by_id(`plan-${name}`).value = this.points[name] ? point_text(this.points[name]) : "";
    if (!this.depth.is_refused) this.depth.value = entry && target ? Number((1000 * length(minus(target, entry))).toFixed(1)) : null;
    this.app.view?.set_plan(this.is_active && entry ? { entry, end: target ?? along(entry, this.way(), kShown_m), target, at: this.place(this.picks) ?? entry } : null);
    this.draw();
    this.act.changed();
  }

  /// Returns what is wrong with the points; empty if nothing is.
  #fault() {
    const entry = this.place("entry"), target = this.place("target");
    return entry && target && entry[2] - target[2] < kLeastDepth_m ? "The target must lie below the entry: the needle goes from the last slices to the first." : "";
  }

  /// Says what to do next.
  #words() {
    if (this.is_making) return this.state === "checking" ? "The scene is written, and is being checked." : "The scene is being made: a dry run tries it with the needle. This can take a minute.";
    if (!this.act.is_free()) return "A session runs. Stop it before you make a scene.";
    if (this.asset) return "The needle enters where the bone of this asset is thickest. On the new scene you can then choose points yourself.";
    if (!this.act.scene()) return "Choose a scene, or New scene at an asset.";
    if (!this.bone) return this.act.scene().asset_missing ? "The asset of this scene is missing." : "The bone is being loaded.";
    if (!this.rows) return "The slices of this scene do not lie as in the scan, so points cannot be chosen on it. Choose another scene, or New scene at an asset.";
    const entry = this.place("entry"), target = this.place("target");
    if (!entry) return "Click on the bone where the needle enters.";
    if (!target) return "Click on the bone, or in the CT planes, at the target; or give its depth. Without a target the needle goes straight down.";
    const tilt = Math.acos(Math.max(-1, Math.min(1, -this.way()[2]))) * 180 / Math.PI;
    return this.#fault() || `The way is ${(1000 * length(minus(target, entry))).toFixed(1)} mm long, tilted by ${tilt.toFixed(1)}°. Click again to move the ${this.picks}.`;
  }

  draw() {
    if (!this.is_open) return;
    const has_points = Boolean(this.rows), name = by_id("plan-name"), words = this.#words();
    if (by_id("plan-words").textContent !== words) by_id("plan-words").textContent = words;
    for (const id of ["entry", "target"]) {
      by_id(`plan-pick-${id}`).setAttribute("aria-pressed", String(has_points && this.picks === id));
      by_id(`plan-pick-${id}`).disabled = by_id(`plan-${id}`).disabled = !has_points || this.is_making;
    }
    by_id("plan-depth").disabled = !this.place("entry") || this.is_making;
    by_id("plan-points").hidden = Boolean(this.asset);
    const may_hold = this.act.device() === kInProcess;
    by_id("plan-live").disabled = !may_hold;
    by_id("plan-live-note").hidden = may_hold;
    by_id("plan-make").disabled = this.is_making || !this.act.is_free() || !name.value || !name.checkValidity() || !(this.asset || this.place("entry")) || Boolean(this.#fault()) || (!this.asset && this.#has_refused);
    by_id("plan-close").disabled = this.is_making;
    by_id("plan-stop").hidden = !this.is_making;
    if (this.drawn_result !== this.result) this.#draw_result();
    this.drawn_result = this.result;
  }

  make() {
    const mm = (name) => this.points[name]?.map((x) => Number(x.toFixed(3)));
    const body = { name: by_id("plan-name").value, device: this.act.device(), live_hand: by_id("plan-live").checked && !by_id("plan-live").disabled };
    if (this.asset) body.asset = this.asset;
    else Object.assign(body, { scene: this.app.preview.scene, asset: this.app.preview.asset, entry_mm: mm("entry"), target_mm: mm("target") });
    return this.#follow(body.name, () => post("/api/new_scene", body));
  }

  /// Follows the making that this or another page has begun before.
  async #resume() {
    const told = await get_json("/api/new_scene").catch(() => ({}));
    if (this.is_open && !this.is_making && (told.state === "making" || told.state === "checking")) await this.#follow(told.name, () => {});
  }

  async #follow(name, begin) {
    this.is_making = true;
    this.state = "making";
    this.result = null;
    this.draw();
    let result;
    try {
      await begin();
      result = await this.#result(name);
    } catch (error) {
      result = { error: error.message };
    }
    if (result.scene) {
      this.asset = undefined;
      this.keeps_points = true;  // the new scene has the same bone
      await this.act.made(result.scene);
      this.keeps_points = false;
      by_id("plan-name").value = next_name(name);
    }
    this.result = result;
    this.is_making = false;
    if (this.app.tab !== "folder") return this.close();
    this.#changed();
  }

  async #result(name) {
    for (let failed = 0; ;) {
      await new Promise((done) => setTimeout(done, kAsk_ms));
      let told;
      try {
        told = await get_json("/api/new_scene");
      } catch (error) {
        if (++failed > kMaxFailedAsks) throw error;
        continue;
      }
      if (told.name !== name) return { error: "Another scene was made meanwhile." };
      this.state = told.state;
      this.draw();
      if (told.state === "ended") return told;
    }
  }

  #draw_result() {
    const { result } = this;
    by_id("plan-result").hidden = !result;
    if (!result) return;
    const { scene, warnings, stopped, error, end } = result;
    const findings = warnings?.length === 1 ? "The check has one finding:" : warnings?.length ? `The check has ${warnings.length} findings:` : warnings ? "The check found nothing wrong."
      : stopped ? "The check was stopped." : `It could not be checked: ${error || last_line(result.check) || end}`;
    const why_not = error || (stopped ? "Stopped: no scene was written." : last_line(result.text) || `trocar-run ended with ${end} and said nothing.`);
    by_id("plan-verdict").textContent = scene ? `${scene} is written and chosen. ${findings}` : why_not;
    by_id("plan-verdict").dataset.level = !scene || !(warnings || stopped) ? "bad" : warnings?.length === 0 ? "good" : "wait";
    by_id("plan-findings").replaceChildren(...(warnings ?? []).map((finding) => element("li", "", finding)));
    by_id("plan-details").hidden = !scene;
    by_id("plan-text").textContent = [result.text, result.check].filter(Boolean).join("\n");
  }
}
