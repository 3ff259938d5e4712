// SPDX-License-Identifier: GPL-3.0-or-later
// The connected components of a volume of voxels.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// The width of cell i along an axis on which the cells' centres are at `at`: half of the distance
/// between its two neighbours. At an end of the axis, the width is the distance to the only
/// neighbour. Without neighbours it is 1.
inline double cell_width(std::span<const double> at, std::size_t i) {
  if (at.size() < 2) return 1;
  const std::size_t a = i > 0 ? i - 1 : i, b = i + 1 < at.size() ? i + 1 : i;
  return (at[b] - at[a]) / static_cast<double>(b - a);
}

/// The grid of a volume: the positions of the voxels' centres along each axis in mm, ascending. The
/// volume's values are row-major: voxel (x, y, z) is value [(z * ny + y) * nx + x].
struct VoxelGrid {
  std::array<std::vector<double>, 3> at_mm;
  std::size_t count(std::size_t axis) const { return at_mm[axis].size(); }
  std::size_t size() const { return count(0) * count(1) * count(2); }
  /// The cell_width() of voxel i along an axis.
  double width_mm(std::size_t axis, std::size_t i) const { return cell_width(at_mm[axis], i); }
  /// The volume of a voxel, given its place among the values.
  double mm3(std::size_t voxel) const {
    const std::size_t row = voxel / count(0);
    return width_mm(0, voxel % count(0)) * width_mm(1, row % count(1)) *
           width_mm(2, row / count(1));
  }
};

/// Returns the grid of a scan. Precondition: the slices are parallel and in ascending order
/// (check_parallel()). Positions along x and y begin at 0, the centre of the first pixel; positions
/// along z are SlicePlane::z_mm.
VoxelGrid grid_of(const SliceStack& stack);

/// The connected components of a volume, as runs of neighbouring voxels along x.
struct VoxelRuns {
  struct Run {
    std::size_t begin = 0, end = 0;  ///< voxels [begin, end)
    std::uint32_t component = 0;     ///< components are numbered in order of their first voxels
  };
  std::vector<Run> runs;
  std::size_t components = 0;  ///< number of components
};

/// Finds the components of the nonzero voxels. `size` has the numbers of voxels along x, y and z.
/// Voxels that share a face are connected; if `by_corners` is true, also those that share an edge
/// or a corner. O(voxels).
VoxelRuns find_runs(const std::array<std::size_t, 3>& size, std::span<const std::uint8_t> voxels,
                    bool by_corners);

/// The components of a volume in which voxels that share a face, an edge or a corner are connected.
/// Component c has the volume volume_mm3[c].
struct VoxelComponents : VoxelRuns {
  std::vector<double> volume_mm3;
};

/// Finds the components of the nonzero voxels. O(voxels).
VoxelComponents find_components(const VoxelGrid& grid, std::span<const std::uint8_t> voxels);

}  // namespace trocar::pipeline
