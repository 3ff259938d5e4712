// SPDX-License-Identifier: Apache-2.0
// The devices that the console offers: the choice for a session, which this browser remembers, and the test of a device without force.
// Names come from the console's command line; they are set by textContent only.
import { get_json, post } from "./api.js";
import { by_id, element } from "./elements.js";

const kRemembered = "trocar-device", kInProcess = "inproc", kAsk_ms = 300;
const kWords = { [kInProcess]: "simulated in the process", sim: "simulated, a process of its own" };

export class Devices {
  /// `act` has the functions {changed(), error(error)}.
  constructor(act) {
    this.list = [];
    this.act = act;
    this.is_testing = false;
    by_id("start-device").addEventListener("change", (event) => {
      localStorage.setItem(kRemembered, event.target.value);
      act.changed();
    });
    by_id("test-open").addEventListener("click", () => this.open_test());
    by_id("test-start").addEventListener("click", () => this.test());
    by_id("test-stop").addEventListener("click", () => this.stop_test());
    by_id("test-close").addEventListener("click", () => {
      by_id("test-box").close();
      by_id("test-open").focus();
    });
  }

  /// `list`: `devices` of /api/folder. There is a choice unless the console offers the device in the process alone.
  show(list) {
    const name = this.list.length ? this.name : localStorage.getItem(kRemembered);
    this.list = list;
    by_id("device-choice").hidden = list.length === 1 && list[0].name === kInProcess;
    by_id("start-device").replaceChildren(...list.map((device) => new Option(this.words(device.name), device.name)));
    by_id("start-device").value = list.some((device) => device.name === name) ? name : list[0].name;
  }

  get name() { return by_id("start-device").value; }
  words(name) { return kWords[name] ?? (this.list.find((device) => device.name === name)?.simulated ? `${name} (simulated)` : name ?? ""); }

  /// Returns why a session of this scene cannot run with the chosen device; empty if it can.
  why_not(scene) {
    if (!scene?.live_hand || this.name === kInProcess) return "";
    const has = this.list.some(({ name }) => name === kInProcess);
    return `The needle of this scene is held from this page, which is for the device ${kWords[kInProcess]}. ` +
      (has ? "Choose that device, or another scene." : "The console offers it if it is started with --device inproc, too.");
  }

  draw(is_running, scene) {
    const why = this.why_not(scene);
    by_id("start-note").hidden = !why;
    if (by_id("start-note").textContent !== why) by_id("start-note").textContent = why;
    by_id("test-open").disabled = is_running || this.is_testing || !this.list.find(({ name }) => name === this.name)?.can_be_tested;
  }

  // ---- the test ----
  show_part(part) {
    for (const id of ["test-confirm", "test-running", "test-result"]) by_id(id).hidden = id !== part;
    by_id("test-close").disabled = part === "test-running";
    ({ "test-confirm": by_id("test-start"), "test-running": by_id("test-stop"), "test-result": by_id("test-close") })[part].focus();
  }

  open_test() {
    this.tested = this.name;
    by_id("test-device").textContent = this.words(this.tested);
    by_id("test-box").show();  // not modal, so that the emergency stop can still be pressed
    this.show_part("test-confirm");
  }

  async test() {
    this.is_testing = true;
    this.show_part("test-running");
    try {
      await post("/api/test", { device: this.tested });
      this.show_result(await this.result());
    } catch (error) {
      this.show_result({ text: error.message });
    }
    this.is_testing = false;
    this.act.changed();
  }

  async result() {
    for (;;) {
      await new Promise((done) => setTimeout(done, kAsk_ms));
      const told = await get_json("/api/test");
      if (told.state !== "running") return told;
    }
  }

  stop_test() { post("/api/command", { command: "stop" }).catch(this.act.error); }

  show_result({ result, text, stopped }) {
    const said = (text ?? "").trim(), last = said.split("\n").pop();
    const verdict = [stopped ? "The test was stopped before its end." : "", result?.verdict ?? (stopped ? "" : last)];
    by_id("test-verdict").textContent = verdict.filter(Boolean).join(" ");
    by_id("test-verdict").dataset.level = stopped ? "wait" : result?.holds ? "good" : "bad";
    by_id("test-troubles").replaceChildren(...(result?.troubles ?? []).map((trouble) => element("li", "", trouble)));
    by_id("test-summary").textContent = result ? "What was measured" : "What trocar-run said";
    by_id("test-numbers").textContent = result?.numbers ?? said;
    by_id("test-details").hidden = !by_id("test-numbers").textContent || (!result && said === last);
    by_id("test-details").open = false;
    this.show_part("test-result");
  }
}
