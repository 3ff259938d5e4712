// SPDX-License-Identifier: GPL-3.0-or-later
// A priority queue of the triangles that refinement has to improve. Triangles with the shortest
// edges come first, in approximate order: they are sorted into buckets by the squared length of
// their shortest edge. From each power of two to the next there are four buckets of equal width.
// Within a bucket the newest triangle comes first. If a triangle is replaced, its entry stays in
// the queue until pop() drops it.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <vector>

namespace trocar::pipeline {

class RefinementQueue {
 public:
  /// A triangle, and the generation that it had when the entry was made. When the triangle is
  /// replaced, its generation changes (WorkingTriangle::generation), and the entry becomes stale.
  struct Entry {
    std::uint32_t triangle, generation;
  };

  void clear() {
    for (std::vector<Entry>& bucket : buckets_)
      bucket.clear();
    used_ = {};
  }

  /// Adds an entry. `shortest2` is the squared length of the shortest edge, from 1 to below 2^64.
  void push(double shortest2, Entry entry) {
    // The bucket follows from the exponent of the double and the first two bits of its mantissa, so
    // there are four buckets for each power of two.
    const auto digits = std::bit_cast<std::uint64_t>(shortest2) >> 50;
    const std::size_t k = (digits - (1023U << 2)) & (buckets_.size() - 1);
    buckets_[k].push_back(entry);
    used_[k / 64] |= std::uint64_t{1} << (k % 64);
  }

  /// Removes the first entry for which is_valid() holds and puts it into `out`. Drops the entries
  /// before it. Returns false if there is no such entry.
  template <typename IsValid>
  bool pop(Entry& out, IsValid is_valid) {
    for (std::size_t word = 0; word < used_.size(); ++word) {
      for (; used_[word] != 0; used_[word] &= used_[word] - 1) {
        std::vector<Entry>& bucket =
            buckets_[64 * word + static_cast<std::size_t>(std::countr_zero(used_[word]))];
        while (!bucket.empty()) {
          out = bucket.back();
          bucket.pop_back();
          if (is_valid(out)) return true;
        }
      }
    }
    return false;
  }

 private:
  std::array<std::vector<Entry>, 256> buckets_;
  std::array<std::uint64_t, 4> used_{};  // one bit for each bucket that may have entries
};

}  // namespace trocar::pipeline
