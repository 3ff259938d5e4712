// SPDX-License-Identifier: Apache-2.0
// Draws the session report. report: the file REPORT.json beside the page, formats/session/session_report.schema.json.
// drawing: what the pictures need besides.
const report = data("report"), drawing = data("drawing");
const goals = drawing.goals;  // null: the scene states none

// ---- text ----
const fixed = (value, digits) => value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1");
const or_none = (format) => (value) => (value === null ? "none" : format(value));
const mm = or_none((m) => `${fixed(1e3 * m, 2)} mm`);
const fine_mm = or_none((m) => `${fixed(1e3 * m, 4)} mm`);
const seconds = or_none((s) => `${fixed(s, 3)} s`);
const newtons = or_none((N) => `${fixed(N, 2)} N`);
const newton_seconds = (x) => `${fixed(x, 2)} N s`;
const hu_text = (hu) => (hu === null || !has_hu ? "none" : hu <= -1000 ? "no bone" : fixed(hu, 0));
const with_unit = (value, unit) =>
  value === null ? "none" : unit === "m" ? mm(value) : unit === "N" ? newtons(value) : `${fixed(value, 3)} ${unit}`;
const name_of = ({ layer, slice }) => {
  if (layer !== null) return `layer ${layer}`;
  const tissue = report.sheets.find((sheet) => sheet.slice === slice)?.tissue;
  return `slice ${slice}${tissue ? ` (${tissue})` : ""}`;
};

const not_listed = (count, listed) => (count > listed.length ? [paragraph(`${count - listed.length} more are not listed.`)] : []);

// ---- pictures ----
const kLeft = 58, kTop = 14, kBottom = 46, kWidth = 560;
const column = Object.fromEntries(report.samples.columns.map((name, i) => [name, i]));
const samples = report.samples.rows.map((row) => ({
  t_s: row[column.t_s], tip_m: [row[column.tool_x_m], row[column.tool_y_m], row[column.tool_z_m]], hand_N: row[column.hand_N], hu: row[column.front_HU] }));
const depth_mm = ({ tip_m }) => 1e3 * (drawing.top_z_m - tip_m[2]);
const has_hu = samples.some(({ hu }) => hu !== null && hu > -1000 && hu !== 0);  // an asset without HU has 0 everywhere
const near = (t_s) => samples.reduce((a, b) => (Math.abs(b.t_s - t_s) < Math.abs(a.t_s - t_s) ? b : a));

/// What is marked in all plots, in order of time and numbered from 1.
const kMaxEvents = 40;
const all_events = [
  ...(report.time.first_contact_s === null ? [] : [{ t_s: report.time.first_contact_s, text: "first contact" }]),
  ...report.attempts.listed.slice(1).map(({ from_s }) => ({ t_s: from_s, text: "bone entered again" })),
  ...report.break_throughs.map((b) => ({ t_s: b.t_s, text: `break-through: ${name_of(b)}` })),
  ...report.zones.flatMap(({ name, breaches }) => breaches.map(({ from_s }) => ({ t_s: from_s, text: `forbidden zone entered: ${name}` }))),
  ...report.faults.map(({ fault, t_s }) => ({ t_s, text: `fault ${fault}` })),
  ...(report.walls.final ? [{ t_s: report.walls.final.t_s, text: "deepest point" }] : [])].sort((a, b) => a.t_s - b.t_s);
const events = all_events.slice(0, kMaxEvents).map((event, i) => ({ ...event, number: i + 1 }));
const followers = [];  // each puts the cursor of one picture to a sample, or hides it (null)

/// A picture's cursor. `place` gives x, y of a sample; without y the cursor is a line across the picture.
function cursor(bottom, place) {
  const mark = svg("path", { class: "cursor" });
  followers.push((sample) => {
    mark.style.visibility = sample ? "visible" : "hidden";
    if (!sample) return;
    const [x, y] = place(sample);
    mark.setAttribute("d", y === undefined ? `M${x.toFixed(1)} ${kTop}V${bottom}` : `M${(x - 5).toFixed(1)} ${y.toFixed(1)}a5 5 0 1 0 10 0a5 5 0 1 0 -10 0`);
  });
  return mark;
}

