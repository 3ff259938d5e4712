// SPDX-License-Identifier: Apache-2.0
// Requests to the console by HTTP.
import { parse_container } from "./container.js";

const KEY = "trocar-token", kStopAnswer_ms = 1000;

// The token is in the link's fragment. It is removed from the address, which may be visible on a projector, and kept until the window
// is closed.
function take_token() {
  const given = location.hash.slice(1);
  if (given) {
    sessionStorage.setItem(KEY, given);
    history.replaceState(null, "", location.pathname);
  }
  return sessionStorage.getItem(KEY) ?? "";
}
export const token = take_token();
// A link with another token, opened in the tab of this page, changes the fragment only: the browser does not load the page again.
addEventListener("hashchange", () => { if (location.hash.length > 1) location.reload(); });

async function answer(path, options = {}) {
  const headers = { Authorization: `Bearer ${token}`, ...options.headers };
  const response = await fetch(path, { cache: "no-store", ...options, headers });
  if (response.ok) return response;
  if (response.status === 401) throw new Error("The token is wrong. Open the link that trocar-console printed.");
  let words = `${path}: the console answered ${response.status}`;
  try {
    words = (await response.json()).error ?? words;
  } catch { /* not JSON: the status has to suffice */ }
  throw new Error(words);
}

export const get_json = async (path) => (await answer(path)).json();
export const get_text = async (path) => (await answer(path)).text();
export const get_blob = async (path) => (await answer(path)).blob();
export const get_bytes = async (path) => (await answer(path)).arrayBuffer();
export const get_container = async (path) => parse_container(await get_bytes(path));
export const post = (path, body) =>
  answer(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });

/// Sends an emergency stop. It needs no token, and is sent even if the page is closing. Returns two promises: `answered` fails if there is no
/// answer within a second; `delivered` goes on waiting for it.
export function emergency_stop() {
  const delivered = answer("/api/emergency_stop", { method: "POST", keepalive: true });
  const late = new Promise((_, reject) => setTimeout(() => reject(new Error("the console does not answer")), kStopAnswer_ms));
  return { delivered, answered: Promise.race([delivered, late]) };
}

export const file_query = (path, values) => {
  const query = new URLSearchParams();
  for (const [name, value] of Object.entries(values)) if (value) query.set(name, value);
  return `${path}?${query}`;
};
