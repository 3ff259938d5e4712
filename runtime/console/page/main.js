// SPDX-License-Identifier: Apache-2.0
// Connects the parts of the page: the source that is shown (a session or a recording), buttons, keys, and the loop that draws.
import { emergency_stop, file_query, get_blob, get_container, get_json, post } from "./api.js";
import { Charts } from "./charts.js";
import { Shown, read_bone } from "./data.js";
import { Devices } from "./devices.js";
import { by_id, set_options } from "./elements.js";
import { Folder } from "./folder.js";
import { Gauges } from "./gauges.js";
import { Goals } from "./goals.js";
import { Hand } from "./hand/hand.js";
import { Imaging } from "./imaging/imaging.js";
import { inspection_of } from "./inspection.js";
import { listen_to_keys, take_keys_back } from "./keys.js";
import { Live } from "./live.js";
import { Notices } from "./notices.js";
import { NumberField } from "./numbers.js";
import { Planning } from "./planning/planning.js";
import { Playback } from "./playback.js";
import { Restart } from "./restart.js";
import { Training } from "./training.js";
import { View3d } from "./view/view3d.js";
import { describe, is_paused, kFault, kRecovering } from "./words.js";

const kPanels_ms = 100, kSlowPanels_ms = 250, kRefresh_ms = 5000, kOld_ms = 300, kViewBesideXray_ms = 150, kViewBesidePictures_ms = 60;

const app = {
  role: "view", tab: "folder", connected: false, refused: false, state: { state: "idle", message: "" },
  live: null,          // the Shown of the session
  preview: null,       // a Shown that has only the bone of the chosen scene
  playback: new Playback(), has_moved: true, panels_are_old: true, bone_key: "",
  refreshes: 0,        // requests for the folder that wait for their answer
};

/// Requests drawing. The view is drawn in the next frame, and the panels at most kPanels_ms later (kSlowPanels_ms if frames
/// are slow).
function changed() {
  app.has_moved = app.panels_are_old = true;
}

