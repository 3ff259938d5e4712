// SPDX-License-Identifier: Apache-2.0
// The curves: force over time, force over depth, HU along the path, and the two histograms. uPlot draws the axes. A hook of uPlot
// draws the marks, and the curves whose x goes back and forth.
import uPlot from "uplot";
import { hu_at } from "./data.js";
import { is_by_operator } from "./words.js";

// Small charts are drawn faster by the processor than by a GPU that is only emulated.
const get_context = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, options) {
  return get_context.call(this, kind, kind === "2d" ? { ...options, willReadFrequently: true } : options);
};

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const rem = () => parseFloat(getComputedStyle(document.documentElement).fontSize);

function axis(label, side, size, values) {
  const px = rem(), font = `${0.9 * px}px "DejaVu Sans", system-ui, sans-serif`;
  return { label, side, size: size * px, labelSize: 1.25 * px, labelGap: 0, font, labelFont: font, gap: 0.25 * px, stroke: css("--soft"), space: (side % 2 ? 2 : 4.4) * px, values,
    grid: { stroke: css("--line"), width: 1 }, ticks: { stroke: css("--line"), width: 1, size: 0.25 * px } };
}

const round_up = (value) => {
  const step = 10 ** Math.floor(Math.log10(Math.max(value, 1e-9)));
  return step * Math.ceil((value / step) * 2) / 2;
};

/// One chart in `box`. It is made anew when the size or the theme changes.
class Chart {
  constructor(box, options) {
    this.box = box;
    this.options = options;
    this.data = [[0, 1], [null, null]];
    this.x = [0, 1];
    this.y = [0, 1];
    new ResizeObserver(() => this.make()).observe(box);
    this.make();
  }
  make() {
    this.plot?.destroy();
    this.plot = null;
    const { clientWidth: width, clientHeight: height } = this.box;
    if (!width || !height) return;
    const px = rem(), { x_label, y_label, draw, x_values, y_size = 2.9 } = this.options;
    this.plot = new uPlot({
      width, height, cursor: { show: false }, legend: { show: false }, padding: [0.5 * px, (this.options.right ?? 0.9) * px, 0, 0],
      scales: { x: { time: false, range: () => this.x }, y: { range: () => this.y } },
      axes: [axis(x_label, 2, 1.6, x_values), axis(y_label, 3, y_size)],
      series: [{}],
      hooks: { draw: [draw] },
    }, this.data, this.box);
  }
  set(data, x, y) {
    this.data = data;
    this.x = x[0] < x[1] ? x : [x[0], x[0] + 1];
    this.y = y[0] < y[1] ? y : [y[0], y[0] + 1];
    this.plot?.setData(data);
  }
}

function clip(plot) {
  const { ctx, bbox } = plot;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  return ctx;
}

/// Draws a vertical line. With `at_top`, a triangle at the top marks a break-through, so that it differs by more than colour.
function vertical(plot, ctx, x, colour, at_top, dash = []) {
  const { top, height } = plot.bbox, size = 0.45 * rem() * devicePixelRatio, at = plot.valToPos(x, "x", true);
  ctx.strokeStyle = ctx.fillStyle = colour;
  ctx.lineWidth = Math.max(1, 0.1 * rem() * devicePixelRatio);
  ctx.setLineDash(dash.map((part) => part * rem() * devicePixelRatio));
  ctx.beginPath();
  ctx.moveTo(at, top);
  ctx.lineTo(at, top + height);
  ctx.stroke();
  ctx.setLineDash([]);
  if (!at_top) return;
  ctx.beginPath();
  ctx.moveTo(at - size, top);
  ctx.lineTo(at + size, top);
  ctx.lineTo(at, top + 1.6 * size);
  ctx.fill();
}

