// SPDX-License-Identifier: Apache-2.0
// The tool in the view: its solid, the solid of a second recording's tool, and its outline.
import * as THREE from "three";

const kLength_m = 0.12;
const kStub = 0.1;  // fraction of the shaft that is drawn when the camera looks along it

const shape_of = (outline) => new THREE.Shape(outline.map(([x, y]) => new THREE.Vector2(x, y)));

function solid_of(outline, kind, half_angle_deg) {
  const prism = new THREE.ExtrudeGeometry(shape_of(outline), { depth: kLength_m, bevelEnabled: false });
  if (!kind || kind === "flat" || !(half_angle_deg > 0)) return prism;
  // The lower end becomes a point. The shaft begins where a cone of that angle has the tool's width.
  const at = prism.getAttribute("position"), radius = Math.max(...outline.map(([x, y]) => Math.hypot(x, y)));
  const length = radius / Math.tan(half_angle_deg * Math.PI / 180);
  const low = new THREE.ExtrudeGeometry(shape_of(outline), { depth: length, bevelEnabled: false }).getAttribute("position");
  for (let i = 0; i < low.count; ++i) if (low.getZ(i) < length / 2) low.setXYZ(i, 0, 0, 0);
  for (let i = 0; i < at.count; ++i) if (at.getZ(i) < kLength_m / 2) at.setZ(i, length);
  prism.setAttribute("position", new THREE.BufferAttribute(new Float32Array([...at.array, ...low.array]), 3));
  prism.deleteAttribute("uv");
  prism.clearGroups();
  prism.computeVertexNormals();
  return prism;
}

export class ToolModel {
  /// `tool`: the object of /api/bone. `materials`: {tool, ghost, outline}.
  constructor(tool, scene, materials) {
    this.outline = tool.outline_m;
    this.axis_in_plate = tool.axis_in_plate;
    const solid = solid_of(this.outline, tool.kind, tool.half_angle_deg);
    this.solid = new THREE.Mesh(solid, materials.tool);
    this.ghost = new THREE.Mesh(solid.clone(), materials.ghost);
    this.ring = new THREE.LineLoop(new THREE.BufferGeometry().setFromPoints(this.outline.map(([x, y]) => new THREE.Vector3(x, y, 0))), materials.outline);
    [this.solid.renderOrder, this.ghost.renderOrder, this.ring.renderOrder] = [50, 55, 95];
    this.solid.visible = this.ghost.visible = false;
    this.parts = [this.solid, this.ghost, this.ring];
    scene.add(...this.parts);
  }

  /// Returns the outline as a flat shape.
  disc() { return new THREE.ShapeGeometry(shape_of(this.outline)); }

  /// Moves the tools to the rows of `shown` and of the recording with which it is compared. `view`: the view of View3d. `z_m`: height
  /// of the slice that a cross-section shows.
  update(shown, view, z_m) {
    this.#pose(this.solid, shown);
    this.ghost.visible = false;
    if (shown.second?.row) this.#pose(this.ghost, shown.second);
    const tip = shown.values("tool_m"), is_section = view === "section";
    this.ring.visible = is_section && Boolean(tip);
    if (is_section) this.solid.visible = false;
    for (const solid of [this.solid, this.ghost]) solid.scale.z = view === "tool" ? kStub : 1;
    if (!tip || z_m === undefined) return;
    this.ring.position.set(tip[0], tip[1], is_section ? z_m + 1e-3 : tip[2]);
    this.ring.quaternion.copy(this.solid.quaternion);
  }

  #pose(solid, shown) {
    const tip = shown.values("tool_m"), axis = shown.values("axis"), q = shown.values("q");
    solid.visible = Boolean(tip);
    if (!tip) return;
    solid.position.set(tip[0], tip[1], tip[2]);
    const turn = q ? new THREE.Quaternion(q[1], q[2], q[3], q[0]) : new THREE.Quaternion();
    if (axis) {  // the tool's own axis is used, because the tool may be tilted on the plate
      const up = new THREE.Vector3(-axis[0], -axis[1], -axis[2]).normalize();
      const x = new THREE.Vector3(1, 0, 0).applyQuaternion(turn);
      x.addScaledVector(up, -x.dot(up)).normalize();
      turn.setFromRotationMatrix(new THREE.Matrix4().makeBasis(x, new THREE.Vector3().crossVectors(up, x), up));
    } else if (this.axis_in_plate) {
      turn.multiply(new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 0, 1), new THREE.Vector3(...this.axis_in_plate).normalize()));
    }
    solid.quaternion.copy(turn);
  }
}
