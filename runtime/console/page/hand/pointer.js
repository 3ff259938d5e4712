// SPDX-License-Identifier: Apache-2.0
// The pointer that moves the needle: a drag with the mouse, a pen or one finger in the camera's plane, and the wheel along the tool. Two
// fingers and the other mouse buttons stay with the camera.
import { kFine, sum, wheel_m } from "./motion.js";

export class HandPointer {
  #drag = null;              // {id, x, y} of the pointer that moves the needle
  #touches = new Set();

  /// `hand` has is_held, target, axis() and move(by). `cameras`: Cameras of the view.
  constructor(canvas, cameras, hand) {
    canvas.addEventListener("pointerdown", (event) => {
      const is_touch = event.pointerType === "touch";
      if (is_touch) this.#touches.add(event.pointerId);
      // After a second finger nothing moves the needle until all fingers are up: they do not leave the screen at the same time.
      if (this.#touches.size > 1) this.#drag = null;
      else if (hand.is_held && event.button === 0) {
        this.#drag = { id: event.pointerId, x: event.clientX, y: event.clientY };
        canvas.setPointerCapture(event.pointerId);
      }
    });
    canvas.addEventListener("pointermove", (event) => {
      if (event.pointerId !== this.#drag?.id || !hand.is_held) return;
      const { right, up, m_per_px } = cameras.plane(hand.target, canvas.clientHeight);
      const m = m_per_px * (event.shiftKey ? kFine : 1);
      hand.move(sum([[m * (event.clientX - this.#drag.x), right], [m * (this.#drag.y - event.clientY), up]]));
      Object.assign(this.#drag, { x: event.clientX, y: event.clientY });
    });
    const end = (event) => {
      this.#touches.delete(event.pointerId);
      if (event.pointerId === this.#drag?.id) this.#drag = null;
    };
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, end);
    // In the capture phase, because the camera's controls listen too. Ctrl and wheel is the trackpad's pinch: two fingers.
    canvas.addEventListener("wheel", (event) => {
      if (!hand.is_held || event.ctrlKey) return;
      event.preventDefault();
      event.stopImmediatePropagation();
      hand.move(sum([[wheel_m(event), hand.axis()]]));
    }, { capture: true, passive: false });
  }

  release() { this.#drag = null; }
}
