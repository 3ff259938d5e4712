// SPDX-License-Identifier: Apache-2.0
// node load_files.mjs FILE.stl FILE.ply FILE.obj ...: opens files of `trocar-mesh export --surface` by three.js's own loaders
// and prints as JSON how many triangles each has and its bounds.
import fs from 'node:fs';
import path from 'node:path';

const kLoaders = { '.stl': 'STLLoader', '.ply': 'PLYLoader', '.obj': 'OBJLoader' };
const out = [];
for (const file of process.argv.slice(2)) {
  const kind = path.extname(file);
  const loader = new (await import(`three/examples/jsm/loaders/${kLoaders[kind]}.js`))[kLoaders[kind]]();
  const bytes = fs.readFileSync(file);
  const loaded = loader.parse(
    kind === '.obj' ? bytes.toString() : bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
  const geometry = loaded.isBufferGeometry ? loaded : loaded.children[0].geometry;
  geometry.computeBoundingBox();
  const { min, max } = geometry.boundingBox;
  out.push({
    triangles: (geometry.index ?? geometry.getAttribute('position')).count / 3,
    min: min.toArray(), max: max.toArray(), normals: geometry.hasAttribute('normal'),
  });
}
console.log(JSON.stringify(out));
