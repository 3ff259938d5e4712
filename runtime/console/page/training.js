// SPDX-License-Identifier: Apache-2.0
// The record of learning: who does the next session (kept in the browser), and the ghost of a recording beside the tool of a session.
import { file_query, get_container } from "./api.js";
import { by_id } from "./elements.js";
import { NumberField } from "./numbers.js";
import { Recorded } from "./playback.js";

const kFields = ["trainee", "course", "attempt"];

export class Training {
  /// `app`: that of main.js.
  constructor(app) {
    this.app = app;
    for (const name of kFields) {
      const field = by_id(`start-${name}`);
      field.value = localStorage.getItem(`trocar-${name}`) ?? "";
      field.addEventListener("input", () => {
        localStorage.setItem(`trocar-${name}`, field.value);
        // Another trainee or course begins anew. Without both there is nothing to count.
        if (name !== "attempt") this.set_attempt(by_id("start-trainee").value || by_id("start-course").value ? 1 : null);
      });
    }
    this.attempt = new NumberField("start-attempt");
  }

  /// Returns what the form says, for /api/start.
  fields() {
    const said = {};
    for (const name of kFields) if (by_id(`start-${name}`).value) said[name] = name === "attempt" ? this.attempt.value : by_id(`start-${name}`).value;
    return said;
  }
  /// A session has started: the next one is the next attempt.
  started({ attempt }) {
    if (!attempt || attempt >= 9999) return;
    this.set_attempt(attempt + 1);
  }
  set_attempt(attempt) {
    this.attempt.value = attempt;
    localStorage.setItem("trocar-attempt", String(attempt ?? ""));
  }

  async choose_ghost(file) {
    this.ghost = null;
    if (this.app.live) this.app.live.second = null;
    this.app.changed();
    if (!file) return;
    const ghost = new Recorded(await get_container(file_query("/api/recording", { file })));
    if (by_id("ghost").value === file) this.ghost = ghost;
  }
  /// Moves the ghost to the session's time. It begins with each session anew, and stays where its recording ends.
  follow(live) {
    if (!this.ghost || !live.bone) return;
    if (live.second !== this.ghost) {
      this.ghost.set_bone(live.bone);
      live.second = this.ghost;
    }
    this.ghost.go_to(live.value("t_s"));
  }
}
