// SPDX-License-Identifier: Apache-2.0
// HU as colour: the map cividis (perceptually uniform, and looking the same to people with a colour vision deficiency), and its legend.

const kStops = ("00224e 002e6a 1a386f 32436d 434e6c 535a6d 61656f 6f7073 7d7c78 8c8878 9b9476 aba072 bcae6c cdbb63 dec958 f0d846 fee838")
  .split(" ").map((hex) => [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16)));
// The darkest quarter is left out: it could not be distinguished from a dark page.
const kFirst = 4;

export const kNoHu = [150, 160, 170];  ///< grey: the asset has no HU

/// Returns the colour of a fraction (0..1) of the range, as [red, green, blue] from 0 to 255.
export function colour(fraction) {
  const at = kFirst + Math.min(1, Math.max(0, fraction)) * (kStops.length - 1 - kFirst);
  const low = Math.min(Math.floor(at), kStops.length - 2);
  return kStops[low].map((value, k) => value + (at - low) * (kStops[low + 1][k] - value));
}

/// Returns the range of the map for these arrays of HU, from their 2nd to their 98th percentile. It is rounded so that the quarters of
/// the legend are round numbers, too. Returns null if there is no HU.
export function range_of(arrays) {
  const sample = [];
  for (const hu of arrays) {
    const step = Math.max(1, Math.floor(hu.length / 400));
    for (let i = 0; i < hu.length; i += step) sample.push(hu[i]);
  }
  if (!sample.length) return null;
  sample.sort((a, b) => a - b);
  const at = (fraction) => sample[Math.round(fraction * (sample.length - 1))];
  const low = 100 * Math.floor(at(0.02) / 100);
  return [low, low + 200 * Math.max(1, Math.ceil((at(0.98) - low) / 200))];
}

/// Returns the colours of the vertices as bytes.
export function colours_of(hu, range, count) {
  const bytes = new Uint8Array(3 * count);
  for (let i = 0; i < count; ++i) bytes.set(hu && range ? colour((hu[i] - range[0]) / (range[1] - range[0])) : kNoHu, 3 * i);
  return bytes;
}

export function draw_legend(range) {
  const canvas = document.getElementById("legend-bar"), ticks = document.getElementById("legend-ticks");
  const box = document.getElementById("legend");
  box.hidden = !range;
  if (!range) return;
  const brush = canvas.getContext("2d");
  for (let y = 0; y < 64; ++y) {
    brush.fillStyle = `rgb(${colour(1 - y / 63).map(Math.round).join(",")})`;
    brush.fillRect(0, y, 1, 1);
  }
  ticks.replaceChildren();
  for (let k = 0; k <= 4; ++k) {
    const tick = document.createElement("span");
    tick.textContent = Math.round(range[0] + (k / 4) * (range[1] - range[0]));
    tick.style.bottom = `${25 * k}%`;
    ticks.append(tick);
  }
}
