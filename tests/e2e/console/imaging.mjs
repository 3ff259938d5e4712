// SPDX-License-Identifier: Apache-2.0
// Runs the page's arithmetic of X-ray and CT planes in node: imaging.mjs VOLUME.bin JOB.json. VOLUME.bin is an answer of /api/volume. JOB.json:
// {"sums": [{"turn_deg", "tilt_deg", "width_m", "size", "file"}], "hu": [[x, y, z], ...], "tip": [...], "axis": [...], "windows": [[hu, level, width], ...]}.
// Writes each sum as float32, and prints JSON: {"hu", "greys", "needles": [pixel of the darkest end of the needle], "projected", "planes", "angles", "ms"}.
import { readFileSync, writeFileSync } from "node:fs";

const page = new URL("../../../runtime/console/page/", import.meta.url);
const { parse_container } = await import(new URL("container.js", page));
const { hu_at, read_volume, xray_grids } = await import(new URL("imaging/volume.js", page));
const { covered_pixels, project, view_of, xray_sum } = await import(new URL("imaging/c_arm.js", page));
const { Picture, harmonise } = await import(new URL("imaging/picture.js", page));
const { angles_of, grey_of, plane_axes, sample_plane } = await import(new URL("imaging/ct_planes.js", page));

const [, , volume_file, job_file] = process.argv;
const bytes = readFileSync(volume_file), job = JSON.parse(readFileSync(job_file));
const volume = read_volume(parse_container(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length)));
const out = { needles: [], projected: [], ms: [] };
const grids = xray_grids(volume);
for (const { turn_deg, tilt_deg, width_m, size, file } of job.sums ?? []) {
  const view = view_of(volume, turn_deg, tilt_deg, width_m), began = performance.now();
  const sum = xray_sum(grids, view, size);
  out.ms.push(performance.now() - began);
  writeFileSync(file, sum);
  if (!job.tip) continue;
  const is_covered = volume.context ? covered_pixels(grids[1], view, size) : null;
  const picture = new Picture(view, size, is_covered ? harmonise(sum, size, is_covered) : sum, is_covered), rgba = [null, { tip: job.tip, axis: job.axis, radius_m: job.radius_m }].map((needle) => {
    const pixels = new Uint8ClampedArray(4 * size * size);
    picture.draw(pixels, needle);
    return pixels;
  });
  const changed = [];
  for (let i = 0; i < size * size; ++i) if (rgba[0][4 * i] !== rgba[1][4 * i]) changed.push([i % size, Math.floor(i / size)]);
  out.needles.push(changed);
  out.projected.push([project(view, size, job.tip), project(view, size, job.tip.map((x, k) => x + 0.02 * job.axis[k]))]);
}
out.hu = (job.hu ?? []).map((p) => hu_at(volume, p)).map((x) => (Number.isNaN(x) ? null : x));
out.greys = (job.windows ?? []).map(([hu, level, width]) => grey_of(hu, level, width));
if (job.axis) {
  out.angles = angles_of(volume.patient, job.axis);
  out.axes = plane_axes(volume.patient, job.axis);
  out.planes = Object.fromEntries(Object.entries(out.axes).map(([name, axes]) => [name, Array.from(sample_plane(volume, job.tip, axes, 0.03, 5, new Float64Array(25)), (x) => (Number.isNaN(x) ? null : x))]));
}
console.log(JSON.stringify(out));
