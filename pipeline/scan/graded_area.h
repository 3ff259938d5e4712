// SPDX-License-Identifier: GPL-3.0-or-later
// A bound on the area of triangles that depends on the position, so that triangles are smaller
// where HU change.
#pragma once

#include <vector>

#include "pipeline/contour/contour.h"

namespace trocar::pipeline {

/// The bound at a position is the area of an equilateral triangle. The edge length of this triangle
/// is such that HU change by at most `hu_per_edge` along an edge, according to the gradient of the
/// image (Sobel's, which averages noise over nine pixels). The bound is never below kMinArea_px2. A
/// short edge length at one position also limits the edge lengths around this position: they grow
/// by at most half of the distance from it. So every triangle that is large enough to contain such
/// a position is refined.
class GradedArea {
 public:
  static constexpr double kMinArea_px2 = 1;

  /// Precondition: `hu_per_edge` is positive.
  GradedArea(const Image& hu, const PixelGrid& grid, double hu_per_edge);
  /// The bound at the pixel nearest to p.
  double mm2_at(LatticePoint p) const;
  double min_mm2() const { return min_mm2_; }

 private:
  PixelGrid grid_;
  int width_, height_;
  double min_mm2_;
  std::vector<float> edge_mm_;  // edge length for each pixel
};

}  // namespace trocar::pipeline
