// SPDX-License-Identifier: GPL-3.0-or-later
// A bound on the area of triangles for each position, so that triangles are smaller
// where HU change.
#pragma once

#include <vector>

#include "pipeline/contour/contour.h"

namespace trocar::pipeline {

/// The bound at a position is the area of an equilateral triangle. Along an edge of this triangle
/// HU change by at most `hu_per_edge`, according to the gradient of the image (Sobel's, which
/// averages noise over nine pixels). Two rules modify the bound. First, the bound is at least
/// kMinArea_px2 times the area of a pixel. Second, the edge length of this triangle at one pixel
/// exceeds that at any of the eight pixels around it by at most half of the distance between the
/// two pixels. Refinement evaluates the bound at a triangle's centroid. Because of the second rule,
/// a large triangle is refined even if HU change only in a part of it that is away from the
/// centroid.
class GradedArea {
 public:
  static constexpr double kMinArea_px2 = 1;

  /// Precondition: `hu_per_edge` is positive.
  GradedArea(const Image& hu, const PixelGrid& grid, double hu_per_edge);
  /// The bound at the pixel nearest to p.
  double mm2_at(LatticePoint p) const;
  /// The smallest bound at any position.
  double min_mm2() const { return min_mm2_; }

 private:
  PixelGrid grid_;
  int width_, height_;
  double min_mm2_;
  std::vector<float> edge_mm_;  // edge length for each pixel
};

}  // namespace trocar::pipeline
