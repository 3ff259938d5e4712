// SPDX-License-Identifier: GPL-3.0-or-later
// A scan as a volume whose zero level is the surface of the material. The volume is the trilinear
// interpolation of the fields from which the slices' contours are made. At a slice's height it
// equals the slice's field, so a plane there cuts the surface along the slice's contour.
// Tests: tests/pipeline/surface/display_surface_test.cpp
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include "pipeline/segment/slice_field.h"

namespace trocar::pipeline {

/// Small components that were left out of the surface.
struct DroppedComponents {
  std::size_t specks = 0, holes = 0;
  double largest_mm3 = 0;  ///< volume of the largest speck or hole
};

/// Positions are in the frame of the first slice of the stack: mm, u along its rows, v along its
/// columns, then its normal. The voxels are surrounded by a border, one voxel wide, that is outside
/// the material, so that the material is closed half a voxel beyond the voxels that were read.
struct SurfaceVolume {
  std::array<int, 3> size{};               ///< voxels along a row, along a column, slices
  double u_mm = 0, v_mm = 0;               ///< distances between voxels
  std::vector<Eigen::Vector3d> origin_mm;  ///< position of each slice's first voxel; z ascending
  std::vector<float> values;               ///< row by row, slice by slice: >= 0 in the material
  Eigen::Affine3d T_lps_volume = Eigen::Affine3d::Identity();
  DroppedComponents dropped;

  bool empty() const { return values.empty(); }

  float value(int x, int y, int z) const {
    return values[(static_cast<std::size_t>(z) * size[1] + y) * size[0] + x];
  }
  /// The slice at or below the height; -1 below the first, size[2] - 1 at and above the last.
  int slice_below(double z_mm) const;
  /// Trilinear interpolation; negative outside the volume.
  double at(const Eigen::Vector3d& p_mm) const;
  Eigen::Vector3d position(int x, int y, int z) const {
    return origin_mm[static_cast<std::size_t>(z)] + Eigen::Vector3d(x * u_mm, y * v_mm, 0);
  }
  Eigen::Vector3d position(std::size_t voxel) const {
    const auto row = static_cast<std::size_t>(size[0]), slice = row * size[1];
    return position(static_cast<int>(voxel % row), static_cast<int>(voxel % slice / row),
                    static_cast<int>(voxel / slice));
  }
  /// Unit vector along the gradient by central differences; upwards where the gradient vanishes.
  Eigen::Vector3d gradient(const Eigen::Vector3d& p_mm, double step_mm) const;
  /// The sides of a voxel; along z the mean of all voxels.
  std::array<double, 3> voxel_mm() const {
    const double z = (origin_mm.back() - origin_mm.front()).z() / (size[2] - 1);
    return {u_mm, v_mm, z};
  }
};

/// Removes small components, which are components of fewer voxels or less volume: first specks,
/// which become outside, and then holes, which become material. Components are sets of voxels
/// connected by faces. O(voxels).
void drop_small_components(SurfaceVolume& volume, int min_voxels, double min_mm3);

/// The volume whose values are the means over blocks of factor[0] x factor[1] x factor[2] voxels.
SurfaceVolume coarser(const SurfaceVolume& volume, const std::array<int, 3>& factor);

/// Specks and holes of fewer voxels, or of less volume than MaterialOptions::min_region_mm2 to the
/// power of 3/2, are not part of the surface.
inline constexpr int kMinSurfaceVoxels = 8;

/// Reads the slices from `first` to `last`, several at the same time, within the crop. A mask (of
/// labels) is smoothed by a Gaussian. Each voxel stays on its side of zero, so the surface moves by
/// less than half a voxel. If the asset has several materials (`is_one_of_several`), only the
/// voxels that MaterialOptions::solid removes are taken from it, because it treats all materials as
/// one. The result is empty if no component is large enough. Errors: those of reading; (refused)
/// fewer than two slices, slices that are not parallel, with different pixels, or not in ascending
/// order; a volume too large for memory. Memory: 8 bytes for each voxel.
Result<SurfaceVolume> read_surface_volume(const SliceStack& stack, int first, int last,
                                          const MaterialOptions& options,
                                          bool is_one_of_several = false);

inline int SurfaceVolume::slice_below(double z_mm) const {
  const double first = origin_mm.front().z(), last = origin_mm.back().z();
  if (!(z_mm >= first)) return -1;
  if (z_mm >= last) return size[2] - 1;
  // This is exact if slices are evenly spaced.
  auto k = static_cast<int>((z_mm - first) / (last - first) * (size[2] - 1));
  k = std::clamp(k, 0, size[2] - 2);
  while (origin_mm[static_cast<std::size_t>(k)].z() > z_mm)
    --k;
  while (origin_mm[static_cast<std::size_t>(k) + 1].z() <= z_mm)
    ++k;
  return k;
}

inline double SurfaceVolume::at(const Eigen::Vector3d& p_mm) const {
  constexpr double kOutside = -1;
  const int k = slice_below(p_mm.z());
  if (k < 0 || k >= size[2] - 1) return kOutside;
  const Eigen::Vector3d &low = origin_mm[static_cast<std::size_t>(k)],
                        &high = origin_mm[static_cast<std::size_t>(k) + 1];
  const double c = (p_mm.z() - low.z()) / (high.z() - low.z());
  const double x = (p_mm.x() - low.x() - c * (high.x() - low.x())) / u_mm;
  const double y = (p_mm.y() - low.y() - c * (high.y() - low.y())) / v_mm;
  if (!(x >= 0 && y >= 0 && x < size[0] - 1 && y < size[1] - 1)) return kOutside;
  const auto i = static_cast<int>(x), j = static_cast<int>(y);
  const double a = x - i, b = y - j;
  const std::size_t row = static_cast<std::size_t>(size[0]), slice = row * size[1];
  const float* v =
      &values[static_cast<std::size_t>(k) * slice + static_cast<std::size_t>(j) * row + i];
  const auto bilinear = [&](const float* w) {
    return (1 - b) * ((1 - a) * static_cast<double>(w[0]) + a * static_cast<double>(w[1])) +
           b * ((1 - a) * static_cast<double>(w[row]) + a * static_cast<double>(w[row + 1]));
  };
  return (1 - c) * bilinear(v) + c * bilinear(v + slice);
}

inline Eigen::Vector3d SurfaceVolume::gradient(const Eigen::Vector3d& p_mm, double step_mm) const {
  Eigen::Vector3d out;
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d d = Eigen::Vector3d::Unit(k) * step_mm;
    out[k] = at(p_mm + d) - at(p_mm - d);
  }
  return out.norm() > 0 ? Eigen::Vector3d(out.normalized()) : Eigen::Vector3d::UnitZ();
}

}  // namespace trocar::pipeline
