// SPDX-License-Identifier: Apache-2.0
// The signed distance of a point to the edge of the material of an uncut slice, and the gradient of
// this distance. Both come from a raster that the haptic thread reads in constant time. Holes cut
// during the session do not change the raster.
//
// Contract (tests/runtime/contact/edge_distance_test.cpp):
//  1. At the nodes of the raster the distance is exact except for rounding. Distances are limited
//     to the range from -kReach_mm to kReach_mm. Between the nodes the distance is interpolated
//     bilinearly, which is exact near a straight edge.
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
  /// Distance between neighbouring nodes. If a raster with this distance would have more than about
  /// kMaxNodes nodes, the distance is larger.
  static constexpr double kSpacing_mm = 0.5;
  static constexpr double kMaxNodes = 250'000;
  static constexpr double kReach_mm = 4;

  EdgeDistance() = default;
  /// `outline`: the rings of a slice, with the material on their left. The constructor visits every
  /// node of the raster. For each edge of the outline, it also visits every node within kReach_mm
  /// of the edge's bounding box.
  EdgeDistance(const Pslg& outline, const Lattice& lattice);

  /// Bound on the amount by which at() can overstate a positive distance: the diagonal of a raster
  /// cell. (at() takes a mean of the distances at the four nodes of the point's cell. Each of these
  /// exceeds the true distance at the point by at most the length from the node to the point.)
  double max_error_m() const noexcept { return 1e-3 * 1.4143 * spacing_mm_; }

  struct Sample {
    double distance_m = -1e-3 * kReach_mm;
    Eigen::Vector2d gradient = Eigen::Vector2d::Zero();  ///< gradient of the distance, in {B}
  };
  /// Returns the distance and its gradient at the point with the coordinates x and y in {B}, the
  /// frame of the device (ARCHITECTURE.md). `transform` maps between {B} and the slice plane. No
  /// allocation.
  Sample at(const PlanarTransform& transform, const Eigen::Vector2d& at_m) const noexcept;

 private:
  double left_mm_ = 0, bottom_mm_ = 0, spacing_mm_ = kSpacing_mm;
  int columns_ = 0, rows_ = 0;
  std::vector<float> distance_mm_;  ///< distance at each node, row by row
};

}  // namespace trocar::runtime
