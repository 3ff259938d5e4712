// SPDX-License-Identifier: Apache-2.0
// The signed distance of a point to the edge of the material of an uncut slice, and the gradient of
// this distance. Both come from a raster that the haptic thread reads in constant time. Holes cut
// during the session do not change the raster.
//
// Contract (tests/runtime/contact/edge_distance_test.cpp):
//  1. At the nodes of the raster the distance is exact except for rounding. Its magnitude is at
//     most kReach_mm. Between the nodes the distance is interpolated bilinearly, which is exact
//     near a straight edge.
//  2. The distance is positive inside the material and negative outside the material. Outside the
//     raster it is -kReach_mm.
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
  /// Distance between neighbouring nodes. This distance is larger if the raster would otherwise
  /// have more than about kMaxNodes nodes.
  static constexpr double kSpacing_mm = 0.5;
  static constexpr double kMaxNodes = 250'000;
  static constexpr double kReach_mm = 4;

  EdgeDistance() = default;
  /// `outline`: the rings of a slice, with the material on their left. The time is proportional to
  /// the number of nodes of the raster, plus the sum, over all edges of the outline, of the number
  /// of nodes within kReach_mm of the edge's bounding box.
  EdgeDistance(const Pslg& outline, const Lattice& lattice);

  /// A positive distance is nowhere too large by more than this: a distance changes by at most the
  /// length of the way between two points, and no point is farther from the nodes of its cell than
  /// the cell's diagonal.
  double max_error_m() const noexcept { return 1e-3 * 1.4143 * spacing_mm_; }

  struct Sample {
    double distance_m = -1e-3 * kReach_mm;
    Eigen::Vector2d gradient = Eigen::Vector2d::Zero();  ///< in {B}
  };
  /// Returns the distance and its gradient at a point of {B}. No allocation.
  Sample at(const PlanarTransform& transform, const Eigen::Vector2d& at_m) const noexcept;

 private:
  double left_mm_ = 0, bottom_mm_ = 0, spacing_mm_ = kSpacing_mm;
  int columns_ = 0, rows_ = 0;
  std::vector<float> distance_mm_;  ///< distance at each node, row by row
};

}  // namespace trocar::runtime