/// The marks of the events, from left to right. A number that would overlap the one before is left out.
function event_marks(bottom, x_of) {
  let last = -1e9;
  return events.map((event) => ({ number: event.number, x: x_of(event) })).sort((a, b) => a.x - b.x).flatMap(({ number, x }) => {
    if (x - last < 13) return [line("event", x, kTop, x, bottom)];
    last = x;
    return [line("event", x, kTop, x, bottom), label("eventtext", x, kTop - 3, String(number))];
  });
}

/// A curve of the samples. `value` gives what it shows, null: a gap. `along`: what it is plotted against, one for each sample.
function plot({ height, width, title, caption, name, along, along_name, value, y_name, low_value = 0, limit = null, at_event, is_linked }) {
  const frame = { left: kLeft, top: kTop, right: width - 12, bottom: height - kBottom }, { right, bottom } = frame, values = samples.map(value);
  const low = Math.min(...along), high = Math.max(...along) > low ? Math.max(...along) : low + 1;
  const most = Math.max(low_value + 1, limit ?? -1e9, ...values.filter((v) => v !== null)), end = most + 0.06 * (most - low_value);
  const { x, y, grid } = axes(frame, [low, high], [low_value, end],
    { x_ticks: ticks(low, high, 8), y_ticks: ticks(low_value, end, 5), x_name: along_name, y_name });
  const made = figure(width, height, title, caption, ...grid,
    ...(limit === null ? [] : [line("limit", kLeft, y(limit), right, y(limit))]),
    ...event_marks(bottom, (event) => x(at_event(event))), trace(name, values.map((v, i) => (v === null ? null : [x(along[i]), y(v)]))),
    cursor(bottom, (sample) => { const i = samples.indexOf(sample); return is_linked ? [x(along[i])] : [x(along[i]), y(values[i] ?? low_value)]; }));
  if (!is_linked) return made;
  made.addEventListener("pointermove", (event) => {
    const box = made.firstChild.getBoundingClientRect();
    const at = low + ((event.clientX - box.left) / box.width * width - kLeft) / (right - kLeft) * (high - low);
    const sample = near(at);
    followers.forEach((follow) => follow(sample));
  });
  made.addEventListener("pointerleave", () => followers.forEach((follow) => follow(null)));
  return made;
}

/// Force, depth and HU over time, one below the other with the same time axis and the same marks; then force over depth.
function plots_section() {
  const width = 1072, times = samples.map(({ t_s }) => t_s), depths = samples.map(depth_mm), limit = goals?.force_max_N ?? null;
  const over_time = { width, along: times, along_name: "time (s)", at_event: ({ t_s }) => t_s, is_linked: true, caption: "" };
  const ceiling = limit === null ? "" : "; dashed: the force ceiling";
  const says = element("p", { class: "soft screen" }, "Move the pointer over a plot: all plots show the same moment.");
  followers.push((s) => { if (s) says.textContent = `${fixed(s.t_s, 3)} s: ${newtons(s.hand_N)} on the hand, tip ${fixed(depth_mm(s), 2)} mm deep${has_hu ? `, HU ${hu_text(s.hu)}` : ""}.`; });
  const rows = events.map(({ number, t_s, text }) => {
    const s = near(t_s);
    return [number, seconds(t_s), text, newtons(s.hand_N), `${fixed(depth_mm(s), 2)} mm`, ...(has_hu ? [hu_text(s.hu)] : [])];
  });
  return section("Force, depth and HU", says,
    plot({ ...over_time, height: 230, title: "Force on the hand over time", name: "curve", value: ({ hand_N }) => hand_N, y_name: "force (N)", limit }),
    plot({ ...over_time, height: 190, title: "Depth of the tip over time", name: "curve", value: depth_mm, y_name: "depth (mm)", low_value: Math.min(0, ...depths) }),
    ...(has_hu ? [plot({ ...over_time, height: 190, title: "HU under the tool over time", name: "hu", y_name: "HU", low_value: 0,
      value: ({ hu }) => (hu === null || hu <= -1000 ? null : Math.max(0, hu)) })] : []),
    plot({ width, height: 260, title: "Force on the hand over depth", name: "curve", along: depths, along_name: "depth of the tip below the topmost slice or layer (mm)",
      value: ({ hand_N }) => hand_N, y_name: "force (N)", limit, at_event: ({ t_s }) => depth_mm(near(t_s)), is_linked: false,
      caption: `Force, depth${has_hu ? " and HU under the tool where it cuts" : ""} over time, and force over depth, in and out. Numbers: the events in the table${ceiling}.` }),
    ...(rows.length ? [table(["#number", "#time", "event", "#force", "#depth", ...(has_hu ? ["#HU"] : [])], rows), ...not_listed(all_events.length, rows)] : []));
}

