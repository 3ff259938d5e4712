// SPDX-License-Identifier: Apache-2.0
// Disjoint sets of the numbers 0 to size - 1 (union-find with path halving; Tarjan and van Leeuwen
// 1984).
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

namespace trocar {

class DisjointSets {
 public:
  /// At first each number is a set of its own. `size` must be below 2^32.
  explicit DisjointSets(std::size_t size = 0) : parent_(size) {
    std::iota(parent_.begin(), parent_.end(), std::uint32_t{0});
  }

  std::size_t size() const noexcept { return parent_.size(); }

  /// Returns the root of the set that contains i: one number of the set, which stands for the set.
  /// The root is the smallest number in the set, unless put_under() was used.
  std::uint32_t root(std::uint32_t i) noexcept {
    while (parent_[i] != i)
      i = parent_[i] = parent_[parent_[i]];
    return i;
  }

  /// Merges the sets that contain a and b. Returns false if they were already one set.
  bool join(std::uint32_t a, std::uint32_t b) noexcept {
    a = root(a);
    b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
    return a != b;
  }

  /// Merges the sets whose roots are `root` and `other`. `root` is the root of the merged set.
  void put_under(std::uint32_t root, std::uint32_t other) noexcept { parent_[other] = root; }

 private:
  std::vector<std::uint32_t> parent_;
};

}  // namespace trocar
