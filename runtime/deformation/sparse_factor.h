// SPDX-License-Identifier: Apache-2.0
// L D L^T of the free nodes' matrix of a network, made by a worker, solved with on the haptic
// thread. Up-looking factorisation along the elimination tree (Davis, "Algorithm 849", 2005) in the
// order of approximate minimum degree (Eigen's).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "runtime/deformation/network.h"

namespace trocar::runtime {

/// Immutable once made; may be read by any thread. The unknowns are the free nodes, in the order
/// of elimination.
class SparseFactor {
 public:
  SparseFactor() = default;

  /// Factors the matrix of `network` between the free nodes of `kind` (as many as nodes). It is
  /// positive definite whatever the springs' signs (network.h, law 2); false if rounding or beds
  /// of zero made a pivot that is not positive, and then the factor is empty. Allocates. O(fill),
  /// about n^1.5 for a planar mesh.
  bool make(const Network& network, std::span<const NodeKind> kind);

  std::size_t size() const noexcept { return inverse_pivot_.size(); }
  std::size_t entries() const noexcept { return row_.size(); }  ///< below L's diagonal

  /// The node of each unknown.
  std::span<const std::uint32_t> nodes() const noexcept { return node_; }

  /// In: the forces on the unknowns in N; out: their displacements in m. size() elements.
  /// No allocation; O(entries()).
  void solve(std::span<double> x) const noexcept;

 private:
  std::vector<std::uint32_t> node_;   ///< of each unknown
  std::vector<std::uint32_t> first_;  ///< column k of L: [first_[k], first_[k + 1])
  std::vector<std::uint32_t> row_;
  std::vector<double> value_;
  std::vector<double> inverse_pivot_;
};

}  // namespace trocar::runtime