// ---- theme ----
function set_theme(name) {
  document.documentElement.dataset.theme = name;
  by_id("theme").textContent = name === "dark" ? "Light" : "Dark";
  localStorage.setItem("trocar-theme", name);
  app.view?.set_theme();
  app.charts?.set_theme();
  app.hand?.set_theme();
}
document.documentElement.dataset.theme = localStorage.getItem("trocar-theme") ?? (matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark");
by_id("theme").textContent = document.documentElement.dataset.theme === "dark" ? "Light" : "Dark";
by_id("theme").addEventListener("click", () => set_theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"));

try {
  app.view = new View3d(by_id("canvas-box"), by_id("canvas"));
} catch (error) {
  by_id("legend").hidden = true;
  console.warn(error);
}
if (app.view)
  app.view.on_context = () => {
    const { is_lost } = app.view;
    if (is_lost) app.hand?.let_go("The picture was lost, so the needle was let go.");
    else app.hand?.say("");
    notices.say("view", is_lost && "The view is blank, because the graphics of this machine were reset. It comes back by itself; if not, reload this page. The session goes on.", { lasts: true });
    changed();
  };
app.charts = new Charts();
app.gauges = new Gauges();
app.changed = changed;
app.goals = new Goals(app);

/// Returns the session's name if the file is a session's recording; otherwise the file's name.
const short = (file) => file.replace(/^sessions\//, "").replace(/\/session\.csv(\.partial)?$/, "");

// ---- what is shown ----
const shown = () => (app.tab === "playback" ? app.playback.first : app.live ?? app.preview);

/// Passes the bone of the shown source to the view, and applies the sheets and shapes that have come earlier.
function show_bone() {
  const source = shown();
  app.view?.set_bone(source?.bone ?? null);
  if (source && source === app.live && source.bone) {
    for (const sheet of source.sheets.values()) app.view?.set_sheet(sheet);
    if (source.shape) app.view?.set_shape(source.shape);
  }
  if (app.tab === "playback" && app.playback.first?.bone) app.view?.set_marks(app.playback.marks);
  planning.changed_bone();
  app.imaging?.changed_source();
  changed();
}

function set_tab(name) {
  app.tab = name;
  document.body.dataset.tab = name;
  for (const button of document.querySelectorAll("nav button")) button.setAttribute("aria-pressed", String(button.dataset.to === name));
  by_id("player").hidden = name !== "playback";
  show_bone();
  if (name !== "folder") planning.close();
  if (name !== "session") refresh();
}
for (const button of document.querySelectorAll("nav button")) button.addEventListener("click", () => set_tab(button.dataset.to));

function set_view(name) {
  app.view?.set_view(name);
  for (const button of document.querySelectorAll("[data-view]")) button.setAttribute("aria-pressed", String(button.dataset.view === name));
  changed();
}
for (const button of document.querySelectorAll("[data-view]")) button.addEventListener("click", () => set_view(button.dataset.view));
by_id("shown").addEventListener("change", (event) => {
  app.view?.set_mode(event.target.value);
  changed();
});

const notices = new Notices(() => draw_status());
const notice = (what) => notices.say("page", what);
/// Returns `act` with its errors as notices, which end when it succeeds.
const guarded = (act) => async (...values) => {
  try {
    await act(...values);
    notices.end(act);
  } catch (error) {
    notices.say(act, error);
  }
};

// ---- folder ----
const preview = guarded(async (scene, asset) => {
  if (!scene || app.live && is_running()) return;
  const key = `${scene.file} ${asset ?? ""}`;
  if (app.bone_key === key && app.preview && !app.live) return;
  app.bone_key = key;
  if (scene.asset_missing && !asset) return;
  const made = Object.assign(new Shown([], { force_law: scene.force_law }), { is_preview: true, scene: scene.file, asset });
  made.bone = read_bone(await get_container(file_query("/api/bone", { scene: scene.file, asset })));
  if (app.bone_key !== key) return;
  app.preview = made;
  app.live = null;
  if (app.tab !== "playback") show_bone();
});
const devices = new Devices({ changed: () => (notice(""), changed()), error: notice });
const folder = new Folder({
  device_words: (name) => devices.words(name),
  choose: (scene, asset) => {
    changed();
    return preview(scene, asset);
  },
  play: (recording) => play(recording),
  compare: (recording) => compare(recording),
  report: (recording) => open_report(recording.report ?? recording.file, recording.device),
  new_scene: (asset) => planning.open(asset),
  get may_make() { return app.role === "operator"; },
});
const planning = app.planning = new Planning(app, { changed, error: notice, scene: () => folder.scene(folder.chosen), device: () => devices.name || "inproc",
  show: () => folder.chosen && folder.choose(folder.chosen),
  is_free: () => !is_running(), opened: () => app.imaging.show(app.imaging.open === "xray" ? "" : app.imaging.open), made: async (file) => {
    await refresh();
    by_id("start-asset").value = "";  // the new scene is for its own asset
    await folder.choose(file);
  } });
const training = new Training(app);
by_id("ghost").addEventListener("change", guarded((event) => training.choose_ghost(event.target.value)));
by_id("open-history").addEventListener("click", guarded(async () => show_page(await get_blob("/api/history"), "History of sessions", "")));
const refresh = guarded(async () => {
  ++app.refreshes;
  const data = await get_json("/api/folder").finally(() => --app.refreshes);
  set_role(data.role);
  app.folder = data;
  devices.show(data.devices);
  folder.show(data);
  const recordings = data.recordings.filter(({ error }) => !error);
  for (const id of ["ghost", "against"]) set_options(by_id(id), [new Option("none", ""), ...recordings.map(({ file }) => new Option(short(file), file))]);
  if (!app.live && !data.session) await preview(folder.scene(folder.chosen), folder.asset());
  if (data.start && data.state === "idle" && !app.has_started) await start({ scene: data.start });
  if (data.playback && !app.playback.first) {
    await play({ file: data.playback.recording, scene: data.playback.scene });
    if (data.playback.against) await compare({ file: data.playback.against, scene: data.playback.scene });
  }
});
// A request that waits is not repeated: a browser opens few connections to a host, and commands need one.
setInterval(() => { if (!document.hidden && app.tab === "folder" && !app.refreshes) refresh(); }, kRefresh_ms);

function set_role(role) {
  app.role = role;
  document.body.dataset.role = role;
  by_id("role").textContent = role === "view" ? "view only" : "";
}

// ---- session ----
const live_bone = guarded(async (source) => {
  source.bone = read_bone(await get_container("/api/bone?session=1"));
  Object.assign(source.bone.tool, { kind: source.about.tool?.kind, half_angle_deg: source.about.tool?.half_angle_deg });
  if (app.live !== source) return;
  if (app.tab !== "playback") show_bone();
});
app.link = new Live({
  hello: ({ hello, role, columns }, is_new) => {
    app.connected = true;
    app.refused = app.full = false;
    set_role(role);
    if (!hello) {  // also when a session is about to begin: nothing of the one before stays on the page
      app.live = null;
      app.preview = new Shown([], {});
      app.bone_key = "";
      if (app.tab !== "playback") show_bone();
      return changed();
    }
    if (!is_new) {
      app.live?.history.gap();
      return changed();  // after the end of a session the page may show another bone
    }
    app.live = new Shown(columns, hello);
    app.live.sheets = new Map();
    app.preview = null;
    app.bone_key = "";
    document.body.dataset.session = "live";
    app.hand?.new_session();
    app.imaging.new_session();
    if (app.tab === "folder") set_tab("session");
    live_bone(app.live);
  },
  history: (points) => {
    app.live?.take_history(points);
    changed();
  },
  snapshot: (row) => {
    if (!app.live || row.length !== app.live.columns.width) return;
    const has_moved = row[0] !== app.live.row?.[0];  // the time stops in a pause and at the end
    app.live.take(row);
    app.goals.take(app.live);
    training.follow(app.live);
    app.heard_ms = performance.now();
    app.hand?.take_snapshot();
    app.imaging.take_row();
    app.has_moved ||= has_moved;
    app.panels_are_old = true;
  },
  sheet: (sheet) => {
    app.live?.sheets.set(sheet.sheet, sheet);
    if (shown() === app.live && app.live?.bone) app.view?.set_sheet(sheet);
    changed();
  },
  shape: (shape) => {
    if (app.live) app.live.shape = shape;
    if (shown() === app.live && app.live?.bone) app.view?.set_shape(shape);
  },
  events: (events) => {
    app.live?.events.push(...events);
    if (events.some(({ kind, fault }) => kind === "fault" && fault === "emergency_stop")) {
      restart.withdraw();
      notices.end("stop");
    }
    app.hand?.take_events(events);
    app.imaging.take_events(events);
    changed();
  },
  missed: (count) => { if (app.live) app.live.missed += count; },
  state: (state) => {
    if (state.state !== app.state.state) notices.end_passing();
    app.state = state;
    if (["idle", "ended"].includes(state.state)) notices.end("stop");  // there is no force any more
    app.hand?.take_state(state);
    document.body.dataset.session = state.state;
    if (is_running()) take_keys_back();
    else {
      refresh();
      restart.session_over(state);
    }
    changed();
    draw_status();
  },
  hand: (holder) => app.hand?.set_holder(holder),
  stalled: () => app.hand?.stalled(),
  down: (is_refused, is_full) => {
    app.connected = false;
    restart.withdraw();
    app.hand?.connection_lost();
    app.refused = is_refused;
    app.full = is_full;
    draw_status();
  },
});

if (app.view) app.hand = new Hand(app);

app.imaging = new Imaging({ source: shown, tab: () => app.tab, is_running: () => is_running(), is_operator: () => app.role === "operator",
  scene: () => (app.tab === "playback" ? app.playback.scene : folder.chosen), asset: () => (app.tab === "playback" ? undefined : folder.asset()),
  is_planning: () => planning.is_active, plan: () => planning.needle(), pick: (at_m) => planning.is_active && planning.set(planning.picks, at_m), changed, error: notice });

const is_running = () => ["starting", "running", "silent", "paused"].includes(app.state.state);
const command = guarded(async (name) => {
  restart.withdraw();
  await post("/api/command", { command: name });
});
const start = guarded(async (what) => {
  restart.withdraw();
  app.has_started = true;
  await post("/api/start", what);
  training.started(what);
  notices.end_passing();
  if (app.tab !== "session") set_tab("session");
});
const duration = new NumberField("start-duration");
by_id("start-form").addEventListener("submit", (event) => {
  event.preventDefault();
  const why = devices.why_not(folder.scene(folder.chosen));
  if (why) return notice(why);
  const what = { scene: by_id("start-scene").value, ...training.fields() };
  for (const [name, id] of [["asset", "start-asset"], ["device", "start-device"], ["clock", "start-clock"]]) if (by_id(id).value) what[name] = by_id(id).value;
  if (duration.value !== null) what.duration_s = duration.value;
  start(what);
});
const restart = new Restart({ request: () => app.state.request, fields: () => training.fields(), is_running, start });
by_id("restart").addEventListener("click", guarded(() => restart.press()));
document.addEventListener("visibilitychange", () => { if (document.hidden) restart.withdraw(); });
const toggle_pause = () => command(is_paused(app.state, app.live) ? "resume" : "pause");
by_id("pause").addEventListener("click", toggle_pause);
for (const name of ["zero", "recover", "stop"]) by_id(name).addEventListener("click", () => command(name));

async function stop_now() {
  restart.withdraw();
  app.hand?.let_go();
  const { answered, delivered } = emergency_stop();
  try {
    await answered;
    notices.end("stop");
  } catch (error) {
    const is_urgent = is_running() || !app.connected;
    notices.say("stop", is_urgent ? `The emergency stop was not delivered (${error.message}). Press the device's own.` : `Emergency stop: ${error.message}.`, { lasts: is_urgent });
    delivered.then(() => notices.end("stop"), () => {});
  }
}
by_id("emergency").addEventListener("click", stop_now);

listen_to_keys({ app, is_running, emergency_stop: stop_now, stop: () => command("stop"), pause: () => toggle_pause(), play: () => toggle_play(), notice });

// ---- playback ----
const play = guarded(async (recording) => {
  if (!(await app.playback.open(recording.file, recording.scene))) return;
  // A recording does not contain the device's limits, so those of the last session of this page are used.
  const { motor_peak_torque_Nm, joint_limits_rad, workspace } = app.live?.about ?? {};
  Object.assign(app.playback.first.about, { motor_peak_torque_Nm, joint_limits_rad, workspace });
  by_id("against").value = "";
  set_tab("playback");
});
const compare = guarded(async (recording) => {
  if (app.playback.first) {
    if (!(await app.playback.compare(recording.file, recording.scene))) return;
  } else if (recording.file && !(await app.playback.open(recording.file, recording.scene))) return;
  by_id("against").value = app.playback.first?.second ? recording.file : "";
  set_tab("playback");
});
function toggle_play() {
  if (!app.playback.first) return;
  if (app.playback.time_s >= app.playback.end_s) app.playback.go_to(0);
  app.playback.is_playing = !app.playback.is_playing;
  changed();
}
function seek(t) {
  const before = app.playback.first?.events.length;
  app.playback.go_to(t);
  if (app.playback.first?.events.length !== before) app.view?.set_marks(app.playback.marks);
  changed();
}
by_id("play").addEventListener("click", toggle_play);
by_id("seek").addEventListener("input", (event) => seek(Number(event.target.value) / 1000 * app.playback.end_s));
by_id("speed").addEventListener("change", (event) => (app.playback.speed = Number(event.target.value)));
by_id("against").addEventListener("change", (event) => {
  const file = event.target.value;
  compare(app.folder?.recordings.find((recording) => recording.file === file) ?? { file: "" });
});

const open_report = guarded(async (file, device) => show_page(await get_blob(file_query("/api/report", { file })), "Session report", device));
/// Shows an HTML page that the console gave.
function show_page(bytes, title, device) {
  const blob = new Blob([bytes], { type: "text/html" });
  if (app.report_url) URL.revokeObjectURL(app.report_url);
  app.report_url = URL.createObjectURL(blob);
  by_id("report-frame").src = app.report_url;
  by_id("report-device").textContent = device ? `, device: ${devices.words(device)}` : "";
  by_id("report-save").href = app.report_url;
  by_id("report-title").textContent = title;
  by_id("report-save").download = title === "Session report" ? "session-report.html" : "history.html";
  by_id("report-box").show();  // not modal, so that the emergency stop can still be pressed
}
by_id("report-close").addEventListener("click", () => by_id("report-box").close());
by_id("player-report").addEventListener("click", () => {
  const recording = app.folder?.recordings.find(({ file }) => file === app.playback.file);
  open_report(recording?.report ?? app.playback.file, recording?.device);
});
by_id("ended-report").addEventListener("click", () => open_report(app.state.report, app.state.device));
by_id("ended-play").addEventListener("click", () => {
  const found = app.folder?.recordings.find(({ file }) => file === app.state.recording);
  play(found ?? { file: app.state.recording, scene: app.state.request?.scene });
});

// ---- drawing ----
/// True if the session runs, and its last snapshot is older than it should be.
const is_old = () => app.live?.row && ["running", "silent"].includes(app.state.state) && performance.now() - app.heard_ms > kOld_ms;
function draw_status() {
  const is_playback = app.tab === "playback" && !is_running() && app.connected;
  const first = app.playback.first;
  const said = is_playback
    ? { level: "good", state: "Playback", words: first ? `${short(app.playback.file)}${first.second ? `, against ${short(app.playback.second_file)}` : ""}${first.is_cut ? "; its session was killed, and its last row is cut off" : ""}` : "No recording is open. Choose one in Folder." }
    : describe({ has_begun: Boolean(app.link?.session), shown: app.live, state: app.state, is_connected: app.connected, is_refused: app.refused, is_full: app.full });
  const noticed = notices.words;
  by_id("status").dataset.level = noticed ? "bad" : said.level;
  by_id("state").textContent = said.state;
  by_id("words").textContent = noticed && said.level === "bad" ? `${noticed} ${said.words}` : noticed || said.words;
  const source = shown();
  const end = app.tab === "playback" ? app.playback.end_s : source?.about.duration_s;
  const t = app.tab === "playback" ? app.playback.time_s : source?.value("t_s");
  const age_s = !is_playback && is_old() ? ` (${((performance.now() - app.heard_ms) / 1000).toFixed(1)} s ago)` : "";
  by_id("clock").textContent = Number.isFinite(t) ? `${t.toFixed(2)} s${Number.isFinite(end) ? ` of ${Number(end.toFixed(2))} s` : ""}${age_s}` : "";
  by_id("ended-report").hidden = app.state.state !== "ended" || !app.state.report || is_playback;
  by_id("ended-play").hidden = !["ended", "lost"].includes(app.state.state) || !app.state.recording || is_playback;
  const running = is_running(), safety = app.live?.value("safety", 0), paused = is_paused(app.state, app.live);
  by_id("pause-word").textContent = running && paused ? "Resume" : "Pause";
  for (const name of ["pause", "zero", "stop"]) by_id(name).disabled = !running;
  const is_stopped = app.live && (safety === kFault) && app.live.about.faults?.[app.live.value("fault", 0)] === "emergency_stop";
  by_id("recover").textContent = is_stopped ? "Release the stop" : "Recover";
  by_id("recover").disabled = !running || paused || !(safety === kFault || safety === kRecovering || app.live?.value("fault", 0));
  by_id("restart").disabled = !app.state.request;
  by_id("start").disabled = running || !folder.chosen;
  devices.draw(running, folder.scene(folder.chosen));
  return said;
}

function draw_overlay(source) {
  const lines = by_id("caption").children, view = app.view;
  const about = source?.about ?? {};
  const scene = app.tab === "playback" ? (app.playback.scene ?? "") : about.scene?.name ?? folder.scene(folder.chosen)?.name ?? "";
  const device = app.tab !== "playback" && source && source === app.live ? app.state.device : "";
  lines[0].textContent = source ? scene + (device ? `; device: ${devices.words(device)}` : "") : "";
  const slice = view?.slices[view.section_slice(source)];
  lines[1].textContent = app.tab === "playback" && source && !source.bone ? "The scene of this recording is not in the folder: there is no bone to show."
    : !source || !slice ? "" : view.view === "section" ? `Slice ${slice.slice} at z = ${(1000 * slice.z_m).toFixed(1)} mm, viewed from above; line: contour of the CT${slice.is_lost ? " (its holes cannot be shown)" : ""}`
    : view.view === "tool" ? "From the tool's axis, 100 mm above the tip"
    : !source.bone?.surface ? "Slices; the asset has no surface here" : "Surface and slices";
  const goals = source?.bone?.goals, tip = goals?.target && source.row && source.is_placed() ? source.values("tool_m") : null;
  const away = tip ? `, ${(1000 * Math.hypot(...goals.target.at_m.map((at, i) => at - tip[i]))).toFixed(1)} mm from the tip` : "";
  if (goals && view?.view !== "section") lines[1].textContent += `; sphere: target${away}, dashes: planned line, bodies with edges: zones to keep out of`;
  lines[2].textContent = view ? "" : "This browser draws no bone: it has no WebGL. Switch on its hardware acceleration, or take another browser; all else works.";
  const readout = by_id("readout");
  const force = source?.row && source.is_placed() ? source.force() : NaN, depth = source?.depth_mm();
  by_id("force-label").textContent = Number.isFinite(force) ? `${force.toFixed(1)} N` : "";
  readout.hidden = !Number.isFinite(force);
  if (Number.isFinite(force)) {
    readout.querySelector("b").textContent = force.toFixed(1);
    const tip_N = source.value("tip_N"), along = tip_N > 1.05 * force + 0.5 ? `tip ${tip_N.toFixed(1)} N, ` : "";
    readout.lastChild.textContent = along + (Number.isFinite(depth) ? (depth >= 0 ? `tip ${depth.toFixed(1)} mm below the first slice` : `tip ${(-depth).toFixed(1)} mm above the first slice`) : "");
  }
}

function draw_player() {
  const { playback } = app;
  by_id("play").textContent = playback.is_playing ? "Pause" : "Play";
  by_id("play").disabled = !playback.first;
  by_id("player-report").disabled = !app.folder?.recordings.some(({ file, report }) => file === playback.file && report !== undefined);
  by_id("seek").value = playback.end_s ? Math.round(1000 * playback.time_s / playback.end_s) : 0;
  by_id("seek-time").textContent = playback.first ? `${playback.time_s.toFixed(2)} / ${playback.end_s.toFixed(2)} s` : "";
}

let last = performance.now(), panels_at = 0, view_at = 0;
function frame(now) {
  requestAnimationFrame(frame);
  const passed_s = (now - last) / 1000;
  last = now;
  // Snapshots come also in a pause, but not while a program loads, nor if the session is silent.
  if (app.connected && app.live && ["running", "paused"].includes(app.state.state)) app.link.watch();
  app.link.ack();
  app.hand?.frame(now, passed_s);
  const before = app.playback.first?.events.length;
  if (app.tab === "playback" && app.playback.advance(passed_s)) {
    changed();
    if (app.playback.first.events.length !== before) app.view?.set_marks(app.playback.marks);
  }
  const source = shown();
  if (source && app.has_moved) app.view?.update(source);
  app.has_moved = false;
  app.imaging.frame(now);
  // Without a GPU the view would leave too little time for the pictures beside it.
  if (now - view_at > (app.imaging.xray.is_on ? kViewBesideXray_ms : app.imaging.open ? kViewBesidePictures_ms : 0)) {
    view_at = now;
    if (app.view?.frame(now)) app.panels_are_old = true;
  }
  if (is_old()) app.panels_are_old = true;
  if (!app.panels_are_old || now - panels_at < Math.max(kPanels_ms, Math.min(kSlowPanels_ms, 8 * (app.view?.pace.frame_ms ?? 0)))) return;
  app.panels_are_old = false;
  panels_at = now;
  draw_status();
  draw_overlay(source);
  app.hand?.draw_bar();
  app.imaging.draw();
  planning.draw();
  if (app.tab === "playback") draw_player();
  app.goals.draw(source, app.tab === "playback");
  if (!source || app.tab === "folder") return;
  app.gauges.update(source);
  app.panels_are_old = app.charts.update(source);
}
set_tab("folder");
set_view("perspective");
requestAnimationFrame(frame);
refresh();

window.trocar = inspection_of(app);
