// SPDX-License-Identifier: Apache-2.0
// A scene's goals in the view: target, planned line, and the zones in which the tip must not be.
import * as THREE from "three";

const point = ([x, y, z]) => new THREE.Vector3(x, y, z);

function zone_geometry({ capsule, box, prism }) {
  if (capsule) {
    const from = point(capsule.from_m), along = point(capsule.to_m).sub(from);
    const made = new THREE.CapsuleGeometry(capsule.radius_m, along.length(), 8, 16).translate(0, along.length() / 2, 0);
    made.applyQuaternion(new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.clone().normalize()));
    return made.translate(from.x, from.y, from.z);
  }
  if (box) {
    const size = point(box.max_m).sub(point(box.min_m)), middle = point(box.min_m).addScaledVector(size, 0.5);
    return new THREE.BoxGeometry(size.x, size.y, size.z).translate(middle.x, middle.y, middle.z);
  }
  const shape = new THREE.Shape(prism.outline_m.map(([x, y]) => new THREE.Vector2(x, y)));
  return new THREE.ExtrudeGeometry(shape, { depth: prism.z_m[1] - prism.z_m[0], bevelEnabled: false }).translate(0, 0, prism.z_m[0]);
}

/// Returns a group with all goals (see the scene's schema). They are translucent with edges, so that they differ by more than colour.
export function make_goals({ target, line, zones = [] }, good, bad) {
  const group = new THREE.Group();
  const add = (geometry, color) => {
    const solid = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ color, transparent: true, opacity: 0.25, depthWrite: false }));
    const edges = new THREE.LineSegments(new THREE.EdgesGeometry(geometry, 25), new THREE.LineBasicMaterial({ color }));
    solid.renderOrder = edges.renderOrder = 70;
    group.add(solid, edges);
  };
  for (const zone of zones) add(zone_geometry(zone), bad);
  if (target) add(new THREE.SphereGeometry(target.radius_m, 12, 8).translate(...target.at_m), good);
  if (!line) return group;
  const from = point(line.entry_m);
  const end = line.to_m ?? (line.direction ? from.clone().addScaledVector(point(line.direction).normalize(), 0.05).toArray() : target?.at_m);
  if (!end) return group;
  const dashes = new THREE.Line(new THREE.BufferGeometry().setFromPoints([from, point(end)]), new THREE.LineDashedMaterial({ color: good, dashSize: 0.003, gapSize: 0.0015, depthTest: false, transparent: true }));
  dashes.computeLineDistances();
  dashes.renderOrder = 80;
  group.add(dashes);
  return group;
}
