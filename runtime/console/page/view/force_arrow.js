// SPDX-License-Identifier: Apache-2.0
// The arrow of the force on the hand, which ends at the tip of the tool.
import * as THREE from "three";

const kMinForce_N = 0.3, kLength_m_per_N = 0.0008, kMinLength_m = 0.008;

export class ForceArrow {
  constructor(scene, material) {
    const head = new THREE.ConeGeometry(0.0028, 0.007, 16).translate(0, -0.0035, 0);
    this.shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.001, 0.001, 1, 10).translate(0, -0.5, 0), material);
    this.group = new THREE.Group();
    this.group.add(new THREE.Mesh(head, material), this.shaft);
    for (const part of this.group.children) part.renderOrder = 90;
    this.tail = new THREE.Vector3();
    scene.add(this.group);
  }
  get visible() { return this.group.visible; }

  /// Updates the arrow. `force` and `tip` are arrays of three numbers, or null.
  update(force, tip, is_allowed) {
    const N = force ? Math.hypot(force[0], force[1], force[2]) : 0;
    this.group.visible = Boolean(tip) && N > kMinForce_N && is_allowed;
    if (!this.visible) return;
    const direction = new THREE.Vector3(force[0], force[1], force[2]).divideScalar(N);
    this.group.position.set(tip[0], tip[1], tip[2]);
    this.group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), direction);
    this.shaft.scale.y = Math.max(kMinLength_m, N * kLength_m_per_N);
    this.tail.copy(this.group.position).addScaledVector(direction, -this.shaft.scale.y);
  }
}
