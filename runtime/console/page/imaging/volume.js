// SPDX-License-Identifier: Apache-2.0
// The HU of a scan in {B}: the stack of planes that the console sends, and the even grids for X-ray that are made from it.
// Runs in the page, in a worker, and in node for tests.

const kNoHu = -32768;
const kMaxVoxels = 6e6, kMaxLevels = 4096;  // of a grid for X-ray
const kMaxGap = 2.5;  // spacings between two planes with nothing between them: further apart, slices without material are missing
const kPointsOfCell = 16;  // of `inside`
const kSoftTissue_HU = 40;  // X-ray of bone alone shows what is above it

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (a, s) => [a[0] * s, a[1] * s, a[2] * s];

/// Planes of HU that are parallel, sorted along their normal.
export class Stack {
  /// `volume`: `bone` or `context` of /api/volume; `shorts` and `bytes` make the arrays of the container.
  constructor(volume, shorts, bytes) {
    const [first] = volume.planes;
    this.pitch_m = [Math.hypot(...first.column_m), Math.hypot(...first.row_m)];
    this.across = [scaled(first.column_m, 1 / this.pitch_m[0]), scaled(first.row_m, 1 / this.pitch_m[1])];
    this.normal = cross(...this.across);
    this.planes = volume.planes.map((plane) => ({
      slice: plane.slice, columns: plane.columns, rows: plane.rows,
      at: [dot(plane.origin_m, this.across[0]), dot(plane.origin_m, this.across[1])], height: dot(plane.origin_m, this.normal),
      hu: shorts(plane.hu), inside: plane.inside ? bytes(plane.inside) : null })).sort((a, b) => a.height - b.height);
    const gaps = this.planes.slice(1).map(({ height }, i) => height - this.planes[i].height).sort((a, b) => a - b);
    this.spacing_m = gaps[gaps.length >> 1] || this.pitch_m[0];
  }

  /// HU of one plane at its two coordinates: bilinear in the samples that are stored; NaN if none of the four is.
  #in_plane({ columns, rows, at, hu }, x_m, y_m) {
    const x = (x_m - at[0]) / this.pitch_m[0], y = (y_m - at[1]) / this.pitch_m[1];
    if (!(x > -1 && y > -1 && x < columns && y < rows)) return NaN;
    const c = Math.floor(x), r = Math.floor(y), fx = x - c, fy = y - r;
    let sum = 0, weights = 0;
    for (let k = 0; k < 4; ++k) {
      const column = c + (k & 1), row = r + (k >> 1);
      if (column < 0 || row < 0 || column >= columns || row >= rows) continue;
      const value = hu[row * columns + column];
      if (value === kNoHu) continue;
      const weight = (k & 1 ? fx : 1 - fx) * (k >> 1 ? fy : 1 - fy);
      sum += weight * value;
      weights += weight;
    }
    return weights > 0 ? sum / weights : NaN;
  }

  /// True if there is something between two neighbouring planes.
  #are_joined(below, above) { return above.height - below.height <= kMaxGap * this.spacing_m; }

  /// HU at a position in {B}: linear between the two planes around it. NaN where nothing is stored, and further than half a spacing from
  /// planes that have no neighbour.
  at(p) {
    const { planes } = this, x = dot(p, this.across[0]), y = dot(p, this.across[1]), z = dot(p, this.normal);
    let low = 0, high = planes.length;  // planes before `low` are below the position
    while (low < high) {
      const middle = (low + high) >> 1;
      if (planes[middle].height <= z) low = middle + 1;
      else high = middle;
    }
    if (low === 0) return planes[0].height - z <= this.spacing_m / 2 ? this.#in_plane(planes[0], x, y) : NaN;
    const below = planes[low - 1];
    if (low === planes.length) return z - below.height <= this.spacing_m / 2 ? this.#in_plane(below, x, y) : NaN;
    const above = planes[low], part = (z - below.height) / (above.height - below.height);
    if (!this.#are_joined(below, above)) {
      const [near, away] = part < 0.5 ? [below, z - below.height] : [above, above.height - z];
      return away <= this.spacing_m / 2 ? this.#in_plane(near, x, y) : NaN;
    }
    const a = this.#in_plane(below, x, y), b = this.#in_plane(above, x, y);
    if (Number.isNaN(a)) return b;
    return Number.isNaN(b) ? a : a + part * (b - a);
  }

  /// An even grid of weight(hu, inside) for ray sums, where `inside` is the share of a sample's cell in the material: {n, size_m, origin (of the first voxel, along `axes`), axes, data}. There is an empty
  /// voxel on every side, so that sums end where the scan ends.
  grid(weight) {
    const { planes, pitch_m, spacing_m } = this;
    const low = [0, 1].map((k) => Math.min(...planes.map(({ at }) => at[k])));
    const high = [0, 1].map((k) => Math.max(...planes.map((plane) => plane.at[k] + (k ? plane.rows - 1 : plane.columns - 1) * pitch_m[k])));
    const n = [0, 1].map((k) => Math.round((high[k] - low[k]) / pitch_m[k]) + 1);
    const height_m = planes.at(-1).height - planes[0].height, level_m = Math.max(spacing_m, height_m / (kMaxLevels - 1));
    const levels = Math.round(height_m / level_m) + 1;
    // Grids that are too large get voxels of some samples, with their mean.
    const every = Math.max(1, Math.ceil(Math.sqrt(n[0] * n[1] * levels / kMaxVoxels)));
    const [nx, ny, nz] = [Math.ceil(n[0] / every) + 2, Math.ceil(n[1] / every) + 2, levels + 2];
    const data = new Uint16Array(nx * ny * nz), sums = new Float32Array(nx * ny);
    const fill = (plane, part) => {
      const x0 = (plane.at[0] - low[0]) / pitch_m[0], y0 = (plane.at[1] - low[1]) / pitch_m[1];
      const shift_x = Math.round(x0), shift_y = Math.round(y0), share = part / (every * every);
      for (let r = 0, i = 0; r < plane.rows; ++r) {
        const row = (Math.floor((r + shift_y) / every) + 1) * nx + 1;
        for (let c = 0; c < plane.columns; ++c, ++i) {
          const hu = plane.hu[i];
          if (hu === kNoHu) continue;
          const value = weight(hu, plane.inside ? plane.inside[i] / kPointsOfCell : 1);
          if (value > 0) sums[row + Math.floor((c + shift_x) / every)] += share * value;
        }
      }
    };
    for (let level = 0, next = 0; level < levels; ++level) {
      const height = planes[0].height + level * level_m;
      while (next + 2 < planes.length && planes[next + 1].height <= height) ++next;
      const below = planes[next], above = planes[Math.min(next + 1, planes.length - 1)];
      const part = above === below ? 0 : Math.min(1, Math.max(0, (height - below.height) / (above.height - below.height)));
      sums.fill(0);
      if (above === below || this.#are_joined(below, above)) {
        if (part < 1) fill(below, 1 - part);
        if (part > 0) fill(above, part);
      } else {
        const [near, away] = part < 0.5 ? [below, height - below.height] : [above, above.height - height];
        if (away <= level_m / 2) fill(near, 1);
      }
      const at = (level + 1) * nx * ny;
      for (let i = 0; i < sums.length; ++i) data[at + i] = Math.min(65535, sums[i] + 0.5);
    }
    const size_m = [pitch_m[0] * every, pitch_m[1] * every, level_m], offset = (every - 1) / 2;
    return { n: [nx, ny, nz], size_m, axes: [...this.across, this.normal], data,
      origin: [low[0] + (offset - every) * pitch_m[0], low[1] + (offset - every) * pitch_m[1], planes[0].height - level_m] };
  }
}

