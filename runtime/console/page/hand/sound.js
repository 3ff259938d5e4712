// SPDX-License-Identifier: Apache-2.0
// The sounds of the hand, made of noise: a tap at contact, a crunch while the tool cuts, a thump at the break.

const kNoise_s = 1;

export class HandSound {
  #context = null;
  #noise = null;

  /// Call this in each click or key: browsers allow sound only after a gesture. It takes long only once, and on a busy machine.
  wake() {
    if (typeof AudioContext === "undefined") return;
    if (!this.#context) {
      this.#context = new AudioContext();
      this.#noise = this.#context.createBuffer(1, kNoise_s * this.#context.sampleRate, this.#context.sampleRate);
      const samples = this.#noise.getChannelData(0);
      for (let i = 0; i < samples.length; ++i) samples[i] = 2 * Math.random() - 1;
    }
    if (this.#context.state !== "running") this.#context.resume().catch(() => {});
  }

  /// Plays what is felt (Feel.take).
  play({ contact, crunch, breach }) {
    if (this.#context?.state !== "running") return;
    if (contact) this.#burst({ frequency_Hz: 700, quality: 1.5, gain: 0.35 * contact, length_s: 0.05 });
    if (crunch) this.#burst({ frequency_Hz: 1400 + 900 * Math.random(), quality: 2, gain: 0.25 * crunch, length_s: 0.03 });
    if (!breach) return;
    this.#burst({ frequency_Hz: 180, quality: 1, gain: 0.9 * breach, length_s: 0.12 });
    this.#burst({ frequency_Hz: 2500, quality: 1, gain: 0.4 * breach, length_s: 0.02 });
  }

  #burst({ frequency_Hz, quality, gain, length_s }) {
    const context = this.#context, source = context.createBufferSource(), filter = context.createBiquadFilter(), level = context.createGain();
    source.buffer = this.#noise;
    filter.type = "bandpass";
    filter.frequency.value = frequency_Hz;
    filter.Q.value = quality;
    level.gain.setValueAtTime(Math.max(1e-3, gain), context.currentTime);
    level.gain.exponentialRampToValueAtTime(1e-3, context.currentTime + length_s);
    source.connect(filter).connect(level).connect(context.destination);
    source.start(0, Math.random() * (kNoise_s - length_s), length_s);
  }
}
