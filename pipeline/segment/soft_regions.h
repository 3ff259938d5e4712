// SPDX-License-Identifier: GPL-3.0-or-later
// Finds soft tissue whose HU exceed a threshold for bone: vessels and organs filled with
// contrast medium.
//
// The scan is averaged over blocks of about kBlock_mm. A block is material here if its mean is at
// least the threshold minus 30 HU, an allowance for noise. A region is a set of connected blocks
// that lie deeper than 7 mm below the surface of the material. A second pass searches the rest of
// the material for regions deeper than 4 mm. (Deep regions come first because a vessel and a bone
// that touch are separate at that depth.) The shell of a region is the material around it at the
// surface. A region is soft if its mean is below kMaxSoft_HU and above the mean of its shell. (Bone
// has a denser cortex in its shell. In the shell of a vessel, the HU fall off to those of the
// surrounding tissue.) Each block of material near a region belongs to the nearest region and is
// soft if this region is soft.
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
/// A threshold below this value is not a threshold for bone, so no soft regions are searched for.
/// (Skin and muscle have 20 to 80 HU, so the body itself would be a soft region.)
inline constexpr double kMinBone_HU = 100;

/// Means of a scan's values over blocks of voxels.
class BlockMeans {
 public:
  explicit BlockMeans(const VoxelGrid& grid);
  /// Adds the slice with this index, in HU. Several threads may add different slices at
  /// the same time.
  void add(std::size_t slice, const Image& image);
  /// Computes the means. The caller calls this function once, after adding all slices.
  void finish();

  const VoxelGrid& grid() const { return blocks_; }
  const std::vector<float>& hu() const { return hu_; }
  /// The index of the block that contains voxel (x, y, z).
  std::size_t block(std::size_t x, std::size_t y, std::size_t z) const {
    const auto at = [this](std::size_t axis, std::size_t i) {
      return std::min(i / size_[axis], blocks_.count(axis) - 1);
    };
    return (at(2, z) * blocks_.count(1) + at(1, y)) * blocks_.count(0) + at(0, x);
  }

 private:
  std::array<std::size_t, 3> size_{};  // size of a block along each axis, in voxels
  std::array<std::size_t, 3> voxels_{};
  VoxelGrid blocks_;
  // The mean of each block. Until finish() averages over slices, each slice has its own plane of
  // blocks.
  std::vector<float> hu_;
};

struct SoftRegions {
  /// One value for each block: the highest HU that count as soft tissue, at least 1, or 0 if the
  /// block is in no soft region.
  std::vector<std::uint16_t> limit_HU;
  int count = 0;                   ///< number of soft regions
  double volume_mm3 = 0;           ///< volume of the blocks of all soft regions
  double low_HU = 0, high_HU = 0;  ///< least and largest mean among the soft regions
  bool touches_bone = false;       ///< a soft region is connected with more than 1 ml of bone
};

/// Finds the soft regions, given the threshold of bone. O(blocks + n), where n is the number of
/// blocks in the bounding boxes of all regions of at least 0.3 ml.
SoftRegions find_soft_regions(const BlockMeans& means, double threshold_HU);

}  // namespace trocar::pipeline
