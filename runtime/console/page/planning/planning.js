// SPDX-License-Identifier: Apache-2.0
// A new scene: a person chooses entry and target on the bone, and the console makes the scene and checks it.
// Tests: tests/e2e/console_new_scene_page_test.py
import { get_json, post } from "../api.js";
import { point_text, read_point, to_device, to_patient } from "./patient_frame.js";

const by_id = (id) => document.getElementById(id);
const kAsk_ms = 300, kClick_px = 5, kShown_m = 0.05, kDefaultDepth_m = 0.02, kInProcess = "inproc";
const minus = (a, b) => a.map((x, k) => x - b[k]);
const along = (from, way, m) => from.map((x, k) => x + m * way[k]);
const length = (v) => Math.hypot(...v);

export class Planning {
  /// `app` has `view` and `preview`. `act`: {changed(), error(error), scene(), asset(), device(), is_free(), opened(), made(file)}.
  constructor(app, act) {
    this.app = app;
    this.act = act;
    this.is_open = this.is_making = false;
    this.points = {};  // entry and target in {B}, m
    by_id("plan-open").addEventListener("click", () => this.open());
    by_id("plan-close").addEventListener("click", () => this.close());
    by_id("plan-make").addEventListener("click", () => this.make());
    by_id("plan-stop").addEventListener("click", () => post("/api/command", { command: "stop" }).catch(act.error));
    by_id("plan-name").addEventListener("input", () => this.draw());
    for (const name of ["entry", "target"]) {
      by_id(`plan-pick-${name}`).addEventListener("click", () => this.choose(name));
      by_id(`plan-${name}`).addEventListener("change", ({ target }) => this.#typed(name, target.value));
    }
    by_id("plan-depth").addEventListener("change", ({ target }) => this.#deeper(Number(target.value) / 1000));
    this.#listen(by_id("canvas"));
  }

  /// A click is a press that does not move: a drag turns the view.
  #listen(canvas) {
    let pressed = null;
    canvas.addEventListener("pointerdown", (event) => { pressed = event.isPrimary && event.button === 0 ? event : null; });
    canvas.addEventListener("pointerup", (event) => {
      if (!this.is_open || !pressed || Math.hypot(event.clientX - pressed.clientX, event.clientY - pressed.clientY) > kClick_px) return;
      const box = canvas.getBoundingClientRect(), at_m = this.app.view?.pick(event.clientX - box.left, event.clientY - box.top);
      if (at_m) this.set(this.picks, at_m);
    });
  }

  /// `asset`: the file of an asset without a scene, whose bone is not shown yet; none: the chosen scene's bone is shown.
  open(asset) {
    this.is_open = true;
    document.body.dataset.planning = "";
    this.asset = asset;
    this.picks = "entry";
    this.result = null;
    const file = asset ?? this.act.scene()?.file ?? "scene";
    by_id("plan-name").value = `${file.replace(/^.*\//, "").replace(/\.[a-z]+$/, "").replace(/[^\w-]/g, "_").slice(0, 24)}-new`;
    by_id("plan-bar").hidden = false;
    this.act.opened();
    this.#changed();
    by_id(asset ? "plan-name" : "plan-close").focus();
  }

  close() {
    if (!this.is_open || this.is_making) return;
    this.is_open = false;
    delete document.body.dataset.planning;
    this.points = {};
    by_id("plan-bar").hidden = true;
    this.#changed();
    by_id("plan-open").focus();
  }

  /// The bone that is shown, if points can be chosen on it.
  get bone() { return this.asset ? null : this.app.preview?.bone ?? null; }
  get rows() { return this.bone?.lps_mm_of_device ?? null; }

  choose(name) {
    this.picks = name;
    this.draw();
  }

  /// Another bone is shown: points of the one before mean nothing there.
  changed_bone() {
    if (this.bone === this.of) return;
    this.of = this.bone;
    this.points = {};
    this.picks = "entry";
    this.result = null;
    this.#changed();
  }

  set(name, at_m) {
    if (this.is_making || !this.rows) return;
    this.act.error("");
    this.points[name] = Array.from(at_m);
    if (name === "entry" && !this.points.target) this.picks = "target";
    this.result = null;
    this.#changed();
  }

  #typed(name, text) {
    const at_mm = read_point(text);
    if (at_mm && this.rows) return this.set(name, to_device(this.rows, at_mm));
    if (!text.trim() && name === "target") delete this.points.target;
    else if (text.trim()) this.act.error(`${text}: a point is three numbers in mm, such as 12.3, -4.5, 33`);
    this.#changed();
  }