/// The limits along x or y (`axis` 0 or 1) and z of a forbidden zone.
function bounds(zone, axis) {
  if (zone.shape === "prism") {
    const along = zone.outline_m.map((corner) => corner[axis]);
    return { from: Math.min(...along), to: Math.max(...along), low: zone.z_m[0], high: zone.z_m[1] };
  }
  const { low_m, high_m, radius_m } = zone, r = zone.shape === "capsule" ? radius_m : 0;
  return { from: Math.min(low_m[axis], high_m[axis]) - r, to: Math.max(low_m[axis], high_m[axis]) + r,
    low: Math.min(low_m[2], high_m[2]) - r, high: Math.max(low_m[2], high_m[2]) + r };
}

/// x or y (`axis` 0 or 1) to the right, z up, the same scale both ways.
function side_view(axis) {
  const kHeight = 480, kMinWidth_m = 0.03, right = kWidth - 92, bottom = kHeight - kBottom;
  const points = [...samples.map(({ tip_m }) => tip_m), ...(goals?.target ? [goals.target.at_m] : []), ...(goals?.line ? [goals.line.entry_m] : [])];
  const us = points.map((p) => p[axis]), zs = [...points.map((p) => p[2]), ...report.sheets.map(({ z_m }) => z_m)];
  const range = (values) => ({ low: Math.min(...values), high: Math.max(...values) });
  const u = range(us), z = range(zs);
  if (!(z.high > z.low)) z.low = z.high - 0.01;
  const pad = 0.06 * (z.high - z.low) + 1e-3;
  const width = right - kLeft, height = bottom - kTop;
  const scale = Math.min(height / (z.high - z.low + 2 * pad), width / Math.max(kMinWidth_m, u.high - u.low + 2 * pad));
  const low_u = (u.low + u.high - width / scale) / 2, high_u = low_u + width / scale;
  const low_z = (z.low + z.high - height / scale) / 2, high_z = low_z + height / scale;
  const [name, other] = axis === 0 ? ["x", "y"] : ["y", "x"], id = `clip-${name}`, in_mm = (...values) => values.map((value) => 1e3 * value);
  const place = axes({ left: kLeft, top: kTop, right, bottom }, in_mm(low_u, high_u), in_mm(low_z, high_z), { x_ticks: ticks(...in_mm(low_u, high_u), 6),
    y_ticks: ticks(...in_mm(low_z, high_z), 8), x_name: `${name} (mm)`, y_name: "height z (mm)" });
  const x = (u_m) => place.x(1e3 * u_m), y = (z_m) => place.y(1e3 * z_m);

  const layers = drawing.layers.map(({ top_z_m, thickness_m }) =>
    svg("rect", { class: "layer", x: kLeft, y: y(top_z_m), width, height: thickness_m * scale }));
  const sheets = report.sheets.flatMap(({ z_m }, i) => [
    line("grid", kLeft, y(z_m), right, y(z_m)),
    ...(drawing.material_m[axis][i] ?? []).filter(([from, to]) => to >= low_u && from <= high_u)
      .map(([from, to]) => line("bone", x(Math.max(from, low_u)), y(z_m), x(Math.min(to, high_u)), y(z_m)))]);
  const zones = (goals?.zones ?? []).flatMap((zone, i) => {
    const { from, to, low, high } = bounds(zone, axis);
    const shape = zone.shape === "capsule"
      ? svg("line", { class: "zone", "stroke-opacity": ".3", "stroke-linecap": "round", x1: x(zone.low_m[axis]), y1: y(zone.low_m[2]),
        x2: x(zone.high_m[axis]) + 0.01, y2: y(zone.high_m[2]), "stroke-width": 2 * zone.radius_m * scale })
      : svg("rect", { class: "zone", x: x(from), y: y(high), width: (to - from) * scale, height: (high - low) * scale });
    const left = Math.max(from, low_u), end = Math.min(to, high_u);
    if (!(left < end)) return [shape];
    const at = i % 2 === 0 ? y(high) + 16 : y(low) - 5;  // neighbours have their labels at opposite ends
    return [shape, label("mid zonetext", x((left + end) / 2), Math.min(bottom - 6, Math.max(kTop + 16, at)), zone.name)];
  });
  const plan = [];
  if (goals?.line) {
    const { entry_m: entry, direction, entry_radius_m } = goals.line, far = entry.map((m, k) => m + direction[k]);
    plan.push(line("plan", x(entry[axis]), y(entry[2]), x(far[axis]), y(far[2])),
      svg("circle", { class: "aim", cx: x(entry[axis]), cy: y(entry[2]), r: entry_radius_m === null ? 4 : entry_radius_m * scale }));
  }
  if (goals?.target)
    plan.push(svg("circle", { class: "aim", cx: x(goals.target.at_m[axis]), cy: y(goals.target.at_m[2]), r: goals.target.radius_m * scale }));
  const path = trace("curve", samples.map(({ tip_m }) => [x(tip_m[axis]), y(tip_m[2])]));
  const punctures = report.punctures.map((p) => svg("circle", { class: "mark", cx: x(near(p.t_s).tip_m[axis]), cy: y(p.tip_z_m), r: 3.5 }));
  // Names of layers and sheets at the right; one that would overlap another is moved or left out.
  const names = [];
  let last = -1e9;
  for (const { name, top_z_m, thickness_m } of drawing.layers) {
    last = Math.max(y(top_z_m - thickness_m / 2) + 4, last + 14);
    names.push(label("soft", right + 6, last, name.slice(0, 12)));
  }
  for (const { slice, z_m } of report.sheets) {
    if (y(z_m) + 4 < last + 14) continue;
    last = y(z_m) + 4;
    names.push(label("soft", right + 6, last, `slice ${slice}`));
  }
  return figure(kWidth, kHeight, `Path of the tip, viewed along ${other}`,
    `Viewed along ${other}: ${name} to the right, height up, the same scale both ways. Line: the tip; dots: punctures; bars: the material ` +
    `of the slices before the session, in the plane ${other} = ${fixed(1e3 * drawing.lowest_m[1 - axis], 1)} mm` +
    `${goals ? "; dashed and circles: the planned line, its entry, the target; areas: forbidden zones" : ""}.`,
    svg("defs", {}, svg("clipPath", { id }, svg("rect", { x: kLeft, y: kTop, width, height }))),
    ...place.grid,
    svg("g", { "clip-path": `url(#${id})` }, ...layers, ...sheets, ...zones, ...plan, path, ...punctures),
    cursor(bottom, ({ tip_m }) => [x(tip_m[axis]), y(tip_m[2])]),
    ...names);
}

