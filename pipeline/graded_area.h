// SPDX-License-Identifier: GPL-3.0-or-later
// Smaller triangles where HU change: a bound on the area as a function of the place.
#pragma once

#include <vector>

#include "pipeline/contour/contour.h"

namespace trocar::pipeline {

/// At each place the area of an equilateral triangle along whose edges HU change by the wanted
/// number at most, by the gradient of the image (Sobel's, which averages noise over nine pixels);
/// never less than kLeastArea_px2. The edge grows by at most half the distance from a place that
/// wants a shorter one, so that no triangle that is large enough to contain such a place is missed.
class GradedArea {
 public:
  static constexpr double kLeastArea_px2 = 1;

  /// `hu_per_edge` > 0.
  GradedArea(const Image& hu, const PixelGrid& grid, double hu_per_edge);
  /// Of the nearest pixel.
  double mm2_at(LatticePoint p) const;
  double least_mm2() const { return least_mm2_; }

 private:
  PixelGrid grid_;
  int width_, height_;
  double least_mm2_;
  std::vector<float> edge_mm_;  // by pixel
};

}  // namespace trocar::pipeline
