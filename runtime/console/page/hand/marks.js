// SPDX-License-Identifier: Apache-2.0
// The hand in the view: a dot where it pulls the tip to, and a line from the tip to the dot. Both turn from blue to orange with the force.
import * as THREE from "three";

const kDot_m = 0.0012, kRim = 1.35, kLine_m = 0.0004;  // the rim is a factor of the dot's radius
const kSmallestDot_px = 5;
const kUp = new THREE.Vector3(0, 1, 0);  // direction of a cylinder in three.js

export class HandMarks {
  #from = new THREE.Color();
  #to = new THREE.Color();
  #material = new THREE.MeshBasicMaterial({ depthTest: false, transparent: true });  // seen through the bone
  #rim_material = new THREE.MeshBasicMaterial({ depthTest: false, transparent: true });

  constructor(scene) {
    this.dot = new THREE.Mesh(new THREE.SphereGeometry(kDot_m, 16, 12), this.#material);
    this.rim = new THREE.Mesh(new THREE.SphereGeometry(kRim * kDot_m, 16, 12), this.#rim_material);
    // A cylinder, because WebGL draws lines one pixel wide.
    this.line = new THREE.Mesh(new THREE.CylinderGeometry(kLine_m, kLine_m, 1, 8).translate(0, 0.5, 0), this.#material);
    [this.line.renderOrder, this.rim.renderOrder, this.dot.renderOrder] = [96, 97, 98];
    this.group = new THREE.Group();
    this.group.add(this.line, this.rim, this.dot);
    this.group.visible = false;
    scene.add(this.group);
  }

  /// The colours of no force and of full force, and that of the dot's rim.
  set_colours(none, full, rim) {
    this.#from.set(none);
    this.#to.set(full);
    this.#rim_material.color.set(rim);
  }

  hide() { this.group.visible = false; }

  /// `share`: the force as a fraction of the scale's largest. `m_per_px`: metres per pixel at the target.
  show(tip, target, share, m_per_px) {
    this.group.visible = true;
    for (const part of [this.dot, this.rim]) {
      part.position.set(...target);
      part.scale.setScalar(Math.max(1, kSmallestDot_px * m_per_px / kDot_m));
    }
    this.line.position.set(...tip);
    const way = this.dot.position.clone().sub(this.line.position), length = way.length();
    this.line.visible = length > kDot_m;
    if (this.line.visible) this.line.quaternion.setFromUnitVectors(kUp, way.divideScalar(length));
    this.line.scale.y = length;
    this.#material.color.lerpColors(this.#from, this.#to, share);
  }
}
