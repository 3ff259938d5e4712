// SPDX-License-Identifier: GPL-3.0-or-later
// The scans of the sweep: their pixels in memory, and the true outline of each slice.
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "pipeline/read/slice_stack.h"
#include "tests/bench/outline_error.h"

namespace trocar::pipeline::bench {

/// Some slices of a scan. Reading one copies it: measured times contain neither disk nor decoder.
class MemoryStack final : public SliceStack {
 public:
  int size() const override { return static_cast<int>(images.size()); }
  int width() const override { return images.front().width; }
  int height() const override { return images.front().height; }
  PixelUnit pixel_unit() const override { return PixelUnit::kHounsfield; }
  const SlicePlane& plane(int slice) const override { return planes[slice]; }
  std::string name(int slice) const override { return names[slice]; }
  Result<Image> read(int slice) const override { return images[slice]; }

  std::vector<Image> images;
  std::vector<SlicePlane> planes;
  std::vector<std::string> names;
};

/// A region of almost exactly 1 mm^2 would be dropped on one lattice and kept on another, which
/// would change distances by centimetres. So min_region_mm2, in trocar-mesh 1 by default, is moved
/// to the middle of the widest gap between the areas of the true rings within 0.9 .. 1.1 mm^2.
/// Smaller rings are removed from the true outlines.
struct SweepScan {
  MemoryStack stack;
  std::vector<Truth> truths;  ///< true outline of each slice, in plane coordinates
  double pixel_mm = 0;
  double min_region_mm2 =
      1;  ///< the default, moved off any ring of about that area: see file_scan()
};

inline constexpr double kIso_HU = 226;

/// Slices of the sample's phantom (512 x 512), unrounded without noise and in whole HU with noise.
/// The true outline is where a noiseless scanner reads the iso-value. It takes about 1 s per slice
/// and depends on the slice alone: `truths` keeps it between calls.
class PhantomTruths {
 public:
  Result<sample::CrossSection> at(int slice);

 private:
  std::vector<std::pair<int, sample::CrossSection>> known_;
};
Result<SweepScan> phantom_scan(const std::vector<int>& slices, double noise_hu,
                               PhantomTruths& truths);

/// Every `stride`-th slice of a real scan from `first` on; the reference is its sub-pixel contour
/// at full resolution on the finest lattice.
Result<SweepScan> file_scan(const std::filesystem::path& path, int first, int stride);

}  // namespace trocar::pipeline::bench
