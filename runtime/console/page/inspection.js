// SPDX-License-Identifier: Apache-2.0
// What the page shows, as data: `window.trocar`, for tests and for debugging in the browser's console.
import { by_id } from "./elements.js";

const row_of = (source) => (source?.row ? Object.fromEntries([...source.columns.at.keys()].map((name) => [name, Array.from(source.values(name))])) : null);
export const inspection_of = (app) => ({
  get role() { return app.role; },
  get tab() { return app.tab; },
  get state() { return app.state; },
  get session() { return app.link.session; },
  get pid() { return app.live?.about.pid ?? null; },
  get is_connected() { return app.connected; },
  get goals() { return app.goals.shown; },
  get ghost_row() { return row_of(app.live?.second); },
  get words() { return `${by_id("state").textContent}: ${by_id("words").textContent}`; },
  get row() { return row_of(app.live); },
  get events() { return app.live?.events ?? []; },
  get history_s() { return app.live?.history.t ?? []; },
  get camera() {
    if (!app.view) return null;
    const { cameras } = app.view, { right, up } = cameras.plane([0, 0, 0], 1);
    return { right, up, away_m: cameras.active.position.distanceTo(cameras.turn.target) };
  },
  get hand() {
    if (!app.hand) return null;
    const { is_held, holder, target, force_N, lag_mm, words, sent, felt, scale_N } = app.hand;
    return { is_held, holder, target, force_N, lag_mm, words, sent, felt, scale_N };
  },
  get imaging() {
    const { open, why, xray, volume } = app.imaging;
    return { open, why, is_ready: Boolean(xray.is_ready), has_context: Boolean(volume?.context), positions: xray.pictures.count,
      has_position: Boolean(xray.volume && xray.pictures.has(xray.key)), drawn: xray.drawn,
      tip_px: xray.tip_px ?? null, is_screening: xray.is_screening };
  },
  get planning() {
    const { is_open, is_making, picks, result } = app.planning;
    return { is_open, is_making, picks, points: { entry: app.planning.place("entry"), target: app.planning.place("target") }, result: result ?? null };
  },
  get section_z_m() { return app.view?.slices[app.view.near]?.z_m ?? null; },
  pick: (x, y) => app.view?.pick(x, y) ?? null,
  pixel_of: (at_m) => app.view?.pixel_of(at_m) ?? null,
  get missed() { return app.live?.missed ?? 0; },
  get slices() { return app.view?.slices.map(({ slice, z_m, triangles, positions, cuts }) => ({ slice, z_m, triangles: triangles.length / 3, vertices: positions.length / 2, cuts: cuts ?? 0 })) ?? []; },
  get totals() { return app.gauges.totals; },
  get surface_triangles() { return (app.view?.surface?.geometry.index.count ?? 0) / 3; },
  get drawn_surface_triangles() {
    const drawn = [app.view?.surface, app.view?.coarse_surface].find((surface) => surface?.visible);
    return (drawn?.geometry.index.count ?? 0) / 3;
  },
  get bone_shown_ms() { return app.view?.bone_shown_ms ?? null; },
  get frames() { return app.view?.pace.frames ?? 0; },
  get scale() { return app.view?.pace.scale ?? 0; },
  get renderer() { return app.view?.renderer_name ?? ""; },
  get shape() { return { vertices: app.view?.shape ? app.view.shape_w.length : 0, deepest_m: app.view?.shape?.visible ? app.view.shape_depth_m : 0 }; },
  get playback_axis() { return app.playback.first?.values("axis") ?? null; },
  get playback_row() { return row_of(app.playback.first); },
  get playback() { return { file: app.playback.file, time_s: app.playback.time_s, end_s: app.playback.end_s, events: app.playback.first?.events.length ?? 0, all_events: app.playback.first?.all_events ?? [], second: Boolean(app.playback.first?.second) }; },
});
