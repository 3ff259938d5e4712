// SPDX-License-Identifier: Apache-2.0
// Where a slice had material before any cut, and its HU there: a raster that the haptic thread
// reads in constant time. Cuts do not change it.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "formats/geometry/lattice.h"
#include "formats/geometry/slice_mesh.h"
#include "runtime/contact/tool.h"

namespace trocar::runtime {

/// Contract (tests/runtime/contact/slice_field_test.cpp):
///  1. A pixel has material if its middle lies in a triangle, with the HU interpolated linearly
///     between its corners; without HU it is 0.
///  2. Pixels are of kPixel_mm, larger only where the slice would have more than kMostPixels.
class SliceField {
 public:
  static constexpr double kPixel_mm = 0.25;
  static constexpr std::size_t kMostPixels = 400'000;

  SliceField() = default;
  /// `mesh` must be valid; `hu` has a value for each of its vertices, or is empty.
  SliceField(const SliceMesh& mesh, std::span<const float> hu, const Lattice& lattice);

  bool has_hu() const noexcept { return has_hu_; }
  double mean_hu() const noexcept { return mean_hu_; }    ///< over all material
  double dense_hu() const noexcept { return dense_hu_; }  ///< 90 % of it is below: the cortex's
  std::size_t bytes() const noexcept { return hu_.capacity() * sizeof(float); }

  struct Mean {
    double share = 0;  ///< of a disc's points over material
    double hu = 0;     ///< their mean; 0 without material
  };
  /// Over a disc in {B}: 19 points of equal weight. No allocation.
  Mean mean(const PlanarTransform& transform, const Eigen::Vector2d& at_m,
            double radius_m) const noexcept;

 private:
  float at(double x_mm, double y_mm) const noexcept;

  double left_mm_ = 0, bottom_mm_ = 0, pixel_mm_ = kPixel_mm;
  int columns_ = 0, rows_ = 0;
  bool has_hu_ = false;
  double mean_hu_ = 0, dense_hu_ = 0;
  std::vector<float> hu_;  // nan: no material
};

}  // namespace trocar::runtime