function curve(plot, ctx, xs, ys, colour, dash = []) {
  ctx.strokeStyle = colour;
  ctx.lineWidth = Math.max(1, 0.13 * rem() * devicePixelRatio);
  ctx.lineJoin = "round";
  ctx.setLineDash(dash.map((part) => part * rem() * devicePixelRatio));
  ctx.beginPath();
  let is_on = false;
  for (let i = 0; i < xs.length; ++i) {
    if (ys[i] === null || xs[i] === null || Number.isNaN(xs[i])) {
      is_on = false;
      continue;
    }
    const x = plot.valToPos(xs[i], "x", true), y = plot.valToPos(ys[i], "y", true);
    if (is_on) ctx.lineTo(x, y);
    else ctx.moveTo(x, y);
    is_on = true;
  }
  ctx.stroke();
  ctx.setLineDash([]);
}

const label_font = () => `600 ${0.9 * rem() * devicePixelRatio}px "DejaVu Sans", system-ui, sans-serif`;

function words(ctx, text, x, y, colour, align) {
  ctx.font = label_font();
  ctx.fillStyle = colour;
  ctx.textAlign = align;
  ctx.textBaseline = "top";
  ctx.lineWidth = 0.3 * rem() * devicePixelRatio;
  ctx.strokeStyle = css("--panel");
  ctx.strokeText(text, x, y);
  ctx.fillText(text, x, y);
}

