// SPDX-License-Identifier: Apache-2.0
// The X-ray pictures that the page has, by position of the C-arm, and which one is computed next. Runs in node for tests, too.

const kCoarse = 160, kCoarseStep = 2, kFineStep = 0.8, kKept = 5;

export class XrayPictures {
  #pictures = new Map();  // by key of the position, the latest last

  get count() { return this.#pictures.size; }
  get(key) { return this.#pictures.get(key); }
  has(key) { return this.#pictures.has(key); }
  /// `size`: pixels of a fine picture. A coarse one is shown until it is there.
  is_fine(key, size) { return this.#pictures.get(key)?.size >= size; }
  clear() { this.#pictures.clear(); }

  /// Keeps a picture, unless a finer one is there. Of too many pictures the oldest go, but none of the positions `wanted`, which are fewer
  /// than kKept.
  put(key, picture, wanted) {
    if (this.is_fine(key, picture.size)) return;
    this.#pictures.delete(key);
    this.#pictures.set(key, picture);
    for (const old of this.#pictures.keys()) {
      if (this.count <= kKept) break;
      if (!wanted.some((place) => place.key === old)) this.#pictures.delete(old);
    }
  }

  /// What is computed next: a coarse picture, which is there at once, of each position in turn, then the fine ones. `wanted`: positions
  /// {key, view}, the most important first. What nobody wants any more is not computed. Null: all are fine.
  next(wanted, size) {
    const place = wanted.find(({ key }) => !this.has(key)) ?? wanted.find(({ key }) => !this.is_fine(key, size));
    if (!place) return null;
    const { key, view } = place;
    return this.has(key) ? { key, view, size, step: kFineStep } : { key, view, size: kCoarse, step: kCoarseStep };
  }
}