// ---- sections ----
const kEnds = { done: "ran to its end", interrupted: "was interrupted", fault: "was stopped by a fault" };
const kPlungeEnds = { time: "the observed time was over", reversed: "the tip came back", fault: "torques stopped", end: "the session ended" };

function heading() {
  const about = `Session report. Asset ${report.asset}, force law ${report.force_law}, ${report.ticks} ticks at ${number(report.rate_Hz)} Hz ` +
    `(${report.clock} clock); the session ${kEnds[report.end]}. For training, not for planning.`;
  const lost = report.ticks_lost > 0 ? [paragraph(`${report.ticks_lost} ticks are missing: the machine was too slow.`, "bad")] : [];
  const { code, course, attempt } = report.trainee ?? {};
  const who = [code && `Trainee ${code}`, course && `course ${course}`, attempt && `attempt ${attempt}`].filter(Boolean).join(", ");
  return [element("h1", {}, report.scene), ...(who ? [paragraph(`${who}.`, "")] : []), paragraph(about), ...lost];
}

function tiles() {
  const tile = (value, name) => element("div", { class: "tile" }, element("b", {}, String(value)), element("span", {}, name));
  const untried = report.goals.length - report.goals_attempted;
  const of_goals = report.goals.length ? [tile(`${report.goals_met} of ${report.goals.length}`, `goals met${untried ? `, ${untried} not attempted` : ""}`)] : [];
  return element("div", { class: "tiles" }, ...of_goals, tile(newtons(report.force.max_N), "largest force"),
    tile(report.break_throughs_count, "break-throughs"), tile(mm(report.plunge_max_m), "largest plunge"), tile(seconds(report.time.total_s), "duration"),
    tile(seconds(report.time.contact_s), "in contact"), tile(report.attempts.reentries, "re-entries"),
    tile(newton_seconds(report.force.time_integral_N_s), "force over time"), tile(wall_grade(), "outside bone, final"), tile(report.faults_count, "faults"));
}

