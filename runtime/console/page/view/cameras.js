// SPDX-License-Identifier: Apache-2.0
// The three cameras of the view: perspective, along the tool, and the cross-section from above.
import * as THREE from "three";
import { OrbitControls } from "orbit";

export class Cameras {
  /// `on_change` is called when the operator has moved a camera.
  constructor(canvas, on_change) {
    this.perspective = new THREE.PerspectiveCamera(35, 1, 0.002, 5);
    this.along = new THREE.PerspectiveCamera(40, 1, 0.002, 5);
    this.above = new THREE.OrthographicCamera(-1, 1, 1, -1, 0.001, 5);
    this.perspective.up.set(0, 0, 1);
    this.above.up.set(0, 1, 0);
    this.turn = new OrbitControls(this.perspective, canvas);
    this.shift = new OrbitControls(this.above, canvas);
    this.shift.enableRotate = false;
    this.shift.mouseButtons.LEFT = THREE.MOUSE.PAN;
    for (const control of [this.turn, this.shift]) control.addEventListener("change", on_change);
    this.half_x = this.half_y = 0.05;  // half the extent of a cross-section, m
    this.choose("perspective");
  }

  /// Chooses the camera: "perspective", "tool" or "section".
  choose(view) {
    this.turn.enabled = view === "perspective";
    this.shift.enabled = view === "section";
    this.active = { perspective: this.perspective, tool: this.along, section: this.above }[view];
  }

  resize(width, height) {
    for (const camera of [this.perspective, this.along]) {
      camera.aspect = width / height;
      camera.updateProjectionMatrix();
    }
    const half = Math.max(this.half_y, this.half_x * height / width);
    Object.assign(this.above, { top: 1.1 * half, bottom: -0.9 * half, left: -half * width / height, right: half * width / height });
    this.above.updateProjectionMatrix();
    this.turn.update();
    this.shift.update();
  }

  /// Aims at the bone in `box`. The caller then calls resize() and frame_all().
  aim(box) {
    const centre = box.getCenter(new THREE.Vector3()), size = box.getSize(new THREE.Vector3());
    this.turn.target.copy(centre);
    this.shift.target.copy(centre);
    this.above.position.set(centre.x, centre.y, box.max.z + 0.5);
    this.half_y = 0.64 * Math.max(size.y, 0.02);
    this.half_x = 0.64 * Math.max(size.x, 0.02);
    this.above.zoom = 1;
  }

  /// Moves the perspective camera to the front and above, as near as possible so that it shows all of the bone.
  frame_all({ min, max }) {
    const centre = this.turn.target, size = min.distanceTo(max);
    const from = new THREE.Vector3(0.42, -0.78, 0.5).normalize(), corner = new THREE.Vector3();
    let away = 0.6 * size;
    for (let turn = 0; turn < 40; ++turn, away *= 1.06) {
      this.perspective.position.copy(centre).addScaledVector(from, away);
      this.perspective.lookAt(centre);
      this.perspective.updateMatrixWorld();
      let outermost = 0;
      for (let k = 0; k < 8; ++k) {
        corner.set(k & 1 ? max.x : min.x, k & 2 ? max.y : min.y, k & 4 ? max.z : min.z).project(this.perspective);
        outermost = Math.max(outermost, Math.abs(corner.x), Math.abs(corner.y));
      }
      if (outermost < 1.1) break;
    }
    this.turn.update();
  }

  /// Moves the camera along the tool to 100 mm above the tip. `axis` points down the tool; null: straight down.
  follow(tip, axis) {
    const down = axis ? new THREE.Vector3(axis[0], axis[1], axis[2]) : new THREE.Vector3(0, 0, -1);
    const at = new THREE.Vector3(tip[0], tip[1], tip[2]);
    this.along.up.set(0, 1, 0);
    this.along.position.copy(at).addScaledVector(down, -0.1);
    this.along.lookAt(at);
  }

  /// Says whether a drag with the left button or one finger moves the camera. If not, the right button turns it, and two fingers and the
  /// middle button stay as they are.
  set_drag(is_cameras) {
    const { MOUSE, TOUCH } = THREE;
    for (const [control, left] of [[this.turn, MOUSE.ROTATE], [this.shift, MOUSE.PAN]]) {
      control.mouseButtons.LEFT = is_cameras ? left : null;
      control.mouseButtons.RIGHT = is_cameras ? MOUSE.PAN : left;
      control.touches.ONE = is_cameras ? TOUCH.ROTATE : null;
    }
  }

  /// Returns the plane of the screen through `at`: its directions `right` and `up` in {B}, and `m_per_px`, the metres per pixel of a view
  /// of this height.
  plane(at, height_px) {
    const camera = this.active, column = (k) => new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, k).toArray();
    if (camera === this.above) return { right: column(0), up: column(1), m_per_px: 1 / this.section_scale(height_px) };
    const depth_m = new THREE.Vector3(...at).applyMatrix4(camera.matrixWorldInverse).z;
    return { right: column(0), up: column(1), m_per_px: 2 * Math.abs(depth_m) * Math.tan(camera.fov * Math.PI / 360) / height_px };
  }

  /// Returns the pixels per metre of the cross-section.
  section_scale(height) { return height / (this.above.top - this.above.bottom) * this.above.zoom; }
}
