// SPDX-License-Identifier: Apache-2.0
// Computes X-ray pictures beside the page, which stays fluent. In: {container} once, then {key, view, size, step}. Out: {ready} once, then
// {key, size, view, sum, is_covered}. The page sends one request at a time: the one that it then needs most.
import { parse_container } from "../container.js";
import { covered_pixels, xray_sum } from "./c_arm.js";
import { harmonise } from "./picture.js";
import { read_volume, xray_grids } from "./volume.js";

let grids = null, has_context = false;

onmessage = ({ data }) => {
  if (data.container) {
    const volume = read_volume(parse_container(data.container));
    grids = xray_grids(volume);
    has_context = Boolean(volume.context);
    postMessage({ ready: true });
    return;
  }
  const { key, view, size, step } = data;
  let sum = xray_sum(grids, view, size, step);
  const is_covered = has_context ? covered_pixels(grids[1], view, size) : null;
  if (is_covered) sum = harmonise(sum, size, is_covered);
  postMessage({ key, size, view, sum, is_covered }, [sum.buffer]);
};