/// Returns the smallest and the largest value that are numbers.
function bounds(...lists) {
  let low = Infinity, high = -Infinity;
  for (const list of lists)
    for (const value of list) {
      if (value === null || Number.isNaN(value)) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  return low <= high ? [low, high] : [0, 1];
}

const kDash = [0.7, 0.4];
const kTicks_ms = 1000;  // time between redraws of the histograms, which change slowly; without a GPU each delays the next frame

export class Charts {
  constructor() {
    const at = (id) => document.getElementById(id);
    this.shown = null;
    this.names = [at("name-first"), at("name-second")];
    this.time = new Chart(at("plot-time"), { x_label: "Time, s", y_label: "Force, N", draw: (plot) => this.draw_time(plot) });
    this.depth = new Chart(at("plot-depth"), { x_label: "Depth of the tip below the first slice, mm", y_label: "Force, N", draw: (plot) => this.draw_depth(plot) });
    this.hu = new Chart(at("plot-hu"), { x_label: "Depth below the first slice, mm", y_label: "HU", draw: (plot) => this.draw_hu(plot), y_size: 3.4 });
    this.ticks = new Chart(at("plot-ticks"), { x_label: "Time, µs", y_label: "Share", right: 1.8, x_values: (_, splits) => splits.map((power) => (Number.isInteger(power) ? String(2 ** power) : "")), draw: (plot) => this.draw_ticks(plot) });
  }
  set_theme() { for (const chart of [this.time, this.depth, this.hu, this.ticks]) chart.make(); }

  /// Draws what is shown. Returns true if the histograms are older than the rest.
  update(shown) {
    this.shown = shown;
    for (const [k, name] of this.names.entries()) {
      const text = shown.second ? ["— first", "- - second"][k] : "";
      if (name.textContent !== text) name.textContent = text;
    }
    const { history, second } = shown, other = second?.history;
    const top = Math.max(1, bounds(history.force, other?.force ?? [])[1]);
    const force = [0, round_up(1.08 * top)];
    const t = bounds(history.t, other?.t ?? []);
    if (!shown.is_recording) t[0] = Math.max(t[0], t[1] - 60);
    this.time.set([t, [null, null]], [Math.max(0, t[0]), Math.max(t[1], t[0] + 1)], force);
    const depth = bounds(history.depth, other?.depth ?? []);
    this.depth.set([depth, [null, null]], [Math.floor(depth[0]), Math.ceil(depth[1] + 0.5)], force);
    this.update_hu(shown);
    const now = performance.now();
    if (shown === this.ticks_of && now - this.ticks_at < kTicks_ms) return true;
    Object.assign(this, { ticks_of: shown, ticks_at: now });
    this.update_ticks(shown);
    return false;
  }

  draw_time(plot) {
    const { shown } = this;
    if (!shown) return;
    const ctx = clip(plot), { history, second } = shown;
    if (second) {
      curve(plot, ctx, second.history.t, second.history.force, css("--pink"), kDash);
      for (const event of second.break_throughs()) vertical(plot, ctx, event.t_s, css("--pink"), true, [0.15, 0.3]);
    }
    curve(plot, ctx, history.t, history.force, css("--blue"));
    for (const event of shown.break_throughs()) vertical(plot, ctx, event.t_s, css("--orange"), true, [0.3, 0.3]);
    for (const event of shown.events) if (event.kind === "fault" && !is_by_operator(event)) vertical(plot, ctx, event.t_s, css("--red"), false);
    if (shown.is_recording && shown.row) vertical(plot, ctx, shown.value("t_s"), css("--text"), false);
    ctx.restore();
  }

  draw_depth(plot) {
    const { shown } = this;
    if (!shown) return;
    const ctx = clip(plot), { history, second } = shown;
    if (second) curve(plot, ctx, second.history.depth, second.history.force, css("--pink"), kDash);
    curve(plot, ctx, history.depth, history.force, css("--blue"));
    const top = shown.bone?.top_m;
    for (const [events, colour] of [[second?.break_throughs() ?? [], "--pink"], [shown.break_throughs(), "--orange"]])
      for (const event of events) if (top !== undefined && event.tool_z_m !== undefined) vertical(plot, ctx, 1000 * (top - event.tool_z_m), css(colour), true, [0.3, 0.3]);
    if (shown.row) {
      const px = rem() * devicePixelRatio;
      ctx.fillStyle = css("--text");
      ctx.beginPath();
      ctx.arc(plot.valToPos(shown.depth_mm(), "x", true), plot.valToPos(shown.force(), "y", true), 0.33 * px, 0, 7);
      ctx.fill();
    }
    ctx.restore();
  }

  /// Updates the curve of HU under the tool's axis in every slice.
  update_hu(shown) {
    const { bone } = shown, tip = shown.values("tool_m");
    if (!bone || !bone.slices.some(({ hu }) => hu)) {
      if (this.profile === null) return;
      this.profile = null;
      this.hu.set([[0, 1], [null, null]], [0, 1], [0, 1000]);
      return;
    }
    const x = tip?.[0] ?? 0, y = tip?.[1] ?? 0, axis = shown.values("axis") ?? [0, 0, -1], z = tip?.[2] ?? bone.top_m;
    const moved = !this.profile || this.profile.bone !== bone || Math.hypot(x - this.profile.x, y - this.profile.y) > 1e-4;
    if (moved) {
      const points = bone.slices.map((slice) => {
        const ahead = Math.abs(axis[2]) > 0.1 ? (slice.z_m - z) / axis[2] : 0;
        return { depth: 1000 * (bone.top_m - slice.z_m), hu: hu_at(slice, x + ahead * axis[0], y + ahead * axis[1]) };
      });
      this.profile = { bone, x, y, points, low: Math.min(0, ...points.map(({ hu }) => hu ?? 0)), high: Math.max(300, ...points.map(({ hu }) => hu ?? 0)) };
    }
    const front = this.front_of(shown);
    if (!moved && front?.text === this.front?.text) return;
    this.front = front;
    const { points, low, high } = this.profile;
    const margin = Math.max(2, 0.06 * points[points.length - 1].depth);
    this.hu.set([[0, 1], [null, null]], [-margin, points[points.length - 1].depth + margin], [low, 100 * Math.ceil(1.15 * high / 100)]);
  }

  /// Returns the cutting front, or the tip if nothing is being cut; null if there is no row.
  front_of(shown) {
    const z = shown.value("front_z_m"), is_cutting = z !== 0 && !Number.isNaN(z);  // only that force law writes the column
    const mm = is_cutting ? 1000 * (shown.bone.top_m - z) : shown.depth_mm();
    if (Number.isNaN(mm) || !shown.row) return null;
    const hu = shown.value("front_HU");
    const text = is_cutting ? `front ${mm.toFixed(1)} mm${hu > -1000 ? `, ${hu.toFixed(0)} HU` : ""}` : `tip ${mm.toFixed(1)} mm`;
    return { mm, text };
  }

  draw_hu(plot) {
    const { profile } = this;
    if (!profile) return;
    const ctx = clip(plot), px = rem() * devicePixelRatio, zero = plot.valToPos(Math.max(0, this.hu.y[0]), "y", true);
    const { points } = profile;
    const gaps = points.slice(1).map((point, k) => point.depth - points[k].depth);
    const half = Math.min(1, ...gaps) / 2 || 0.5;
    ctx.fillStyle = css("--blue");
    for (const { depth, hu } of points) {
      if (hu === null) continue;
      const left = plot.valToPos(depth - half, "x", true), right = plot.valToPos(depth + half, "x", true);
      ctx.fillRect(left, Math.min(zero, plot.valToPos(hu, "y", true)), Math.max(0.35 * px, right - left - 1), Math.abs(plot.valToPos(hu, "y", true) - zero));
    }
    if (this.front) {
      const { mm, text } = this.front;
      vertical(plot, ctx, mm, css("--orange"), false);
      const { left, width, top } = plot.bbox, at = Math.min(left + width, Math.max(left, plot.valToPos(mm, "x", true)));
      ctx.font = label_font();
      const is_right = at + ctx.measureText(text).width + px > left + width;
      words(ctx, text, at + (is_right ? -0.4 : 0.4) * px, top + 0.2 * px, css("--orange"), is_right ? "right" : "left");
    }
    ctx.restore();
  }

  update_ticks(shown) {
    const edges = shown.about.histogram_edges_us;  // bin k is from edge k to the next
    const parts = ["tick_us", "wake_us"].map((name) => shown.values(name));
    this.bins = null;
    if (!edges || !parts[0]) {
      this.ticks.set([[0, 1], [null, null]], [0, 12], [0, 1]);
      return;
    }
    const fractions = parts.map((counts) => {
      const total = counts ? counts.reduce((a, b) => a + b, 0) : 0;
      return Array.from(counts ?? [], (count) => (total ? count / total : 0));
    });
    this.bins = { edges, fractions };
    let last = 0;
    fractions.forEach((list) => list.forEach((fraction, k) => { if (fraction > 0) last = Math.max(last, k); }));
    const to = Math.ceil(Math.log2(edges[last + 1] || 1024));
    this.ticks.set([[0, 1], [null, null]], [0, Math.max(7, to)], [0, round_up(1.05 * Math.max(0.01, ...fractions.flat()))]);
  }

  draw_ticks(plot) {
    const { bbox } = plot, px = rem() * devicePixelRatio, ctx = clip(plot);
    if (!this.bins) {
      words(ctx, this.shown?.is_recording ? "not in a recording" : "", bbox.left + bbox.width / 2, bbox.top + bbox.height / 3, css("--soft"), "center");
      return ctx.restore();
    }
    const { edges, fractions } = this.bins;
    for (const [which, colour] of [[0, "--blue"], [1, "--orange"]]) {
      ctx.strokeStyle = ctx.fillStyle = css(colour);
      ctx.lineWidth = 0.15 * px;
      ctx.beginPath();
      for (const [k, fraction] of fractions[which].entries()) {
        if (!fraction) continue;
        const from = Math.log2(Math.max(1, edges[k])), to = Math.log2(Math.max(1.1, edges[k + 1]));
        const x = plot.valToPos(from, "x", true), width = plot.valToPos(to, "x", true) - x, y = plot.valToPos(fraction, "y", true), zero = plot.valToPos(0, "y", true);
        if (which === 0) ctx.fillRect(x, y, Math.max(1, width - 1), zero - y);
        else ctx.rect(x, y, Math.max(1, width - 1), zero - y);
      }
      ctx.stroke();
    }
    ctx.restore();
  }
}
