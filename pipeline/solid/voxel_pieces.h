// SPDX-License-Identifier: GPL-3.0-or-later
// The connected pieces of a volume of voxels.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace trocar::pipeline {

/// A volume's grid: positions of the voxels' centres along each axis in mm, ascending. Row-major:
/// voxel (x, y, z) is value [(z * ny + y) * nx + x].
struct VoxelGrid {
  std::array<std::vector<double>, 3> at_mm;
  std::size_t count(std::size_t axis) const { return at_mm[axis].size(); }
  std::size_t size() const { return count(0) * count(1) * count(2); }
  /// Half of the way to both neighbours; at the ends as much as to the only one.
  double width_mm(std::size_t axis, std::size_t i) const;
};

/// Pieces connected by faces, edges or corners, as runs of voxels along x: piece `piece` of
/// volume_mm3[piece].
struct VoxelPieces {
  struct Run {
    std::size_t begin = 0, end = 0;  ///< voxels [begin, end)
    std::uint32_t piece = 0;         ///< numbered in the order of their first voxels
  };
  std::vector<Run> runs;
  std::vector<double> volume_mm3;
};

/// The pieces of the voxels that are != 0. O(voxels).
VoxelPieces find_pieces(const VoxelGrid& grid, std::span<const std::uint8_t> voxels);

}  // namespace trocar::pipeline
