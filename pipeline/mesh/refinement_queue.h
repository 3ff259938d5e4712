// SPDX-License-Identifier: GPL-3.0-or-later
// The triangles to be improved, ordered by their shortest edge in buckets of a quarter of a power
// of two of its square; within a bucket the newest comes first. Tickets of triangles that have been
// replaced since are dropped when they are popped.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <vector>

namespace trocar::pipeline {

class RefinementQueue {
 public:
  /// A reference that goes stale when its triangle is replaced.
  struct Ticket {
    std::uint32_t triangle, generation;
  };

  void clear() {
    for (std::vector<Ticket>& bucket : buckets_)
      bucket.clear();
    first_ = buckets_.size();
  }

  /// shortest2: squared length, from 1 to below 2^64.
  void push(double shortest2, Ticket ticket) {
    // A double's exponent and first two digits: four buckets for each power of two.
    const auto digits = std::bit_cast<std::uint64_t>(shortest2) >> 50;
    const std::size_t k = (digits - (1023U << 2)) & (buckets_.size() - 1);
    buckets_[k].push_back(ticket);
    first_ = std::min(first_, k);
  }

  /// The first that `is_valid(ticket)`, put into `out`; false when there is none.
  template <typename IsValid>
  bool pop(Ticket& out, IsValid is_valid) {
    for (; first_ < buckets_.size(); ++first_) {
      std::vector<Ticket>& bucket = buckets_[first_];
      while (!bucket.empty()) {
        out = bucket.back();
        bucket.pop_back();
        if (is_valid(out)) return true;
      }
    }
    return false;
  }

 private:
  std::array<std::vector<Ticket>, 256> buckets_;
  std::size_t first_ = 256;
};

}  // namespace trocar::pipeline
