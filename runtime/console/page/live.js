// SPDX-License-Identifier: Apache-2.0
// What comes from the console: hello, events, states, snapshots and meshes. The WebSocket itself is in a worker (live_worker.js). It is
// closed while the page is hidden and opened again afterwards, so that the page continues with the present state. It requests the events that it has missed by their number.
import { token } from "./api.js";

const kSnapshot = 1, kSheet = 2, kShape = 3, kHistory = 4, kTryAgainLater = 1013;
const kNoConnection_ms = 2000, kStall_ms = 500;

export class Live {
  /// `on` has the functions {hello, history, snapshot, sheet, shape, events, missed, state, hand, stalled, down}.
  constructor(on) {
    this.on = on;
    this.worker = new Worker(new URL("./live_worker.js", import.meta.url), { type: "module" });
    this.worker.onmessage = ({ data }) => this.#take(data);
    this.worker.onerror = () => on.down(false, false);
    this.opened = 0;      // number of the present or last connection
    this.is_open = false;
    this.session = null;  // its ID; "": no session has begun
    this.last_event = 0;
    this.wait_ms = 250;
    this.to_ack = 0;
    this.is_wanted = false;
    document.addEventListener("visibilitychange", () => (document.hidden ? this.close() : this.open()));
    if (!document.hidden) this.open();
  }

  open() {
    clearTimeout(this.timer);
    if (this.is_wanted) return;
    this.is_wanted = true;
    this.to_ack = 0;
    this.worker.postMessage({ open: `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`, id: ++this.opened });
  }

  close() {
    clearTimeout(this.timer);
    this.is_wanted = this.is_open = false;
    this.worker.postMessage({ close: true });
  }

  /// A message of the worker; one of an earlier connection says nothing any more.
  #take({ id, opened, data, closed, stalled }) {
    if (id !== this.opened || !this.is_wanted) return;
    if (opened) {
      this.is_open = true;
      const first = { token };
      if (this.session) Object.assign(first, { session: this.session, last_event: this.last_event });
      this.#send(first);
    }
    if (stalled) this.on.stalled();
    if (closed !== undefined) this.#closed(closed);
    if (data === undefined) return;
    this.heard_ms = performance.now();
    if (typeof data === "string") this.text(JSON.parse(data));
    else this.binary(data);
  }

  #closed(code) {
    this.is_wanted = this.is_open = false;
    const is_refused = code === 1008;
    this.on.down(is_refused, code === kTryAgainLater);
    if (document.hidden || is_refused) return;
    this.timer = setTimeout(() => this.open(), this.wait_ms);
    this.wait_ms = Math.min(2 * this.wait_ms, 2000);
  }

  /// The caller calls this once per frame while snapshots must come. If none comes, the console stalls, or the network is broken, and the
  /// connection itself may say nothing about that for minutes: then it is opened again. (A frame's own time may be from before it stood still.)
  watch() {
    const now = performance.now();
    if (!(now - this.watched_ms < kStall_ms)) this.heard_ms = now;  // this page stood still
    this.watched_ms = now;
    if (now - this.heard_ms < kNoConnection_ms) return;
    this.close();
    this.open();
    this.on.down(false, false);
  }

  /// The caller calls this once per frame. It acknowledges what has been shown, so that the console sends less to a slow page.
  ack() {
    if (!this.to_ack || !this.is_open) return;
    this.#send({ ack: this.to_ack });
    this.to_ack = 0;
  }

  #send(message) { this.worker.postMessage({ send: JSON.stringify(message) }); }

  /// Holds the needle at a target (protocol.md), which the worker repeats, or lets it go (null). `grip`: number of the taking; a taking that
  /// has ended, by the page or by the worker, does not begin again.
  hold(target, grip) { this.worker.postMessage({ hold: target, grip }); }

  text(message) {
    this.wait_ms = 250;
    if ("hello" in message) {
      const id = message.session ?? null;
      const is_new = id !== this.session;
      if (is_new) this.last_event = 0;
      this.session = id;
      this.on.hello(message, is_new);
    }
    if (message.missed) this.on.missed(message.missed);
    if (message.events) {
      const fresh = message.events.filter((event) => event.seq > this.last_event);
      if (fresh.length) this.last_event = fresh[fresh.length - 1].seq;
      this.on.events(fresh);
    }
    if (message.state) this.on.state(message);
    if (message.hand) this.on.hand(message.hand);
  }

  binary(data) {
    const view = new DataView(data);
    const kind = view.getUint32(0, true);
    this.to_ack = view.getUint32(4, true);
    if (kind === kHistory) this.on.history(new Float64Array(data, 8));
    if (kind === kSnapshot) this.on.snapshot(new Float64Array(data, 8));
    if (kind !== kSheet && kind !== kShape) return;
    const vertices = view.getUint32(20, true), triangles = view.getUint32(24, true), has_hu = view.getUint32(28, true);
    const width = kind === kShape ? 3 : 2;
    const hu_at = 32 + 4 * width * vertices;
    const mesh = {
      sheet: view.getUint32(8, true),
      cuts: view.getUint32(12, true),
      slice: view.getInt32(16, true),
      positions: new Float32Array(data, 32, width * vertices),
      hu: has_hu ? new Float32Array(data, hu_at, vertices) : null,
      triangles: new Uint32Array(data, hu_at + (has_hu ? 4 * vertices : 0), 3 * triangles),
    };
    if (kind === kSheet) this.on.sheet(mesh);
    else this.on.shape(mesh);
  }
}
