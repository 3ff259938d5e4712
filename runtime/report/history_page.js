// SPDX-License-Identifier: Apache-2.0
// Draws the history of sessions. history: formats/session/history.schema.json.
const sessions_of = data("history");

/// A figure as it is shown: lengths in mm, and how many digits after the point.
const shown_as = ({ unit }) => (unit === "m" ? { unit: "mm", factor: 1e3, digits: 2 } : { unit, factor: 1, digits: unit === "" ? 0 : 2 });
const shown = (of, value) => {
  const { factor, digits } = shown_as(of);
  return value === null ? "" : (factor * value).toFixed(digits);
};
const head_of = (of) => `${of.title}${shown_as(of).unit ? `, ${shown_as(of).unit}` : ""}`;

/// The learning curve of one figure: a point for each session, in their order. A session without the figure leaves a gap.
function curve(of, sessions) {
  const { unit, factor } = shown_as(of), kWidth = 320, kHeight = 170, bottom = kHeight - 24;
  const values = sessions.map(({ figures }) => (figures[of.name] === null ? null : figures[of.name] * factor));
  const there = values.filter((value) => value !== null);
  if (!there.length) return [];
  const low = Math.min(0, ...there), high = Math.max(low + (unit ? 0.1 : 1), ...there), last = sessions.length - 1, every = Math.ceil(sessions.length / 10);
  const { x, y, grid } = axes({ left: 50, top: 10, right: kWidth - 10, bottom }, last ? [0, last] : [-1, 1], [low, low + 1.05 * (high - low)],
    { y_ticks: ticks(low, high, 4).filter((at) => unit || Number.isInteger(at)) });
  return [figure(kWidth, kHeight, `${head_of(of)}, over the sessions`, head_of(of), ...grid,
    ...sessions.flatMap(({ attempt }, i) => (i % every ? [] : [label("mid", x(i), bottom + 17, String(attempt ?? i + 1))])),
    trace("curve", values.map((value, i) => (value === null ? null : [x(i), y(value)]))),
    ...values.flatMap((value, i) => (value === null ? [] : [svg("circle", { class: "dot", cx: x(i), cy: y(value), r: sessions.length > 30 ? 2 : 3 },
      svg("title", {}, `attempt ${sessions[i].attempt ?? "not stated"}, ${sessions[i].time}: ${shown(of, sessions[i].figures[of.name])} ${unit}`))])))];
}

function goals_of(session, text) {
  if (session.goals === null) return text;
  const untried = session.goals - (session.goals_attempted ?? session.goals);
  return `${text} of ${session.goals}${untried > 0 ? `, ${untried} not attempted` : ""}`;
}

function series_section({ trainee, course, scene, sessions }) {
  const title = [trainee === null ? "Trainee not stated" : `Trainee ${trainee}`, course === null ? "course not stated" : `course ${course}`, scene].join(", ");
  const used = sessions_of.figures.filter(({ name }) => sessions.some(({ figures }) => figures[name] !== null));
  const rows = sessions.map((session) => [session.attempt ?? "", session.time, ...used.map((of) => {
    const text = shown(of, session.figures[of.name]);
    return of.name === "goals_met" ? goals_of(session, text) : text;
  }), session.end, session.file]);
  return section(title,
    paragraph(`${sessions.length} ${sessions.length === 1 ? "session" : "sessions"}, ordered by attempt and time. Below each curve: the attempt, or the number of the session.`),
    element("div", { class: "curves" }, ...used.flatMap((of) => curve(of, sessions))),
    table(["#attempt", "time", ...used.map((of) => `#${head_of(of)}`), "ended", "file"], rows));
}

const count = sessions_of.series.reduce((sum, { sessions }) => sum + sessions.length, 0), { skipped } = sessions_of;
show("History of sessions", "landscape", element("h1", {}, "History of sessions"),
  paragraph(`${count} ${count === 1 ? "session" : "sessions"} in ${sessions_of.series.length} series, one for each trainee, course and scene. ${sessions_of.program}. For training, not for planning.`),
  ...sessions_of.series.map(series_section),
  ...(skipped.length ? [section("Files that were skipped", ...skipped.map((text) => paragraph(text, "")))] : []));
