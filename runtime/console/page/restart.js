// SPDX-License-Identifier: Apache-2.0
// Restart ends the session that runs, and starts the same again once it has ended. Every other command withdraws a Restart that still waits,
// and so do an emergency stop of any page, a lost connection and a hidden page: no session begins that nobody wants any more.
import { post } from "./api.js";

export class Restart {
  next = null;  // what is started at the end of the session

  /// `act`: {request(): the body of /api/start for the same session or undefined, fields(): its trainee, is_running(), start(body)}.
  constructor(act) { this.act = act; }

  async press() {
    const request = this.act.request();
    if (!request) return;
    const next = { ...request, ...this.act.fields() };
    if (!this.act.is_running()) return this.act.start(next);
    this.next = next;
    try {
      await post("/api/command", { command: "stop" });
    } catch (error) {
      this.withdraw();
      throw error;
    }
  }

  withdraw() { this.next = null; }

  /// No session runs any more; the message is that of /live. `emergency_stop`: one came while the session ended, when it gives no fault.
  session_over({ state, emergency_stop }) {
    const { next } = this;
    this.withdraw();
    if (next && state === "ended" && !emergency_stop) this.act.start(next);
  }
}
