// SPDX-License-Identifier: Apache-2.0
// The geometry of a C-arm in {B}, in metres, and the sum of a volume along its rays. Runs in the page, in a worker, and in node for tests.
import { cross, dot } from "./volume.js";

const kSourceToMiddle_m = 0.6;

const sum_of = (...terms) => [0, 1, 2].map((k) => terms.reduce((sum, [factor, v]) => sum + factor * v[k], 0));

/// The C-arm turned by `turn_deg` about the patient's long axis (0: AP, 90: lateral) and tilted to the head. `width_m`: side of the square
/// picture at the middle. Result: `source`, `ray` (unit vector through the middle), `right` and `up` on the picture.
export function view_of({ patient, middle_m }, turn_deg, tilt_deg, width_m) {
  const a = turn_deg * Math.PI / 180, b = tilt_deg * Math.PI / 180;
  const { left, back, head } = patient;
  // In the AP position the rays go through the patient from the front to the back.
  const ray = sum_of([Math.cos(b) * Math.sin(a), left], [Math.cos(b) * Math.cos(a), back], [Math.sin(b), head]);
  const right = sum_of([Math.cos(a), left], [-Math.sin(a), back]);
  return { ray, right, up: cross_of(patient, right, ray), width_m, middle_m, source: sum_of([1, middle_m], [-kSourceToMiddle_m, ray]) };
}

/// The cross product in the patient's frame, whose axes may be a left-handed or right-handed system of {B}.
function cross_of({ left, back, head }, a, b) {
  const up = cross(a, b);
  return dot(cross(left, back), head) < 0 ? up.map((x) => -x) : up;
}

/// Column and row, in pixels, at which a picture of `size` pixels shows a position; pixel centres are at whole numbers.
export function project(view, size, p) {
  const away = sum_of([1, p], [-1, view.source]), depth = dot(away, view.ray);
  const scale = kSourceToMiddle_m / depth / view.width_m;
  return [(dot(away, view.right) * scale + 0.5) * size - 0.5, (0.5 - dot(away, view.up) * scale) * size - 0.5];
}

/// The unit vector of the ray through a pixel.
export function ray_of(view, size, column, row) {
  const a = ((column + 0.5) / size - 0.5) * view.width_m, b = (0.5 - (row + 0.5) / size) * view.width_m;
  const ray = sum_of([kSourceToMiddle_m, view.ray], [a, view.right], [b, view.up]);
  const length = Math.hypot(...ray);
  return ray.map((x) => x / length);
}

/// The rays of a picture through a grid (Stack.grid()), in its voxels: found(pixel, t0, t1, r, base), where base + t r, t0 to t1, is inside.
function each_ray(grid, view, size, found) {
  const { n, size_m, origin, axes } = grid;
  const in_grid = (v) => axes.map((axis, k) => dot(v, axis) / size_m[k]);
  const base = in_grid(view.source).map((x, k) => x - origin[k] / size_m[k]), most = n.map((count) => count - 1.001);
  for (let row = 0; row < size; ++row) {
    for (let column = 0; column < size; ++column) {
      const r = in_grid(ray_of(view, size, column, row));
      let t0 = 0, t1 = 1e9;
      for (let k = 0; k < 3; ++k) {
        if (Math.abs(r[k]) < 1e-9) {
          if (base[k] < 0 || base[k] > most[k]) t1 = -1;
          continue;
        }
        const p = -base[k] / r[k], q = (most[k] - base[k]) / r[k];
        t0 = Math.max(t0, Math.min(p, q));
        t1 = Math.min(t1, Math.max(p, q));
      }
      if (t1 > t0) found(row * size + column, t0, t1, r, base);
    }
  }
}

/// 1 for the pixels whose rays go nearly as far through the grid as the longest one, or further than half of all rays that meet it. The others see
/// too little of the scan, as at its edges.
export function covered_pixels(grid, view, size) {
  const ways = new Float32Array(size * size);
  each_ray(grid, view, size, (pixel, t0, t1) => { ways[pixel] = t1 - t0; });
  const sorted = ways.filter((way) => way > 0).sort();
  const least = Math.min(0.93 * (sorted.at(-1) ?? 1), sorted[sorted.length >> 1] ?? 1);
  return Uint8Array.from(ways, (way) => (way >= least ? 1 : 0));
}

/// Adds to `out` (size x size) the integral of a grid along the rays, in units of its values times mm. `step`: in voxels of the smallest side.
export function add_ray_sum(grid, view, size, step, out) {
  const { n: [nx, ny], size_m, data } = grid, nxy = nx * ny, step_m = step * Math.min(...size_m);
  each_ray(grid, view, size, (pixel, t0, t1, r, base) => {
    const steps = Math.max(1, Math.round((t1 - t0) / step_m)), h = (t1 - t0) / steps;
    let x = base[0] + (t0 + h / 2) * r[0], y = base[1] + (t0 + h / 2) * r[1], z = base[2] + (t0 + h / 2) * r[2];
    const dx = h * r[0], dy = h * r[1], dz = h * r[2];
    let sum = 0;
    for (let s = 0; s < steps; ++s, x += dx, y += dy, z += dz) {
      const ix = x | 0, iy = y | 0, iz = z | 0, fx = x - ix, fy = y - iy, fz = z - iz, o = iz * nxy + iy * nx + ix, p = o + nxy;
      const c00 = data[o] + fx * (data[o + 1] - data[o]), c10 = data[o + nx] + fx * (data[o + nx + 1] - data[o + nx]);
      const c01 = data[p] + fx * (data[p + 1] - data[p]), c11 = data[p + nx] + fx * (data[p + nx + 1] - data[p + nx]);
      const c0 = c00 + fy * (c10 - c00), c1 = c01 + fy * (c11 - c01);
      sum += c0 + fz * (c1 - c0);
    }
    out[pixel] += sum * h * 1000;
  });
}

/// The X-ray picture of some grids, in mm of water: the integral of HU / 1000.
export function xray_sum(grids, view, size, step = 0.8) {
  const out = new Float32Array(size * size);
  for (const grid of grids) add_ray_sum(grid, view, size, step, out);
  for (let i = 0; i < out.length; ++i) out[i] /= 1000;
  return out;
}
