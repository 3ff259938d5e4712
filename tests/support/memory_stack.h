// SPDX-License-Identifier: GPL-3.0-or-later
// Scans in memory, for the pipeline's tests.
#pragma once

#include <string>
#include <vector>

#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// An image by `value(x, y)`.
template <typename Value>
Image image_of(int width, int height, Value value) {
  Image out{width, height, {}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x)
      out.values.push_back(static_cast<float>(value(x, y)));
  }
  return out;
}

/// The plane at a height, with rows along x and columns along y.
inline SlicePlane axial_plane(double pixel_mm, double z_mm) {
  SlicePlane out{pixel_mm, pixel_mm, Eigen::Affine3d::Identity(), z_mm};
  out.T_lps_plane.translation().z() = z_mm;
  return out;
}

/// Slices in HU, all of one size.
class MemoryStack : public SliceStack {
 public:
  MemoryStack() = default;
  /// Axial slices 1 mm apart.
  explicit MemoryStack(std::vector<Image> slices, double pixel_mm = 0.7)
      : images(std::move(slices)) {
    for (std::size_t k = 0; k < images.size(); ++k)
      planes.push_back(axial_plane(pixel_mm, static_cast<double>(k)));
  }
  int size() const override { return static_cast<int>(images.size()); }
  int width() const override { return images[0].width; }
  int height() const override { return images[0].height; }
  PixelUnit pixel_unit() const override { return PixelUnit::kHounsfield; }
  const SlicePlane& plane(int slice) const override {
    return planes[static_cast<std::size_t>(slice)];
  }
  std::string name(int slice) const override { return "slice " + std::to_string(slice); }
  Result<Image> read(int slice) const override { return images[static_cast<std::size_t>(slice)]; }

  std::vector<Image> images;
  std::vector<SlicePlane> planes;
};

}  // namespace trocar::pipeline