function goals_section() {
  if (!report.goals.length) return section("Goals", paragraph("The scene states no goals.", ""));
  const rows = report.goals.map((g) => [g.met ? "met" : g.attempted ? "not met" : "not attempted", g.zone === null ? g.goal : `${g.goal}: ${g.zone}`, with_unit(g.value, g.unit),
    `${g.limit_is === "least" ? "at least" : "at most"} ${with_unit(g.limit, g.unit)}`, g.how]);
  return section("Goals", table(["result", "goal", "#measured", "#limit", "how it is computed"], rows, { kind: (i) => (report.goals[i].met ? "met" : report.goals[i].attempted ? "miss" : "") }),
    paragraph("Each goal is judged on its own; there is no overall mark. Without contact nothing is attempted but a target that was reached, without a break-through no plunge."));
}

const pictures = () => !samples.length ? [] : [
  section("Path of the tip", pair(side_view(0), side_view(1))), plots_section()];

/// One row for each break-through. The slices that were cut since the one before are counted.
function break_throughs_section() {
  const title = "Break-throughs", { limit_s } = drawing.plunge;
  if (!report.break_throughs.length) return section(title, paragraph(`None. Punctures: ${report.punctures_count}.`, ""));
  let last_s = -1;
  const rows = report.break_throughs.map((b) => {
    const cut = report.punctures.filter(({ t_s }) => t_s > last_s && t_s <= b.t_s);
    last_s = b.t_s;
    const p = cut.find(({ t_s, layer, slice }) => t_s === b.t_s && layer === b.layer && slice === b.slice);
    return [name_of(b), seconds(b.t_s), cut.length, newtons(b.tip_N), p ? newtons(p.hand_N) : "none", ...(has_hu ? [p ? hu_text(p.front_HU) : "none"] : []),
      p ? mm(p.depth_m) : "none", mm(b.plunge_m), mm(b.hand_m), mm(b.release_m), b.below_m === null ? "none" : mm(b.below_m), kPlungeEnds[b.ended_by]];
  });
  const heads = ["slice or layer", "#time", "#punctures", "#at the tip before", "#on the hand before", ...(has_hu ? ["#HU before"] : []), "#depth", "#plunge", "#by the hand",
    "#by the coupling", "#tip below it", "plunge ended as"];
  return section(title, table(heads, rows), ...not_listed(report.break_throughs_count, report.break_throughs),
    paragraph(`At a break-through the resistance in front of the tip falls to less than half within a few milliseconds, and the tip runs on. The plunge is how far it ` +
      `runs on within ${fixed(limit_s, 1)} s, for as long as nothing bears it again. One part of it is the motion of the hand, the other the coupling of hand and tool, ` +
      `which relaxes. "Punctures" counts the slices and layers that the tool went through since the break-through before, ${report.punctures_count} in all.`));
}

const wall_grade = () => report.walls.final?.grade_is ?? "not in bone";

