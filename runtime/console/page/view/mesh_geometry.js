// SPDX-License-Identifier: Apache-2.0
// Geometry of slices and surfaces for three.js: coloured triangles, contours, a coarser mesh, light.
import * as THREE from "three";
import { colours_of } from "./hu.js";

export const kCoarseTriangles = 10000;  // about this many triangles of a surface are drawn if the resolution is reduced

/// Returns triangles with the colours of their HU. `width`: numbers per vertex, 2 for x and y, 3 for x, y and z.
export function mesh_geometry(positions, width, triangles, hu, range) {
  const count = positions.length / width, xyz = new Float32Array(3 * count);
  for (let i = 0; i < count; ++i) {
    xyz[3 * i] = positions[width * i];
    xyz[3 * i + 1] = positions[width * i + 1];
    if (width === 3) xyz[3 * i + 2] = positions[3 * i + 2];
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(xyz, 3));
  geometry.setAttribute("color", new THREE.BufferAttribute(colours_of(hu, range, count), 3, true));
  geometry.setIndex(new THREE.BufferAttribute(triangles, 1));
  return geometry;
}

/// Returns the boundary edges of a slice's mesh: its contour and its holes.
export function boundary_of(triangles, vertices) {
  const seen = new Map();
  for (let k = 0; k < triangles.length; k += 3)
    for (let e = 0; e < 3; ++e) {
      const a = triangles[k + e], b = triangles[k + ((e + 1) % 3)];
      const back = b * vertices + a;
      if (seen.has(back)) seen.delete(back);
      else seen.set(a * vertices + b, [a, b]);
    }
  return new Uint32Array([...seen.values()].flat());
}

/// Returns a mesh of about kCoarseTriangles triangles for pictures of reduced resolution. The vertices in each cell of a grid are
/// replaced by their mean (vertex clustering, Rossignac and Borrel 1993).
export function coarse_of(geometry) {
  const triangles = geometry.index.array, xyz = geometry.getAttribute("position"), triangle = new THREE.Triangle();
  let area = 0;
  for (let k = 0; k < triangles.length; k += 3)
    area += triangle.setFromAttributeAndIndices(xyz, triangles[k], triangles[k + 1], triangles[k + 2]).getArea();
  const cell = Math.sqrt((2 * area) / kCoarseTriangles), of_cell = (value) => Math.floor(value / cell);
  const firsts = new Map(), first = new Uint32Array(xyz.count), counts = new Uint32Array(xyz.count), means = new Float32Array(3 * xyz.count);
  for (let i = 0; i < xyz.count; ++i) {
    const key = of_cell(xyz.getX(i)) + 2 ** 17 * (of_cell(xyz.getY(i)) + 2 ** 17 * of_cell(xyz.getZ(i)));
    if (!firsts.has(key)) firsts.set(key, i);
    const at = (first[i] = firsts.get(key));
    ++counts[at];
    for (let k = 0; k < 3; ++k) means[3 * at + k] += xyz.array[3 * i + k];
  }
  for (let i = 0; i < means.length; ++i) means[i] /= counts[Math.floor(i / 3)] || 1;
  const kept = [];
  for (let k = 0; k < triangles.length; k += 3) {
    const a = first[triangles[k]], b = first[triangles[k + 1]], c = first[triangles[k + 2]];
    if (a !== b && b !== c && c !== a) kept.push(a, b, c);
  }
  const coarse = new THREE.BufferGeometry();
  coarse.setAttribute("position", new THREE.BufferAttribute(means, 3));
  coarse.setAttribute("color", geometry.getAttribute("color"));
  coarse.setIndex(kept);
  return coarse;
}

/// Adds light from the front and above to the colours of the vertices. Without a GPU this costs less than lighting each pixel.
/// Returns the side of the triangles that is outside.
export function light(geometry) {
  geometry.computeVertexNormals();
  const normals = geometry.getAttribute("normal"), colours = geometry.getAttribute("color"), at = geometry.getAttribute("position"), index = geometry.index.array;
  let volume = 0;
  const a = new THREE.Vector3(), b = new THREE.Vector3(), c = new THREE.Vector3();
  for (let k = 0; k < index.length; k += 3)
    volume += a.fromBufferAttribute(at, index[k]).dot(b.fromBufferAttribute(at, index[k + 1]).cross(c.fromBufferAttribute(at, index[k + 2])));
  const out = volume < 0 ? -1 : 1;
  const from = new THREE.Vector3(0.1, -0.7, 0.75).normalize();
  for (let i = 0; i < at.count; ++i) {
    const brightness = 0.75 + 0.55 * Math.max(-0.6, out * a.fromBufferAttribute(normals, i).dot(from));
    for (let k = 0; k < 3; ++k) colours.array[3 * i + k] = Math.min(255, colours.array[3 * i + k] * brightness);
  }
  geometry.deleteAttribute("normal");
  return out > 0 ? THREE.FrontSide : THREE.BackSide;
}
