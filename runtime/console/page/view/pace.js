// SPDX-License-Identifier: Apache-2.0
// Chooses the resolution of the view by its frame rate, so that the view also works without a GPU.

const kMinScale = 0.5, kSlowFrame_ms = 30, kFastFrame_ms = 19, kFramesOfMean = 20, kPause_ms = 500;

export class Pace {
  scale = 1;      ///< pixels drawn per pixel of the screen, along each side
  frames = 0;     ///< number of frames drawn
  frame_ms = 0;   ///< mean time between the last 20 frames
  #times = [];
  #last = null;
  #fast = 0;

  /// Call this when a frame was drawn, at `now` (ms).
  frame(now) {
    ++this.frames;
    if (this.#last !== null && now - this.#last < kPause_ms) this.#times.push(now - this.#last);
    this.#last = now;
    if (this.#times.length < kFramesOfMean) return;
    const mean = this.#times.reduce((a, b) => a + b) / this.#times.length;
    this.#times = [];
    this.frame_ms = mean;
    const before = this.scale;
    if (mean > kSlowFrame_ms) this.scale = Math.max(kMinScale, this.scale * Math.max(0.7, Math.sqrt(kSlowFrame_ms / mean) * 0.95));
    else if (mean < kFastFrame_ms && this.scale < 1 && ++this.#fast >= 5) this.scale = Math.min(1, this.scale * 1.12);
    else return;
    this.#fast = this.scale < before ? -20 : 0;  // after a step down, the next step up is delayed
  }

  /// Returns the time since the last frame, ms.
  since_last(now) { return now - this.#last; }
  /// Call this before a pause, so that the pause does not count as a frame.
  pause() { this.#last = null; }
}