/// What each figure has shown in published validation, with its source.
function evidence_section() {
  const kNone = "no published validation known";
  const breaches = report.zones.reduce((sum, { breaches_count }) => sum + breaches_count, 0);
  const rows = [
    ["time from first contact to last puncture", seconds(report.time.contact_to_last_puncture_s), "time separates groups of experience: TraumaVision (doi 10.52198/21.sti.38.os1365), ArthroS (PMID 27085361)"],
    ["X-ray shots", report.xray.shots, "fluoroscopy separates groups of experience: TraumaVision (doi 10.52198/21.sti.38.os1365), Procedicus VIST"],
    ["X-ray screening", seconds(report.xray.screening_s), "as X-ray shots"],
    ["path length of the tip", mm(report.path.length_m), "path length of the instrument separates groups: ArthroS (PMID 27085361)"],
    ["attempts, and re-entries into bone", `${report.attempts.count}, ${report.attempts.reentries}`, kNone],
    ["entries into forbidden zones", breaches, "beginners touch the dura more often: epidural simulator of TU Delft (RAPM 44:298)"],
    ["force-time integral", newton_seconds(report.force.time_integral_N_s), "force over time was evaluated with realSpine (PMC7882829)"],
    ["outside bone at the deepest position", wall_grade(), `${kNone}; the bounds are those by which positions of pedicle screws are graded`],
    ["largest force", newtons(report.force.max_N), kNone], ["largest plunge", mm(report.plunge_max_m), kNone],
    ["straightness", report.path.straightness === null ? "none" : fixed(report.path.straightness, 4), kNone],
    ["tremor in contact, RMS", fine_mm(report.tremor.contact.across_rms_m), kNone]];
  return section("Figures and their evidence", table(["figure", "#value", "what published validation has shown"], rows),
    paragraph("The studies used other simulators. A figure that separates groups there need not do so here."));
}

function plan_section() {
  if (!report.line && !report.target) return [];
  const rows = [];
  if (report.line)
    rows.push(["distance to the planned line, largest", mm(report.line.max_m)], ["distance to the planned line, RMS", mm(report.line.rms_m)],
      ["distance to it at the entry point", mm(report.line.entry_m)]);
  if (report.target) {
    const { closest_m, closest_t_s, reached_t_s } = report.target;
    rows.push(["smallest distance to the target", closest_m === null ? "none" : `${mm(closest_m)} at ${seconds(closest_t_s)}`],
      ["target reached at", reached_t_s === null ? "not reached" : seconds(reached_t_s)]);
  }
  return [section("Plan", table(["plan", "#value"], rows),
    paragraph("Measured from the tip's point. Distances to the line count rows in which the tip is beyond the entry point along the line."))];
}

function zones_section() {
  if (!report.zones.length) return [];
  const rows = report.zones.map((zone) => {
    const spans = zone.breaches.map((b) => `${fixed(b.from_s, 3)} to ${fixed(b.to_s, 3)} s, ${fixed(1e3 * b.depth_m, 2)} mm deep`);
    if (zone.breaches_count > spans.length) spans.push("more");
    return [zone.name, mm(zone.min_m), seconds(zone.min_t_s), zone.breaches_count, spans.join("; ") || "none"];
  });
  return [section("Forbidden zones", table(["forbidden zone", "#smallest distance", "#at", "#breaches", "breaches: time and depth"], rows),
    paragraph("Distances are measured from the tip's point and are negative inside a zone. A zone's margin allows for the tool's thickness."))];
}

function walls_section() {
  const { beside, beside_count, side_cuts, side_cuts_count, final: end } = report.walls;
  const final = paragraph(end === null ? "At its deepest position the tip was not in bone, or not beyond the entry: there is no grade."
    : `At the deepest position (${seconds(end.t_s)}) the tool's outline is ${end.slice === null ? "nowhere" : `${mm(end.outside_m)} (slice ${end.slice})`} outside bone along its path. ` +
      `Grade: ${end.grade_is}. The entry is left out: ${end.slices_judged} slices are judged, from slice ${end.first_slice} down to the tip.`, "");
  if (!beside_count && !side_cuts_count)
    return section("Walls", final, paragraph("The tool did not leave a slice's outline, and cut no wall sideways.", ""));
  const rows = [...beside.map((span) => ["missed the material", span.slice ?? "none", seconds(span.from_s), seconds(span.to_s)]),
    ...side_cuts.map((cut) => ["wall cut sideways", cut.slice, seconds(cut.t_s), ""])];
  return section("Walls", final, table(["event", "slice", "#from", "#to"], rows), ...not_listed(beside_count, beside), ...not_listed(side_cuts_count, side_cuts));
}

