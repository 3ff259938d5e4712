// SPDX-License-Identifier: Apache-2.0
// The WebSocket to the console, and the heartbeat of the needle that the page holds, in a thread of their own: a slow frame of the page stops
// neither. The target goes on being sent while the page gives signs of life; after kStalled_ms without one the operator sees nothing any
// more, and the needle is let go.
//
// From the page: {open: URL, id}, {close: true}, {send: text}, {hold: target, grip} at each frame, {hold: null}. `grip` is the
// number of the taking: what comes late of one that has ended takes nothing.
// To the page: {id, opened: true}, {id, data}, {id, closed: code}, {id, stalled: true}.
const kRepeat_ms = 50, kStalled_ms = 1000;
let socket = null, id = 0, held = null, grip = 0, ended_grip = 0, number = 0, beating = null, sent_ms = 0, alive_ms = 0;

const send = (text) => { if (socket?.readyState === WebSocket.OPEN) socket.send(text); };

function send_hand() {
  sent_ms = performance.now();
  send(JSON.stringify({ hand: held, n: ++number }));
}

function release() {
  if (held) ended_grip = grip;
  held = null;
  clearInterval(beating);
}

function let_go() {
  if (!held) return;
  release();
  send(JSON.stringify({ hand: null }));
}

function beat() {
  const now = performance.now();
  if (now - alive_ms > kStalled_ms) {
    let_go();
    postMessage({ id, stalled: true });
  } else if (now - sent_ms > kRepeat_ms / 2) {
    send_hand();
  }
}

function hold(target, of) {
  if (!target) return let_go();
  if (of <= ended_grip) return;
  if (!held) beating = setInterval(beat, kRepeat_ms);
  held = target;
  grip = of;
  alive_ms = performance.now();
  send_hand();
}

function close() {
  release();
  const old = socket;
  socket = null;
  old?.close();
}

function open(url, new_id) {
  close();
  id = new_id;
  number = 0;  // it ascends within a connection
  const made = socket = new WebSocket(url);
  made.binaryType = "arraybuffer";
  made.onopen = () => postMessage({ id: new_id, opened: true });
  made.onmessage = ({ data }) => postMessage({ id: new_id, data }, typeof data === "string" ? [] : [data]);
  made.onclose = ({ code }) => {
    if (socket === made) close();
    postMessage({ id: new_id, closed: code });
  };
}

onmessage = ({ data: message }) => {
  if ("open" in message) open(message.open, message.id);
  if ("close" in message) close();
  if ("send" in message) send(message.send);
  if ("hold" in message) hold(message.hold, message.grip);
};
