// SPDX-License-Identifier: Apache-2.0
// The distance to the edge of the material of an uncut slice, with its gradient, on a raster that the haptic thread
// reads in constant time. Cuts do not change it.
//
// Contract (tests/runtime/contact/edge_distance_test.cpp):
//  1. At the nodes of the raster the distance is exact, apart from rounding, and limited to kReach_mm. Between the
//     nodes it is bilinear, so it is exact beside a straight edge.
//  2. It is positive in the material and negative beside it. Outside of the raster it is -kReach_mm.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "formats/geometry/lattice.h"
#include "formats/geometry/slice_mesh.h"
#include "runtime/contact/tool.h"

namespace trocar::runtime {

class EdgeDistance {
 public:
  /// Distance of the nodes; larger if the raster would otherwise have more than kMaxNodes.
  static constexpr double kSpacing_mm = 0.5;
  static constexpr double kMaxNodes = 250'000;
  static constexpr double kReach_mm = 4;

  EdgeDistance() = default;
  /// `outline`: the rings of a slice, with the material on their left. Time proportional to the number of edges times
  /// the nodes within kReach_mm of one, plus the number of nodes.
  EdgeDistance(const Pslg& outline, const Lattice& lattice);

  struct Sample {
    double distance_m = -1e-3 * kReach_mm;
    Eigen::Vector2d gradient = Eigen::Vector2d::Zero();  ///< in {B}
  };
  /// At a point of {B}. No allocation.
  Sample at(const PlanarTransform& transform, const Eigen::Vector2d& at_m) const noexcept;

 private:
  double left_mm_ = 0, bottom_mm_ = 0, spacing_mm_ = kSpacing_mm;
  int columns_ = 0, rows_ = 0;
  std::vector<float> distance_mm_;  ///< row by row
};

}  // namespace trocar::runtime