function faults_section() {
  const n = report.operator_stops_count;
  const stops = n ? [paragraph(`The operator paused the session or switched its forces off ${n === 1 ? "once" : `${n} times`}.`, "")] : [];
  if (!report.faults.length) return section("Faults", paragraph("None.", ""), ...stops);
  const rows = report.faults.map((f) => [f.fault, seconds(f.t_s), f.recovered_t_s === null ? "not" : seconds(f.recovered_t_s), f.message]);
  return section("Faults", table(["fault", "#at", "#forces again at", "what it means and what to do"], rows, { kind: () => "miss" }),
    ...not_listed(report.faults_count, report.faults), ...stops);
}

function times_section() {
  const { time, path, force } = report;
  return section("Times, path and force", pair(
    table(["time", "#value"], [["whole session", seconds(time.total_s)], ["free, above every slice", seconds(time.free_s)],
      ["in contact", seconds(time.contact_s)], ["in a hole, or past a slice's edge, without contact", seconds(time.through_s)],
      ["stopped by a fault, or not started", seconds(time.stopped_s)], ["first contact at", seconds(time.first_contact_s)],
      ["from the first contact to the last puncture", seconds(time.contact_to_last_puncture_s)]]),
    table(["path and force", "#value"], [["path length of the tip", mm(path.length_m)],
      ["path length from the first contact to the lowest point after it", mm(path.insertion_m)],
      ["distance between the two points", mm(path.straight_m)],
      ["straightness: distance over path length", path.straightness === null ? "none" : fixed(path.straightness, 4)],
      ["largest depth below the topmost slice or layer", mm(path.depth_max_m)],
      ["force-time integral", newton_seconds(force.time_integral_N_s)], ["largest force", `${newtons(force.max_N)} at ${seconds(force.max_t_s)}`], ["mean force in contact", newtons(force.contact_mean_N)]])));
}

function tremor_section() {
  const { low_Hz, high_Hz, settle_s } = report.tremor;
  const row = (name, { across_rms_m, ticks }) => [name, fine_mm(across_rms_m), seconds(ticks / report.rate_Hz)];
  return section("Tremor", table(["tremor of the tip", "#RMS across the needle", "#time counted"],
    [row("free", report.tremor.free), row("in contact", report.tremor.contact)]),
  paragraph(`The tip's position is band-passed from ${low_Hz} to ${high_Hz} Hz by a high-pass and then a low-pass, both Butterworth filters of the ` +
    "second order: y = (b0 x + b1 x1 + b2 x2 - a1 y1 - a2 y2) / a0 with w = 2\u03c0f / rate, \u03b1 = sin w / \u221a2, a0 = 1 + \u03b1, " +
    "a1 = -2 cos w, a2 = 1 - \u03b1; high-pass b0 = b2 = (1 + cos w) / 2, b1 = -(1 + cos w); low-pass b0 = b2 = (1 - cos w) / 2, b1 = 1 - cos w. " +
    "x and y are position and result of a row, x1, y1 and x2, y2 those of the two rows before. RMS = \u221a(mean of |y|\u00b2) over the rows, of the part of y across the needle's axis, " +
    `without the first ${fixed(settle_s, 1)} s after a start.`));
}

show(`Session report: ${report.scene}`, "", ...heading(), tiles(), goals_section(), evidence_section(), ...pictures(), break_throughs_section(),
  ...plan_section(), ...zones_section(), walls_section(), faults_section(), times_section(), tremor_section(),
  paragraph("Positions are in the device's frame: z up, origin in its base. Heights and depths are those of the tool's tip. The force is what the " +
    `motors delivered to the hand. Rows count while the device is ready or running. ${report.program}.`));
