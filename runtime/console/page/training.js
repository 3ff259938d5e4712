// SPDX-License-Identifier: Apache-2.0
// The record of learning: who does the next session (kept in the browser), the history of the folder's sessions, and the ghost of a
// recording beside the tool of a session.
// Tests: tests/e2e/console_page_test.py
import { file_query, get_blob, get_container } from "./api.js";
import { by_id } from "./elements.js";
import { Recorded } from "./playback.js";

const kFields = ["trainee", "course", "attempt"];

export class Training {
  /// `act` has the functions {show_page(blob, title), error(error), changed()}. `app`: that of main.js.
  constructor(app, act) {
    this.app = app;
    this.act = act;
    for (const name of kFields) {
      const field = by_id(`start-${name}`);
      field.value = localStorage.getItem(`trocar-${name}`) ?? "";
      field.addEventListener("input", () => {
        localStorage.setItem(`trocar-${name}`, field.value);
        // Another trainee or course begins anew. Without both there is nothing to count.
        if (name !== "attempt") this.set_attempt(by_id("start-trainee").value || by_id("start-course").value ? 1 : "");
      });
    }
    by_id("open-history").addEventListener("click", async () => {
      try {
        act.show_page(await get_blob("/api/history"), "History of sessions");
      } catch (error) {
        act.error(error);
      }
    });
    by_id("ghost").addEventListener("change", (event) => this.choose_ghost(event.target.value));
  }

  /// Returns what the form says, for /api/start.
  fields() {
    const said = {};
    for (const name of kFields) if (by_id(`start-${name}`).value) said[name] = name === "attempt" ? Number(by_id(`start-${name}`).value) : by_id(`start-${name}`).value;
    return said;
  }
  /// A session has started: the next one is the next attempt.
  started({ attempt }) {
    if (!attempt || attempt >= 9999) return;
    this.set_attempt(attempt + 1);
  }
  set_attempt(attempt) {
    by_id("start-attempt").value = String(attempt);
    localStorage.setItem("trocar-attempt", String(attempt));
  }

  async choose_ghost(file) {
    this.ghost = null;
    if (this.app.live) this.app.live.second = null;
    this.act.changed();
    if (!file) return;
    try {
      const ghost = new Recorded(await get_container(file_query("/api/recording", { file })));
      if (by_id("ghost").value === file) this.ghost = ghost;
    } catch (error) {
      this.act.error(error);
    }
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
