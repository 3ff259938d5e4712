// SPDX-License-Identifier: Apache-2.0
// The signed distance of a point to the edge of the material of an uncut slice, and the gradient of this
// distance. Both come from a raster that the haptic thread reads in constant time. Holes cut during the session
// do not change them.
//
// Contract (tests/runtime/contact/edge_distance_test.cpp):
//  1. At the nodes of the raster the distance is exact except for rounding. Its magnitude is limited to kReach_mm.
//     Between the nodes it is interpolated bilinearly, which is exact near a straight edge.
//  2. The distance is positive inside the material and negative outside it. Outside of the raster it is -kReach_mm.
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
  /// Distance between neighbouring nodes. It is larger if the raster would otherwise have more than kMaxNodes nodes.
  static constexpr double kSpacing_mm = 0.5;
  static constexpr double kMaxNodes = 250'000;
  static constexpr double kReach_mm = 4;

  EdgeDistance() = default;
  /// `outline`: the rings of a slice, with the material on their left. The time is the sum of two parts: one is
  /// proportional, for each edge, to the number of nodes within kReach_mm of it, and one to the number of all nodes.
  EdgeDistance(const Pslg& outline, const Lattice& lattice);

  struct Sample {
    double distance_m = -1e-3 * kReach_mm;
    Eigen::Vector2d gradient = Eigen::Vector2d::Zero();  ///< in {B}
  };
  /// Returns the distance and its gradient at a point of {B}. No allocation.
  Sample at(const PlanarTransform& transform, const Eigen::Vector2d& at_m) const noexcept;

 private:
  double left_mm_ = 0, bottom_mm_ = 0, spacing_mm_ = kSpacing_mm;
  int columns_ = 0, rows_ = 0;
  std::vector<float> distance_mm_;  ///< row by row
};

}  // namespace trocar::runtime
