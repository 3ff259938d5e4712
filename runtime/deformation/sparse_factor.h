// SPDX-License-Identifier: Apache-2.0
// L D L^T of the free nodes' matrix of a network. Up-looking factorisation along the elimination
// tree (Davis, "Algorithm 849", 2005) in the order of approximate minimum degree (Eigen's).
//
// Eigen's SimplicialLDLT takes 1.1 to 1.2 times as long to factor 100 to 10,000 nodes, as long for
// 40,000, and 1.2 to 1.4 times as long to solve. With it a response at a new position would take 1.03
// times as long, a calibration 1.02 times (medians, one run: deformation_bench
// --benchmark_filter=none). That alone would not justify a factorisation of our own. It is kept
// because Eigen's answers differ in the last bits: recordings with the force law `network` contain them,
// and a recording in virtual time is to have the same bytes in every version.
// Tests: tests/runtime/deformation/deformation_springs_test.cpp
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "runtime/deformation/network.h"

namespace trocar::runtime {

/// Immutable once made: any thread may read it. The unknowns are the free nodes, in the order of
/// elimination.
class SparseFactor {
 public:
  SparseFactor() = default;

  /// Factors the matrix of `network` between the free nodes of `kind` (network.size() elements). It
  /// is positive definite for springs of any sign (network.h, law 2). False, with an empty factor,
  /// if rounding or a foundation of zero leads to a pivot that is not positive. Allocates. O(fill), about
  /// n^1.5 for a planar mesh.
  bool make(const Network& network, std::span<const NodeKind> kind);

  std::size_t size() const noexcept { return inverse_pivot_.size(); }
  std::size_t entries() const noexcept {
    return row_.size();
  }  ///< number of entries of L below its diagonal

  /// The node of each unknown.
  std::span<const std::uint32_t> nodes() const noexcept { return node_; }

  /// In: the forces on the unknowns in N; out: their displacements in m. size() elements.
  /// No allocation; O(entries()).
  void solve(std::span<double> x) const noexcept;

 private:
  std::vector<std::uint32_t> node_;   ///< node of each unknown
  std::vector<std::uint32_t> first_;  ///< column k of L: [first_[k], first_[k + 1])
  std::vector<std::uint32_t> row_;
  std::vector<double> value_;
  std::vector<double> inverse_pivot_;
};

}  // namespace trocar::runtime
