// SPDX-License-Identifier: GPL-3.0-or-later
// Components of a volume, planes across an axis, and selection by distance.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

// The connected components of a volume of voxels.

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

// Finds the regions of a plane of pixels that a disc cannot enter from outside.

/// Positions of the pixels' columns and rows in mm, ascending; they need not be evenly spaced.
struct PlaneGrid {
  std::span<const double> u_mm, v_mm;
  std::size_t size() const { return u_mm.size() * v_mm.size(); }
};

/// Squared distance in mm^2 from each pixel's centre to the nearest pixel of `set` (row-major,
/// nonzero); infinite if the set is empty. Exact up to rounding. O(pixels). (P. Felzenszwalb, D.
/// Huttenlocher, Distance transforms of sampled functions, Theory of Computing 8, 2012.)
void squared_distances(const PlaneGrid& grid, std::span<const std::uint8_t> set,
                       std::vector<float>& squared_mm2);
/// The same in a volume. `at_mm` has the positions of the voxels along x, y and z.
void squared_distances(const std::array<std::vector<double>, 3>& at_mm,
                       std::span<const std::uint8_t> set, std::vector<float>& squared_mm2);

/// How `solid` encloses a pixel of find_enclosed().
enum Enclosure : std::uint8_t {
  kNotEnclosed = 0,
  kInCrevice = 1,   ///< in a region connected with the border that is too narrow for the disc
  kBehindGap = 2,   ///< in a region in which the disc fits, but into which it cannot come
  kSurrounded = 3,  ///< in a region that is not connected with the border
};

/// Finds the pixels that `solid` (row-major, nonzero) encloses. Sets `enclosed` to the Enclosure of
/// each pixel.
///
/// A disc of radius `radius_mm` moves in from the plane's border without touching `solid`. The
/// pixels outside `solid` that it never covers form regions (connected by edges). The pixels of a
/// region are enclosed if its area is at most `largest_mm2`. A gap of up to twice the radius is
/// therefore treated as closed. With radius 0, the regions are those that are not connected to the
/// border. If `near_mm2` is given, it receives squared_distances() of `solid`, but distances beyond
/// `near_mm` may be infinite. O(pixels * (1 + max(radius_mm, near_mm) / spacing)).
///
/// Method: the background is eroded by the disc and flooded from the border; then the flooded
/// pixels are dilated. (It would be wrong to flood the background that a morphological closing of
/// `solid` leaves. This background consists of discs, and the flood would leak in where a disc
/// inside touches a disc outside.)
void find_enclosed(const PlaneGrid& grid, std::span<const std::uint8_t> solid, double radius_mm,
                   double largest_mm2, std::vector<std::uint8_t>& enclosed, double near_mm = 0,
                   std::vector<float>* near_mm2 = nullptr);

// The planes of a volume that are perpendicular to one of its axes. Each plane can be read and
// written as an image.

/// The planes perpendicular to the axis `across`. Column x of a plane is voxel x along the axis
/// `u`, and row y is voxel y along the axis `v`.
struct VoxelPlanes {
  const VoxelGrid& grid;
  std::size_t across, u, v;

  VoxelPlanes(const VoxelGrid& of, std::size_t axis)
      : grid(of), across(axis), u(axis == 0 ? 1 : 0), v(axis == 2 ? 1 : 2) {}
  std::size_t count() const { return grid.count(across); }
  PlaneGrid plane() const { return {grid.at_mm[u], grid.at_mm[v]}; }
  std::size_t width() const { return grid.count(u); }
  std::size_t height() const { return grid.count(v); }
  std::size_t stride(std::size_t axis) const {
    return axis == 0 ? 1 : axis == 1 ? grid.count(0) : grid.count(0) * grid.count(1);
  }
  std::size_t voxel(std::size_t plane, std::size_t x, std::size_t y) const {
    return plane * stride(across) + x * stride(u) + y * stride(v);
  }
  /// Calls visit(index in the plane, index in the volume) for each pixel of a plane.
  template <typename Visit>
  void each(std::size_t plane, const Visit& visit) const {
    std::size_t i = 0;
    for (std::size_t y = 0; y < height(); ++y) {
      std::size_t at = voxel(plane, 0, y);
      for (std::size_t x = 0; x < width(); ++x, at += stride(u))
        visit(i++, at);
    }
  }
};

// Selects material by distance: near a set of voxels, or nearest to a seed.

/// Removes the voxels of `material` whose centres are farther than `margin_mm` from the centre of
/// every voxel of `near`. O(voxels).
void keep_near(const VoxelGrid& grid, std::span<const std::uint8_t> near, double margin_mm,
               std::vector<std::uint8_t>& material);

/// Keeps the material that belongs to the first seed. Each seed is the index of a voxel. A path
/// leads from voxel to voxel through faces and stays in the material. A voxel belongs to the
/// seed to which it has the shortest path; if two paths are equally long, to the earlier seed. The
/// length of such a path adds up steps along x, y and z. If a seed lies straight above another, the
/// border between them is therefore horizontal. O(voxels log voxels).
void keep_nearest_to_first(const VoxelGrid& grid, const std::vector<std::size_t>& seeds,
                           std::vector<std::uint8_t>& material);

}  // namespace trocar::pipeline
