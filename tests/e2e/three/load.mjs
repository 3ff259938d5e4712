// SPDX-License-Identifier: Apache-2.0
// node load.mjs ASSET.glb: opens the asset as a web page would, with three.js's own
// GLTFLoader and DRACOLoader (and the Draco decoder that three.js ships), and prints
// as JSON what the scene then holds: slice by slice counts and bounds.
//
// Exit 0 if it loads without a single error or warning; 1 otherwise, 2 on wrong usage.
import fs from 'node:fs';
import http from 'node:http';
import path from 'node:path';
import { fileURLToPath } from 'node:url';
import './browser_shims.mjs';

const kTimeoutMs = 120000; // a decoder that dies inside a worker never answers

const asset = process.argv[2];
if (process.argv.length !== 3) {
  console.error('usage: node load.mjs ASSET.glb');
  process.exit(2);
}

const complaints = [];
for (const level of ['error', 'warn']) {
  console[level] = (...words) => complaints.push(`${level}: ${words.join(' ')}`);
}
const fail = (why) => {
  process.stderr.write([...complaints, `load.mjs: ${asset}: ${why}`].join('\n') + '\n');
  process.exit(1);
};
setTimeout(() => fail(`not loaded within ${kTimeoutMs / 1000} s`), kTimeoutMs).unref();

// Served by HTTP, so that the loaders fetch everything the way they do in a browser.
const here = path.dirname(fileURLToPath(import.meta.url));
const decoder = path.join(here, 'node_modules/three/examples/jsm/libs/draco/gltf');
const server = http.createServer((request, response) => {
  const name = new URL(request.url, 'http://localhost').pathname;
  const file = name === '/asset.glb' ? asset : path.join(decoder, path.basename(name));
  fs.readFile(file, (error, bytes) => {
    response.writeHead(error ? 404 : 200, bytes ? { 'Content-Length': bytes.length } : {});
    response.end(bytes);
  });
});

function bounds(geometry) {
  geometry.computeBoundingBox();
  const { min, max } = geometry.boundingBox;
  return { min: min.toArray(), max: max.toArray() };
}

/** [HU, red, green, blue] of each vertex, colours from 0 to 255; null without. */
function colours_with_hu(geometry) {
  const hu = geometry.getAttribute('_hu'), colour = geometry.getAttribute('color');
  if (!colour) return null;
  return Array.from({ length: hu.count }, (_, i) => [8 * hu.getX(i), ...['getX', 'getY', 'getZ'].map(
    (component) => Math.round(255 * colour[component](i)))]);
}

/** What some objects of the scene hold. Positions are as stored: lattice steps. */
function describe(index, objects) {
  const slice = {
    index, triangles: 0, vertices: 0, line_segments: 0, bounds: null, has_hu: false, colours: null,
  };
  for (const top of objects) top.traverse((object) => {
    const geometry = object.geometry;
    if (!geometry) return;
    const positions = geometry.getAttribute('position');
    const elements = geometry.index ? geometry.index.count : positions.count;
    if (![...positions.array].every(Number.isFinite)) throw new Error('a position is not finite');
    if (geometry.index && [...geometry.index.array].some((i) => i >= positions.count)) {
      throw new Error('an index is out of range');
    }
    if (object.isMesh) {
      slice.triangles += elements / 3;
      slice.vertices += positions.count;
      slice.bounds = bounds(geometry);
      slice.has_hu = geometry.hasAttribute('_hu');
      slice.colours = colours_with_hu(geometry);
    } else if (object.isLineSegments) {
      slice.line_segments += elements / 2;
      slice.lines_bounds = bounds(geometry);
    } else {
      throw new Error(`unexpected object of type ${object.type}`);
    }
  });
  return slice;
}

server.listen(0, '127.0.0.1', async () => {
  try {
    const three = await import('three');
    const { GLTFLoader } = await import('three/examples/jsm/loaders/GLTFLoader.js');
    const { DRACOLoader } = await import('three/examples/jsm/loaders/DRACOLoader.js');
    const origin = `http://127.0.0.1:${server.address().port}`;
    const draco = new DRACOLoader().setDecoderPath(`${origin}/`).setWorkerLimit(2);
    const gltf = await new GLTFLoader().setDRACOLoader(draco).loadAsync(`${origin}/asset.glb`);
    gltf.scene.updateMatrixWorld(true);
    const box = new three.Box3().setFromObject(gltf.scene, true);

    // Node 2's children hold the slices: triangles, which their lines may follow. Indices ascend by 1
    // where a node does not say otherwise. Surfaces for display say so.
    const slices = [], surfaces = [];
    let next = 0;
    for (const number of gltf.parser.json.nodes[2].children ?? []) {
      const node = await gltf.parser.getDependency('node', number);
      next = node.userData.trocar?.index ?? next;
      const objects = node.isMesh || node.children.length === 0 ? [node] : node.children;
      objects.forEach((object, i) => {
        if (object.isLineSegments) return;
        const lines = objects[i + 1]?.isLineSegments ? [objects[i + 1]] : [];
        slices.push(describe(next++, [object, ...lines]));
      });
    }
    gltf.scene.traverse((node) => {
      if (Number.isInteger(node.userData.trocar?.surface)) surfaces.push(describe(null, [node]));
    });
    if (complaints.length) throw new Error('the loaders complained');
    const drawn = describe(null, [gltf.scene]);
    const sum_of = (list, field) => list.reduce((sum, one) => sum + one[field], 0);
    const total = (field) => sum_of(slices, field);
    if (slices.length === 0) throw new Error('no slices');
    for (const field of ['triangles', 'vertices', 'line_segments']) {
      if (total(field) + sum_of(surfaces, field) !== drawn[field]) throw new Error(`${field} outside of the slices`);
    }
    const result = {
      three: three.REVISION, node: process.version, slices, surfaces,
      triangles: total('triangles'), vertices: total('vertices'),
      line_segments: total('line_segments'),
      world_bounds_m: { min: box.min.toArray(), max: box.max.toArray() },
    };
    process.stdout.write(JSON.stringify(result) + '\n', () => process.exit(0));
  } catch (error) {
    // three.js rejects with an Error, or with a worker's message { error }.
    fail(error?.message ?? error?.error ?? String(error));
  }
});
