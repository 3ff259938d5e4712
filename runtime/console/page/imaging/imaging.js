// SPDX-License-Identifier: Apache-2.0
// The pictures beside the 3D view: X-ray and planes of the CT. They load the scan when they are opened first.
import { file_query, get_bytes } from "../api.js";
import { parse_container } from "../container.js";
import { axis_of } from "../data.js";
import { by_id } from "../elements.js";
import { CtPlanes } from "./ct_planes.js";
import { read_volume } from "./volume.js";
import { Xray } from "./xray.js";

export class Imaging {
  /// `act`: {source(): the Shown, tab(), is_running(), is_operator(), scene(): the file whose scan is shown outside of a
  /// session, asset(), is_planning(), plan(): the planned needle or null, pick(position), changed(), error(words)}.
  constructor(act) {
    this.act = act;
    const needle = () => this.needle();
    this.xray = new Xray({ needle, is_operator: act.is_operator, mode: () => this.mode(), error: act.error });
    this.ct = new CtPlanes({ needle, pick: act.pick, error: act.error });
    this.open = "";
    for (const button of document.querySelectorAll("[data-picture]"))
      button.addEventListener("click", () => this.show(this.open === button.dataset.picture ? "" : button.dataset.picture));
    this.show("");
  }

  /// "live" in a session, "playback" in a recording; "none" elsewhere.
  mode() {
    if (this.act.tab() === "playback") return "playback";
    return this.act.tab() === "session" && this.act.is_running() ? "live" : "none";
  }

  show(name) {
    this.open = name;
    by_id("pictures").hidden = !name;
    by_id("xray-box").hidden = name !== "xray";
    by_id("ct-box").hidden = name !== "ct";
    for (const button of document.querySelectorAll("[data-picture]")) button.setAttribute("aria-pressed", String(button.dataset.picture === name));
    this.#load();
    this.act.changed();
  }

  /// The needle in {B}; null before the device has been read.
  needle() {
    const plan = this.act.plan();
    if (plan) return plan;
    const source = this.act.source();
    if (!source?.row || !source.bone || !source.is_placed()) return null;
    return { tip: Array.from(source.values("tool_m")), axis: axis_of(source), radius_m: source.bone.tool.radius_m };
  }

  /// Loads the scan of what is shown, if a picture is open and it is another scan than before. Without a bone nothing stays of the scan
  /// before, which may be another patient's.
  async #load() {
    const source = this.act.source(), bone = source?.bone ?? null;
    if (!this.open || (this.act.tab() === "folder" && !this.act.is_planning()) || bone === this.loaded) return;
    this.loaded = bone;
    this.#set(null, null, bone ? "The scan is being loaded." : "");
    if (!bone) return;
    const path = this.act.tab() === "playback" || source.is_preview ? file_query("/api/volume", { scene: this.act.scene(), asset: this.act.asset() }) : "/api/volume?session=1";
    try {
      const container = await get_bytes(path);
      if (this.loaded !== bone) return;
      const volume = read_volume(parse_container(container));
      this.#set(volume, container, volume.bone ? "" : `There is no X-ray and no CT. ${volume.why ?? ""}`);
    } catch (error) {
      if (this.loaded !== bone) return;
      this.#set(null, null, error.message);
      this.loaded = undefined;  // opening the pictures again tries again
    }
    this.act.changed();
  }

  #set(volume, container, why) {
    this.why = why;
    this.volume = volume;
    this.ct.set_volume(volume);
    this.xray.set_volume(volume, container);
  }

  /// Another session has begun.
  new_session() {
    this.xray.new_session();
    this.#load();
  }
  /// Another source is shown, or its bone has come.
  changed_source() { this.#load(); }
  /// The row of a session may be newer than an event.
  take_events(events) {
    this.xray.take_events(events);
    this.take_row();
  }
  /// The session has another row.
  take_row() { this.xray.take_row(this.act.source()?.value("t_s")); }
  frame(now) {
    if (!this.open) return;
    this.xray.frame(now);
    this.ct.frame(now);
  }

  draw() {
    if (!this.open) return;
    const source = this.act.source(), takes = source?.about.xray !== false || this.mode() !== "live";
    const none = !source ? "Start a session, or open a recording." : this.volume ? "" : "No scan is loaded.";
    const why = this.why || none || (takes ? "" : "This session takes no X-ray: it was started without --xray.");
    this.xray.draw({ shots: source?.value("xray_shots") ?? NaN, seconds: source?.value("xray_screening_s") ?? NaN, why });
    const target = source?.bone?.goals?.target, tip = this.needle()?.tip;
    const target_mm = target && tip ? 1000 * Math.hypot(...target.at_m.map((at, k) => at - tip[k])) : NaN;
    this.ct.draw({ depth_mm: source?.depth_mm(), target_mm, why });
  }
}
