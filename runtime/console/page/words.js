// SPDX-License-Identifier: Apache-2.0
// Describes the state in words, and says what to do.

export const kRunning = 2, kFault = 3, kRecovering = 4;  // SafetyState
const kLowSpace_min = 10;
const kContact = 1, kPunctured = 2, kMissed = 3;          // ContactPhase
const kOperators = { paused: ["Paused", "Torques are zero and time is stopped. Press Resume to continue."],
  forces_off: ["Forces off", "Torques are zero, the tool moves freely and time continues. Press Recover for forces."] };

/// True of a stop that the operator wanted: a pause, or forces switched off. It is no fault.
export const is_by_operator = ({ kind, fault }) => kind === "fault" && fault in kOperators;

/// True if the session is paused. `shown`: its rows and events, or null. After a pause, a row from before it says nothing: until the first
/// row after it has come, the session still counts as paused.
export function is_paused(state, shown) {
  const resumed = shown?.events.findLast?.(({ kind }) => kind === "resumed");
  return state.state === "paused" || Boolean(shown?.value("paused", 0)) || shown?.value("t_s") <= resumed?.t_s;
}

/// Returns the last fault that no recovery has ended, or null.
function last_fault(events) {
  const last = events.filter(({ kind }) => kind === "recovered" || kind === "fault").at(-1);
  return last?.kind === "fault" ? last : null;
}

const sentence = (words) => (words ? words[0].toUpperCase() + words.slice(1) + (/[.!?]$/.test(words) ? "" : ".") : "");

function fault_words(event) {
  if (!event) return "A fault whose message this page has not received; the terminal of the session has it.";
  if (!event.meaning) return sentence(event.text ?? "");
  const measured = event.measured ? ` (${event.measured})` : "";
  return `${sentence(event.meaning + measured)} ${sentence(event.advice)}`;
}

function contact_words(shown) {
  const slice = shown.value("active_slice", -1), phase = shown.value("phase", 0);
  if (shown.about.force_law === "cutting" && shown.value("embedded_m", 0) > 0) return `The tool is in the bone, ${(1000 * shown.value("embedded_m")).toFixed(1)} mm of it.`;
  if (phase === kContact) return `The tool presses on slice ${slice}.`;
  if (phase === kPunctured) return "The tip is below the slice that was punctured last.";
  if (phase === kMissed) return "The tip is below a slice, past the edge of its material.";
  return "The tool touches nothing.";
}

/// A sentence if the disk has space for less than ten minutes of recording.
function disk_words(shown) {
  const left_min = Math.floor(shown.value("recording_left_s", Infinity) / 60);
  if (!(left_min < kLowSpace_min)) return "";
  return `The disk has space for ${left_min < 1 ? "less than a minute" : left_min === 1 ? "about 1 minute" : `about ${left_min} minutes`} of recording; then the session ends.`;
}

/// Describes the session's state as {level: good | wait | bad, state, words}, from the console's state and the latest row. `has_begun`: the
/// console's last session began. After its end, the page may show another bone and not the session (`shown` is null).
export function describe(facts) {
  const said = describe_state(facts), { shown, state, is_connected } = facts;
  const disk = is_connected && shown && ["running", "paused"].includes(state.state) ? disk_words(shown) : "";
  return disk ? { level: said.level === "good" ? "wait" : said.level, state: said.state, words: `${disk} ${said.words}` } : said;
}

function describe_state({ has_begun, shown, state, is_connected, is_refused, is_full }) {
  if (is_refused) return { level: "bad", state: "Refused", words: "The console refused this page. Open the link that trocar-console printed." };
  if (!is_connected && is_full) return { level: "wait", state: "No place", words: "As many pages watch as the console admits. This page tries again by itself." };
  if (!is_connected) return { level: "bad", state: "No connection", words: "The console does not answer; the session may continue. This page connects again by itself. Start trocar-console again if it ended." };
  const said = sentence(state.message ?? ""), message = /^(Ended|Paused|Running|Idle)\.$/.test(said) ? "" : said;
  if (state.state === "lost") return { level: "bad", state: "Session lost", words: `${message} Use the device's emergency stop if forces persist.` };
  if (state.state === "starting") return { level: "wait", state: "Starting", words: message };
  if (state.state === "ended" && !shown) {
    if (has_begun) return { level: state.exit_code > 0 ? "bad" : "wait", state: "Ended", words: message || "The session has ended." };
    return { level: "bad", state: "Not started", words: message || "The session ended before it began." };
  }
  if (state.state === "idle" || !shown) return { level: "wait", state: "Idle", words: message || "No session runs. Choose a scene in Folder and press Start." };
  const event = last_fault(shown.events);
  if (state.state === "ended") {
    const is_fault = event && !(event.fault in kOperators);
    return { level: is_fault || state.exit_code > 0 ? "bad" : "wait", state: "Ended", words: [message || "The session has ended.", is_fault ? `Fault ${event.fault}: ${fault_words(event)}` : ""].filter(Boolean).join(" ") };
  }
  if (state.state === "silent") return { level: "bad", state: "No answer", words: "The session has stated nothing for more than 0.2 s: force and picture are old. Draw the tool out slowly. If this stays, press Emergency stop, which ends a session that does not answer." };
  const safety = shown.value("safety", 0);
  if (is_paused(state, shown)) return { level: "wait", state: kOperators.paused[0], words: kOperators.paused[1] };
  if (safety === kRecovering) {
    const refused = shown.events.findLast?.(({ kind }) => kind === "not_recovered" || kind === "recovered" || kind === "fault");
    const why = refused?.kind === "not_recovered" ? `Not yet: ${refused.text}` : "Torques are zero until the cause is gone.";
    return { level: "wait", state: "Recovering", words: why };
  }
  if (safety === kFault || shown.value("fault", 0)) {
    const latest = shown.events.findLast?.(({ kind }) => kind === "recovery_refused" || kind === "recovered" || kind === "fault");
    if (latest?.kind === "recovery_refused") return { level: "bad", state: "Emergency stop", words: `Refused: ${sentence(latest.why)} Torques are zero, and stay so. To ask again, press Release the stop.` };
    // A pause that has ended leaves the forces off if they were switched off during it.
    const wanted = kOperators[event?.fault === "paused" ? "forces_off" : event?.fault];
    if (wanted) return { level: "wait", state: wanted[0], words: wanted[1] };
    if (event?.fault === "emergency_stop") return { level: "bad", state: "Emergency stop", words: "Torques are zero, and stay so. Release the device's own stop if it was that one; then press Release the stop." };
    const name = event?.fault ? `Fault: ${event.fault.replaceAll("_", " ")}` : "Fault";
    return { level: "bad", state: name, words: `${fault_words(event)} Torques are zero.${event?.fault === "recording_failed" ? "" : " Then press Recover."}` };
  }
  if (safety !== kRunning) return { level: "wait", state: "Ready", words: "Torques are zero; nothing has been rendered yet." };
  const guard = shown.value("guard", 1);
  if (guard < 1) return { level: "wait", state: "Softened", words: `The contact oscillated by itself: forces are at ${(100 * guard).toFixed(0)} % until the tool is free. The device is slower or noisier than its description says; measure it with trocar-run test.` };
  const authority = shown.value("authority", 1);
  const words = authority < 1 ? `Forces return after the recovery: ${(100 * authority).toFixed(0)} % now.` : contact_words(shown);
  return { level: "good", state: "Running", words };
}
