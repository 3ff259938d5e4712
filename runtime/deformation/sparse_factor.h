// SPDX-License-Identifier: Apache-2.0
// Factors the matrix of a network's free nodes as L D L^T (L is lower triangular, D diagonal), so
// that the equations for the displacements can be solved quickly. The method is an up-looking
// factorisation along the elimination tree (Davis, "Algorithm 849", 2005), in the approximate
// minimum degree order that Eigen computes.
//
// Eigen's SimplicialLDLT could replace this class, but its results differ from those of this
// class in the last bits. Recordings with the force law `network` depend on these results, and a
// new version of the program should make the same recordings with the virtual clock as the old
// version. This is why the class is kept. Its speed alone would not justify keeping it: one run of
// `deformation_bench --benchmark_filter='factor|solve|answer'` compared the class with Eigen (medians).
//  - To factor the matrix of 100 to 10,000 nodes, Eigen takes 1.1 to 1.2 times as long as this
//    class. For 40,000 nodes it takes the same time.
//  - To solve the equations, Eigen takes 1.2 to 1.4 times as long.
//  - To compute the response of a sheet to the tool at a new position (response.h), the program
//    with Eigen would take 1.03 times as long.
//  - To calibrate a sheet's stiffness (calibration.h), it would take 1.02 times as long.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "runtime/deformation/network.h"

namespace trocar::runtime {

/// A factorisation. After make() it does not change, so any thread may read it. The unknowns are
/// the displacements of the free nodes, in the order of elimination.
class SparseFactor {
 public:
  SparseFactor() = default;

  /// Factors the rows and columns of the network's matrix that belong to free nodes. `kind`: kind
  /// of each node, network.size() elements. The matrix is positive definite even if springs have
  /// negative stiffness (network.h, law 2). Rounding, or a foundation of stiffness 0, can
  /// nevertheless make a pivot (an element of D) zero or negative. The function then returns false,
  /// and the factor is empty. Otherwise it returns true. Allocates. O(n^1.5) for the n free nodes
  /// of a planar mesh.
  bool make(const Network& network, std::span<const NodeKind> kind);

  std::size_t size() const noexcept { return inverse_pivot_.size(); }
  /// Number of entries of L below the diagonal.
  std::size_t entries() const noexcept { return row_.size(); }

  /// The node of each unknown, as an index in the network.
  std::span<const std::uint32_t> nodes() const noexcept { return node_; }

  /// Solves the equations. `x` has one element for each unknown: the force on its node in N when
  /// the function is called, and the displacement of its node in m when the function returns. Does
  /// not allocate. O(entries()).
  void solve(std::span<double> x) const noexcept;

 private:
  std::vector<std::uint32_t> node_;    ///< node of each unknown
  std::vector<std::uint32_t> first_;   ///< column k of L: elements first_[k] to first_[k + 1] - 1
  std::vector<std::uint32_t> row_;     ///< row of each element of L below the diagonal
  std::vector<double> value_;          ///< value of each element of L below the diagonal
  std::vector<double> inverse_pivot_;  ///< 1 / D for each unknown
};

}  // namespace trocar::runtime