/// The scan of /api/volume as the page and the worker use it. `stacks`: bone and, if the asset has it, context.
export function read_volume({ json, shorts, bytes }) {
  const { why, patient, middle_m } = json;
  return { why, patient, middle_m, bone: json.bone && new Stack(json.bone, shorts, bytes),
    context: json.context && new Stack(json.context, shorts, bytes) };
}

/// Takes `fine` out of `coarse`, as far as the voxels of `coarse` have resolved it: each gets the mean of `fine` over its own volume less. Both grids
/// have the same axes.
function take_out(coarse, fine) {
  const volume = (grid) => grid.size_m[0] * grid.size_m[1] * grid.size_m[2], part = volume(fine) / volume(coarse);
  const places = [0, 1, 2].map((k) => Int32Array.from({ length: fine.n[k] }, (_, i) =>
    Math.min(coarse.n[k] - 1, Math.max(0, Math.round((fine.origin[k] + i * fine.size_m[k] - coarse.origin[k]) / coarse.size_m[k])))));
  const sums = new Float32Array(coarse.data.length), [nx, ny] = coarse.n;
  for (let z = 0, i = 0; z < fine.n[2]; ++z)
    for (let y = 0; y < fine.n[1]; ++y)
      for (let x = 0, at = (places[2][z] * ny + places[1][y]) * nx; x < fine.n[0]; ++x, ++i) sums[at + places[0][x]] += part * fine.data[i];
  for (let i = 0; i < sums.length; ++i) coarse.data[i] = Math.max(0, coarse.data[i] - sums[i]);
}

/// The grids whose ray sums, added, are the X-ray picture in units of HU times length: the bone's excess over soft tissue and, if the asset has
/// it, the context over air without this excess, so that bone has the sharpness of its own volume.
export function xray_grids({ bone, context }) {
  const excess = bone.grid((hu, inside) => inside * (hu - kSoftTissue_HU));
  if (!context) return [excess];
  const tissue = context.grid((hu) => hu + 1000);
  take_out(tissue, excess);
  return [excess, tissue];
}

/// HU at a position: of the bone's volume or, where that has none, of the context.
export function hu_at({ bone, context }, p) {
  const hu = bone.at(p);
  return Number.isNaN(hu) && context ? context.at(p) : hu;
}
