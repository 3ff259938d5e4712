// SPDX-License-Identifier: Apache-2.0
// The folder's scenes, recordings and assets. Names come from files, so they are set by textContent only.
import { by_id, element, set_options } from "./elements.js";

function item({ file, error }, lines, buttons = []) {
  const entry = element("li");
  entry.append(element("div", "file", file));
  if (error) entry.append(element("div", "error", error));
  for (const line of lines.filter(Boolean)) entry.append(element("div", "about", line));
  if (buttons.length) {
    const box = element("div", "buttons");
    for (const [text, act] of buttons) {
      const button = element("button", "", text);
      button.type = "button";
      button.addEventListener("click", act);
      box.append(button);
    }
    entry.append(box);
  }
  return entry;
}

const seconds = (value) => (Number.isFinite(value) ? `${Number(value.toFixed(2))} s` : "");
/// The time in the name of a session's folder, as other times on the page: UTC.
function time_in(file) {
  const parts = /^sessions\/(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d)Z-/.exec(file);
  return parts ? `${parts[1]}-${parts[2]}-${parts[3]}T${parts[4]}:${parts[5]}:${parts[6]}Z` : "";
}
const count_of = (slices) => (Array.isArray(slices) ? slices.length : slices);
const slices_in = ({ slices, body }) => (count_of(slices) || !body ? slices : body.to - body.from + 1);
const slices_of = (slices) => (count_of(slices) === 1 ? "1 slice" : `${count_of(slices)} slices`);

/// The scene that is chosen before the operator chooses one: one with whole bone, because it shows the most.
function first_choice(scenes) {
  const complete = scenes.filter(({ asset_missing }) => !asset_missing);
  return complete.find(({ force_law }) => force_law === "cutting") ?? complete[0] ?? scenes[0];
}

export class Folder {
  /// `act` has the functions {choose(scene), play(recording), compare(recording), report(recording), device_words(name), new_scene(asset), may_make: true if the page may make a scene}.
  constructor(act) {
    this.act = act;
    this.data = { scenes: [], assets: [], recordings: [] };
    this.chosen = null;
    by_id("start-scene").addEventListener("change", (event) => this.choose(event.target.value));
    by_id("start-asset").addEventListener("change", () => this.act.choose(this.scene(this.chosen), this.asset()));
  }
  scene(file) { return this.data.scenes.find((scene) => scene.file === file); }
  asset() { return by_id("start-asset").value || undefined; }

  show(data) {
    this.data = data;
    const good = data.scenes.filter(({ error }) => !error);
    const scene_options = good.map(({ file, name }) => new Option(name ? `${name} (${file})` : file, file));
    by_id("start-scene").replaceChildren(...scene_options);
    const assets = [new Option("the scene's", ""), ...data.assets.filter(({ error }) => !error).map(({ file }) => new Option(file, file))];
    set_options(by_id("start-asset"), assets);
    if (!good.some(({ file }) => file === this.chosen)) this.chosen = first_choice(good)?.file ?? null;
    by_id("start-scene").value = this.chosen ?? "";
    by_id("start").disabled = !this.chosen;
    this.list();
  }

  /// A needle that is held from this page needs real time.
  limit_choices() {
    const is_live = Boolean(this.scene(this.chosen)?.live_hand), clock = by_id("start-clock");
    if (clock.disabled !== is_live) clock.value = "";
    clock.disabled = is_live;
  }

  choose(file) {
    this.chosen = file;
    by_id("start-scene").value = file;
    this.list();
    return this.act.choose(this.scene(file), this.asset());
  }

  list() {
    const { scenes, assets, recordings, truncated } = this.data;
    this.limit_choices();
    by_id("scenes").replaceChildren(...scenes.map((scene) => {
      if (scene.error) return item(scene, []);
      const entry = item(scene, [scene.name, `${slices_of(slices_in(scene))}, ${scene.force_law}, ${seconds(scene.duration_s)}`,
        scene.live_hand ? "the needle is held from this page" : "", scene.asset_missing ? `its asset ${scene.asset} is missing: choose another above` : `asset ${scene.asset}`], [["Show", () => this.choose(scene.file)]]);
      if (scene.file === this.chosen) entry.setAttribute("aria-current", "true");
      return entry;
    }));
    // The names of sessions begin with their time, so the reverse order has the newest first.
    const is_session = ({ file }) => file.startsWith("sessions/");
    const newest_first = [...recordings.filter(is_session).reverse(), ...recordings.filter((recording) => !is_session(recording))];
    by_id("recordings").replaceChildren(...newest_first.map((recording) => {
      if (recording.error) return item(recording, []);
      const buttons = [["Play", () => this.act.play(recording)], ["Compare", () => this.act.compare(recording)]];
      if (recording.report !== undefined) buttons.push(["Report", () => this.act.report(recording)]);
      return item(recording, [time_in(recording.file), recording.partial ? "its session did not end properly: it was killed, or the computer stopped" : "", `${seconds(recording.duration_s)}, ${recording.ticks} ticks`, recording.scene ? `scene ${recording.scene}` : "its scene is not in this folder",
        recording.device ? `device: ${this.act.device_words(recording.device)}` : ""], buttons);
    }));
    by_id("assets").replaceChildren(...assets.map((asset) => (asset.error ? item(asset, []) :
      item(asset, [`${slices_of(asset.slices)}, ${(asset.extent_mm ?? []).map((mm) => mm.toFixed(0)).join(" x ")} mm`, asset.surface_triangles ? `surface of ${asset.surface_triangles} triangles` : "no surface"],
        this.act.may_make ? [["New scene", () => this.act.new_scene(asset.file)]] : []))));
    if (truncated) by_id("recordings").append(item({ file: "More files are in the folder than are shown here." }, []));
  }
}
