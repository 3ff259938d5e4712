// SPDX-License-Identifier: Apache-2.0
// What the operator would feel, from one snapshot to the next: contact, crunch of what is cut, and the break-through. Snapshots are only
// 60 a second, so everything faster than that is found by differences of counters. A break-through is the loop's event and nothing else
// (runtime/haptics/loop/break_through.h).

const kContact_N = 1, kFree_N = 0.4;          // the contact begins above the first and is over below the second
const kLoudCut_W = 0.5;                       // power of cutting at which the crunch is loudest

export class Feel {
  #last = null;
  #peak_N = 0;
  #is_in_contact = false;

  /// Forgets the earlier snapshot. Call this when the needle is taken, so that nothing from before is played.
  reset() {
    this.#last = null;
    this.#peak_N = 0;
  }

  /// `now`: {t_s, force_N, cut_J, break_throughs}. `scale_N` is the force at which everything is loudest. Returns {contact, crunch, breach}, each 0 (nothing) to 1.
  take(now, scale_N) {
    const before = this.#last ?? now, share = Math.min(1, now.force_N / scale_N);
    const passed_s = now.t_s - before.t_s;
    this.#last = now;
    if (passed_s < 0) this.reset();  // another session
    const felt = { contact: 0, crunch: 0, breach: 0 };
    if (!this.#is_in_contact && now.force_N > kContact_N) {
      this.#is_in_contact = true;
      felt.contact = Math.min(1, 0.3 + share);
    } else if (now.force_N < kFree_N) {
      this.#is_in_contact = false;
    }
    if (!(passed_s > 0)) return felt;
    const power_W = (now.cut_J - before.cut_J) / passed_s;
    if (power_W > 0) felt.crunch = Math.min(1, Math.sqrt(power_W / kLoudCut_W));  // loudness is heard by its root
    if (now.break_throughs > before.break_throughs) {
      felt.breach = Math.min(1, 0.3 + Math.max(this.#peak_N, before.force_N) / scale_N);
      this.#peak_N = now.force_N;
    }
    this.#peak_N = Math.max(this.#peak_N * Math.exp(-2 * passed_s), now.force_N);
    return felt;
  }
}
