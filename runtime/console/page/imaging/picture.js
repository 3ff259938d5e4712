// SPDX-License-Identifier: Apache-2.0
// From sums along rays to the grey levels of an X-ray picture, with the shadow of the needle. Runs in node for tests, too.
import { dot } from "./volume.js";
import { project, ray_of } from "./c_arm.js";

const kWater_per_mm = 0.02, kMetal_per_mm = 0.35, kScatter = 0.08, kNoise = 0.012;
const kLevels = 1024;  // of darkness, in the picture's window
// Colours of what is collimated: without and with the needle.
const kCollimator = 0xff281c14, kOutsideNeedle = 0xff706a62;

/// Takes out what changes slowly over the picture, as C-arms do: without it gas and large organs hide the spine. Only covered pixels
/// (covered_pixels()) count.
export function harmonise(sum, size, is_covered) {
  const half = Math.round(size / 8), line = new Float32Array(size);
  const blur = (values) => {
    const blur_line = (at, stride) => {
      let total = 0;
      for (let i = 0; i < size; ++i) line[i] = values[at + i * stride];
      for (let i = -half; i <= half; ++i) total += line[Math.min(size - 1, Math.max(0, i))];
      for (let i = 0; i < size; ++i) {
        values[at + i * stride] = total / (2 * half + 1);
        total += line[Math.min(size - 1, i + half + 1)] - line[Math.max(0, i - half)];
      }
    };
    for (let pass = 0; pass < 3; ++pass) {
      for (let row = 0; row < size; ++row) blur_line(row * size, 1);
      for (let column = 0; column < size; ++column) blur_line(column, size);
    }
    return values;
  };
  const covered = Float32Array.from(is_covered), count = covered.reduce((a, b) => a + b, 0) || 1;
  const mean = sum.reduce((total, value, i) => total + value * covered[i], 0) / count;
  const slow = blur(sum.map((value, i) => value * covered[i])), share = blur(covered.slice());
  return sum.map((value, i) => (covered[i] ? value - 0.7 * (slow[i] / share[i] - mean) : value));
}

/// Length in mm of a ray inside the needle: a cylinder that begins at the tip. `axis`: unit vector up the shaft.
export function chord_mm(source, ray, { tip, axis, radius_m }) {
  const m = [0, 1, 2].map((k) => source[k] - tip[k]), ra = dot(ray, axis), ma = dot(m, axis);
  const r = [0, 1, 2].map((k) => ray[k] - ra * axis[k]), q = [0, 1, 2].map((k) => m[k] - ma * axis[k]);
  const a = dot(r, r), b = dot(r, q), c = dot(q, q) - radius_m * radius_m, inside = b * b - a * c;
  if (!(a > 1e-12) || !(inside > 0)) return 0;
  let t0 = (-b - Math.sqrt(inside)) / a, t1 = (-b + Math.sqrt(inside)) / a;
  if (Math.abs(ra) > 1e-12) {  // cut off below the tip
    const at_tip = -ma / ra;
    if (ra > 0) t0 = Math.max(t0, at_tip);
    else t1 = Math.min(t1, at_tip);
  } else if (ma < 0) return 0;
  return Math.max(0, t1 - t0) * 1000;
}

/// A picture from one position of the C-arm, which shows the needle wherever it is. Bone is dark.
export class Picture {
  /// `sum`: xray_sum() of size x size. `is_covered`: of a picture of all tissue, which was harmonised; what is not covered is collimated.
  constructor(view, size, sum, is_covered = null) {
    Object.assign(this, { view, size });
    const middle = [];
    for (let row = size >> 3; row < size - (size >> 3); row += 2)
      for (let column = size >> 3; column < size - (size >> 3); column += 2) {
        const value = sum[row * size + column];
        if (!is_covered || is_covered[row * size + column]) middle.push(value);
      }
    const in_middle = Float32Array.from(middle).sort(), part = (share) => in_middle[Math.floor(share * (in_middle.length - 1))] ?? 0;
    this.middle = kWater_per_mm * part(0.5);
    this.depth = sum.map((value) => kWater_per_mm * value);
    this.is_covered = is_covered;
    const [low, high] = [this.#dark(kWater_per_mm * part(0.01)), this.#dark(kWater_per_mm * part(0.99))];
    const width = Math.max(0.05, 1.25 * (high - low));
    this.low = (low + high - width) / 2;
    this.scale = (kLevels - 1) / width;
    this.dark = this.depth.map((depth) => (this.#dark(depth) - this.low) * this.scale);
    this.noise = Float32Array.from({ length: 4096 }, (_, i) => kLevels * kNoise * (((i * 2654435761 >>> 8) % 2001) / 1000 - 1));
    this.levels = Uint8Array.from({ length: kLevels }, (_, i) => {
      const x = i / (kLevels - 1);
      return 255 - Math.round(255 * x * x * (3 - 2 * x));
    });
  }
  /// How dark the detector is behind a depth of absorber. The scatter keeps it from becoming infinite behind metal.
  #dark(depth) { return -Math.log(Math.exp(this.middle - depth) + kScatter); }

  /// Fills `pixels` (RGBA of an ImageData). `needle`: {tip, axis, radius_m} in {B}, or null. `shot` selects the noise.
  draw(pixels, needle, shot = 0, is_inverted = false) {
    const { size, dark, noise, levels, is_covered } = this, words = new Uint32Array(pixels.buffer, pixels.byteOffset, size * size);
    const flip = is_inverted ? 255 : 0, last = kLevels - 1, shift = shot * 977;
    const grey = (value, i) => {
      const level = value + noise[(i * 7 + (i >> 9) * 131 + shift) & 4095];
      return 0xff000000 | (levels[level <= 0 ? 0 : level >= last ? last : level | 0] ^ flip) * 0x010101;
    };
    for (let i = 0; i < words.length; ++i) words[i] = grey(dark[i], i);
    if (is_covered) for (let i = 0; i < words.length; ++i) if (!is_covered[i]) words[i] = kCollimator;
    if (needle) this.#each_of_needle(needle, (i, mm) => {
      words[i] = is_covered && !is_covered[i] ? kOutsideNeedle : grey((this.#dark(this.depth[i] + kMetal_per_mm * mm) - this.low) * this.scale, i);
    });
  }

  /// Calls found(index, mm) for each pixel behind the needle.
  #each_of_needle(needle, found) {
    const { view, size } = this;
    const reach = [0, 0.4].map((up) => project(view, size, [0, 1, 2].map((k) => needle.tip[k] + up * needle.axis[k])));
    const half = 2 + needle.radius_m / view.width_m * size * 2;
    const [x0, x1] = [Math.min(reach[0][0], reach[1][0]) - half, Math.max(reach[0][0], reach[1][0]) + half];
    const [y0, y1] = [Math.min(reach[0][1], reach[1][1]) - half, Math.max(reach[0][1], reach[1][1]) + half];
    const dx = reach[1][0] - reach[0][0], dy = reach[1][1] - reach[0][1], length = Math.max(1e-6, Math.hypot(dx, dy));
    for (let row = Math.max(0, Math.ceil(y0)); row <= Math.min(size - 1, y1); ++row) {
      for (let column = Math.max(0, Math.ceil(x0)); column <= Math.min(size - 1, x1); ++column) {
        const aside = Math.abs((column - reach[0][0]) * dy - (row - reach[0][1]) * dx) / length;
        if (length > half && aside > half) continue;
        const mm = chord_mm(view.source, ray_of(view, size, column, row), needle);
        if (mm > 0) found(row * size + column, mm);
      }
    }
  }
}