  /// Moves the target along the way to this depth; without a target it lies straight below the entry.
  #deeper(depth_m) {
    if (!this.points.entry || !(depth_m > 0)) return this.#changed();
    this.set("target", along(this.points.entry, this.way(), depth_m));
  }

  /// The needle's way in, of unit length.
  way() {
    const { entry, target } = this.points;
    const way = entry && target ? minus(target, entry) : [0, 0, -1];
    return length(way) > 0 ? way.map((x) => x / length(way)) : [0, 0, -1];
  }

  /// The planned needle, for the planes of the CT; null if none is planned.
  needle() {
    if (!this.is_open || !this.bone) return null;
    const tip = this.points[this.picks] ?? this.points.entry;
    return tip ? { tip, axis: this.way().map((x) => -x), radius_m: this.bone.tool.radius_m } : null;
  }

  #changed() {
    const { entry, target } = this.points, depth_m = entry && target ? length(minus(target, entry)) : NaN;
    for (const name of ["entry", "target"]) by_id(`plan-${name}`).value = this.points[name] && this.rows ? point_text(to_patient(this.rows, this.points[name])) : "";
    by_id("plan-depth").value = Number.isFinite(depth_m) ? (1000 * depth_m).toFixed(1) : "";
    by_id("plan-depth").placeholder = entry ? (1000 * kDefaultDepth_m).toFixed(0) : "";
    this.app.view?.set_plan(this.is_open && entry ? { entry, end: target ?? along(entry, this.way(), kShown_m), target } : null);
    this.draw();
    this.act.changed();
  }

  /// Says what to do next.
  #words() {
    if (this.is_making) return this.state === "checking" ? "The scene is written, and is being checked." : "The scene is being made: a dry run tries it with the needle. This can take a minute.";
    if (this.asset) return "The needle enters where the bone of this asset is thickest. On the new scene you can then choose points yourself.";
    if (!this.act.scene()) return "Choose a scene, or New scene at an asset.";
    if (!this.bone) return "The bone is being loaded.";
    if (!this.rows) return "The slices of this scene do not lie as in the scan, so points cannot be chosen on it. Choose another scene, or New scene at an asset.";
    const { entry, target } = this.points;
    if (!entry) return "Click on the bone where the needle enters.";
    if (!target) return "Click on the bone, or in the CT planes, at the target; or give its depth. Without a target the needle goes straight down.";
    const tilt = Math.acos(Math.max(-1, Math.min(1, -this.way()[2]))) * 180 / Math.PI;
    return `The way is ${(1000 * length(minus(target, entry))).toFixed(1)} mm long, tilted by ${tilt.toFixed(1)}°. Click again to move the ${this.picks}.`;
  }

  draw() {
    if (!this.is_open) return;
    const has_points = Boolean(this.bone && this.rows), name = by_id("plan-name");
    by_id("plan-words").textContent = this.#words();
    for (const id of ["entry", "target"]) {
      by_id(`plan-pick-${id}`).setAttribute("aria-pressed", String(has_points && this.picks === id));
      by_id(`plan-pick-${id}`).disabled = by_id(`plan-${id}`).disabled = !has_points || this.is_making;
    }
    by_id("plan-depth").disabled = !this.points.entry || this.is_making;
    by_id("plan-points").hidden = Boolean(this.asset);
    const holds = this.act.device() === kInProcess;
    by_id("plan-live").disabled = !holds;
    by_id("plan-live-note").hidden = holds;
    by_id("plan-make").disabled = this.is_making || !this.act.is_free() || !name.value || !name.checkValidity() || !(this.asset || this.points.entry);
    by_id("plan-close").disabled = this.is_making;
    by_id("plan-stop").hidden = !this.is_making;
    this.#draw_result();
  }

  async make() {
    const mm = (name) => this.points[name] && to_patient(this.rows, this.points[name]).map((x) => Number(x.toFixed(3)));
    const body = { name: by_id("plan-name").value, device: this.act.device(), live_hand: by_id("plan-live").checked && !by_id("plan-live").disabled };
    if (this.asset) body.asset = this.asset;
    else Object.assign(body, { scene: this.act.scene().file, asset: this.act.asset(), entry_mm: mm("entry"), target_mm: mm("target") });
    this.is_making = true;
    this.state = "making";
    this.result = null;
    this.draw();
    try {
      await post("/api/new_scene", body);
      this.result = await this.#result();
    } catch (error) {
      this.result = { text: error.message };
    }
    const { result } = this;
    if (result.scene) {
      this.asset = undefined;
      await this.act.made(result.scene);
      this.result = result;  // choosing the scene has changed the bone
    }
    this.is_making = false;
    this.draw();
  }

  async #result() {
    for (;;) {
      await new Promise((done) => setTimeout(done, kAsk_ms));
      const told = await get_json("/api/new_scene");
      this.state = told.state;
      this.draw();
      if (told.state === "ended") return told;
    }
  }

  #draw_result() {
    const { result } = this;
    by_id("plan-result").hidden = !result;
    if (!result) return;
    const { scene, warnings, stopped, error } = result, last = (result.text ?? "").trim().split("\n").pop().replace(/^trocar-run: /, "");
    const findings = warnings?.length === 1 ? "The check has one finding:" : warnings?.length ? `The check has ${warnings.length} findings:` : warnings ? "The check found nothing wrong." : error ?? "It was not checked.";
    by_id("plan-verdict").textContent = scene ? `${scene} is written and chosen. ${findings}` : stopped ? "Stopped: no scene was written." : last;
    by_id("plan-verdict").dataset.level = !scene ? "bad" : warnings && !warnings.length ? "good" : "wait";
    by_id("plan-findings").replaceChildren(...(warnings ?? []).map((finding) => {
      const entry = document.createElement("li");
      entry.textContent = finding;
      return entry;
    }));
    by_id("plan-details").hidden = !scene;
    by_id("plan-text").textContent = [result.text, result.check].filter(Boolean).join("\n");
  }
}
