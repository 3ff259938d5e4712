// SPDX-License-Identifier: GPL-3.0-or-later
// Finds soft tissue whose HU exceed a threshold for bone: vessels and organs filled with
// contrast medium.
//
// The scan is averaged over blocks of about kBlock_mm. A region is a set of connected blocks deeper
// than kDepths_mm[i] below the surface of the material. The deepest regions are examined first,
// because depth separates a vessel from a bone that it touches. A region is soft if its mean is
// below kMaxSoft_HU and above the mean of the shell between the region and the surface. (Bone has a
// denser cortex in this shell, whereas a vessel's edge fades.) Each block belongs to the nearest
// region, which is soft or bone.
// Tests: tests/pipeline/segment/canals_test.cpp
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "pipeline/read/slice_stack.h"
#include "pipeline/segment/connected_components.h"

namespace trocar::pipeline {

inline constexpr double kBlock_mm = 2;
inline constexpr double kMaxSoft_HU = 500;

/// Means of a scan's values over blocks of voxels.
class BlockMeans {
 public:
  explicit BlockMeans(const VoxelGrid& grid);
  /// Adds a slice of the grid, in HU. Safe for several slices at the same time.
  void add(std::size_t slice, const Image& image);
  /// The caller calls this once, after all slices were added.
  void finish();

  const VoxelGrid& grid() const { return blocks_; }
  const std::vector<float>& hu() const { return hu_; }
  std::size_t block(std::size_t x, std::size_t y, std::size_t z) const {
    const auto at = [this](std::size_t axis, std::size_t i) {
      return std::min(i / size_[axis], blocks_.count(axis) - 1);
    };
    return (at(2, z) * blocks_.count(1) + at(1, y)) * blocks_.count(0) + at(0, x);
  }

 private:
  std::array<std::size_t, 3> size_{};  // of a block, in voxels
  std::array<std::size_t, 3> voxels_{};
  VoxelGrid blocks_;
  std::vector<float> hu_;  // before finish() a plane for each slice
};

struct SoftRegions {
  std::vector<std::uint16_t> limit_HU;  ///< the highest soft value of each block; 0: none
  int count = 0;
  double volume_mm3 = 0;
  double low_HU = 0, high_HU = 0;  ///< least and largest mean of a region
  bool touches_bone = false;       ///< a region is connected with other material
};

/// O(blocks + those in the boxes of the regions of at least 0.3 ml).
SoftRegions find_soft_regions(const BlockMeans& means, double threshold_HU);

}  // namespace trocar::pipeline
