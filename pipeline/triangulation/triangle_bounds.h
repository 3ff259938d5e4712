// SPDX-License-Identifier: GPL-3.0-or-later
// Decides whether a triangle is within the bounds on angle and area that refinement must meet.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>

#include "formats/geometry/triangle_shape.h"
#include "pipeline/triangulation/cavity_boundary.h"
#include "pipeline/triangulation/refinement.h"

namespace trocar::pipeline {

/// The bounds on angle and area that refinement must meet. All areas are doubled and in steps^2,
/// because twice the area of a triangle on the lattice is an integer.
class TriangleBounds {
 public:
  /// `options` must outlive this object.
  TriangleBounds(const Lattice& lattice, const RefinementOptions& options)
      : area_mm2_at_(options.area_mm2_at), has_area_at_(options.area_mm2_at != nullptr) {
    const double sine = std::sin(options.min_angle_deg * std::numbers::pi / 180);
    const double step2 = lattice.step_mm() * lattice.step_mm();
    doubled_per_mm2_ = 2 / step2;
    everywhere_ = {sine * sine, 2 * options.max_area_mm2 / step2};
    least_doubled_area_ = options.min_area_mm2 * doubled_per_mm2_;
  }

  /// Returns true if the bound on the area depends on the position.
  bool has_area_at() const { return has_area_at_; }
  /// The bounds on angle and area, without the bound that depends on the position.
  const ShapeLimits& everywhere() const { return everywhere_; }
  /// Limits that suffice at every position: a triangle within these limits is within the
  /// bounds, wherever it lies. (Where the bound on the area is larger, larger triangles are
  /// within the bounds too.)
  QuickShapeLimits anywhere() const {
    return {everywhere_.sine2, has_area_at_
                                   ? std::min(least_doubled_area_, everywhere_.doubled_area)
                                   : everywhere_.doubled_area};
  }
  /// The bound on the doubled area of a triangle, evaluated at its centroid.
  double largest_doubled_area(LatticePoint a, LatticePoint b, LatticePoint c) const {
    if (!has_area_at_) return everywhere_.doubled_area;
    const auto third = [](std::int64_t sum) { return static_cast<std::int32_t>(sum / 3); };
    const LatticePoint centroid{third(std::int64_t{a.x} + b.x + c.x),
                                third(std::int64_t{a.y} + b.y + c.y)};
    return std::min(everywhere_.doubled_area,
                    std::max(least_doubled_area_, area_mm2_at_(centroid) * doubled_per_mm2_));
  }
  /// The shape of the triangle abc. The members is_sharp and is_large say whether the triangle
  /// violates the bounds.
  TriangleShape shape(LatticePoint a, LatticePoint b, LatticePoint c) const {
    TriangleShape out = shape_of(a, b, c, everywhere_);
    if (has_area_at_ && static_cast<double>(out.doubled_area) > least_doubled_area_)
      out.is_large = static_cast<double>(out.doubled_area) > largest_doubled_area(a, b, c);
    return out;
  }

 private:
  const std::function<double(LatticePoint)>& area_mm2_at_;
  bool has_area_at_;
  double doubled_per_mm2_ = 0, least_doubled_area_ = 0;
  ShapeLimits everywhere_{};
};

}  // namespace trocar::pipeline
