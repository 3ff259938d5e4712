// SPDX-License-Identifier: GPL-3.0-or-later
// A scan as a volume whose zero level is the surface of the material. The volume is the trilinear
// interpolation of the fields from which the slices' contours are made, minus the iso-value. At a
// slice's height it equals the slice's field minus the iso-value, so a plane there cuts the surface
// along the slice's contour. (For the mask of a label map this holds only approximately, because
// the mask is smoothed first.)
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <vector>

#include "pipeline/segment/solid_bone.h"

namespace trocar::pipeline {

/// Small components that were left out of a volume. Specks are components of the material, and
/// holes are components of the outside.
struct DroppedComponents {
  std::size_t specks = 0, holes = 0;
  double largest_mm3 = 0;  ///< volume of the largest speck or hole
};

/// The values of voxels and their positions. A position is in mm, in the frame of the first slice
/// that was read: along its rows (u), along its columns (v) and along its normal. The outermost
/// layer of voxels is an added border outside the material. The surface is therefore closed: at the
/// border of the scan it lies half a voxel beyond the voxels that were read.
struct SurfaceVolume {
  std::array<int, 3> size{};               ///< numbers of columns, of rows and of slices
  double u_mm = 0, v_mm = 0;               ///< distances between voxels
  std::vector<Eigen::Vector3d> origin_mm;  ///< position of each slice's first voxel; z ascending
  std::vector<float> values;               ///< row by row, slice by slice; values >= 0 are material
  Eigen::Affine3d T_lps_volume = Eigen::Affine3d::Identity();
  DroppedComponents dropped;

  bool empty() const { return values.empty(); }

  float value(int x, int y, int z) const {
    return values[(static_cast<std::size_t>(z) * size[1] + y) * size[0] + x];
  }
  /// Index of the highest slice that is not above this height. It is -1 below the first slice, and
  /// size[2] - 1 at and above the last slice.
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
  /// Unit vector along the gradient, by central differences. If all differences are zero, the
  /// result is the slices' normal.
  Eigen::Vector3d gradient(const Eigen::Vector3d& p_mm, double step_mm) const;
  /// The sides of a voxel. Along z it is the mean distance of neighbouring slices.
  std::array<double, 3> voxel_mm() const {
    const double z = (origin_mm.back() - origin_mm.front()).z() / (size[2] - 1);
    return {u_mm, v_mm, z};
  }
};

/// Removes components of fewer than `min_voxels` voxels or of less volume than `min_mm3`. A
/// component is a set of voxels connected by faces. First, small components of the material
/// (specks) become outside. Then small components of the outside (holes) become material.
/// O(voxels).
void drop_small_components(SurfaceVolume& volume, int min_voxels, double min_mm3);

/// Returns a coarser volume, whose values are means over blocks of factor[0] x factor[1] x
/// factor[2] voxels. The last block of a row or column may be incomplete. If the material reaches
/// the end of such a row or column, the surface ends within about a tenth of a block of where it
/// ends in `volume`. If fewer than two slices would remain, returns `volume` unchanged.
SurfaceVolume coarser(const SurfaceVolume& volume, const std::array<int, 3>& factor);

/// Specks and holes with fewer voxels than this are left out of the surface, and so are those with
/// less volume than MaterialOptions::min_region_mm2 to the power of 3/2.
inline constexpr int kMinSurfaceVoxels = 8;

/// Reads the slices `first` to `last`, both included, within the crop, on several threads. A mask
/// (of labels) is smoothed by a Gaussian. In smoothing, each voxel stays on its side of zero, so
/// the surface moves by less than half a voxel.
///
/// If MaterialOptions::solid is given, it adds voxels to the material and removes others. It treats
/// all materials of the asset as one. If the asset has several (`is_one_of_several`), it is unknown
/// to which of them an added voxel belongs. In this case the function removes the voxels that
/// `solid` removes, but does not add any.
///
/// The result is empty if no component is large enough. Errors: those of reading; kRefused if there
/// are fewer than two slices, slices are not parallel, differ in their pixel size or are not in
/// ascending order, or the volume is too large for memory. Memory: 8 bytes for each voxel.
Result<SurfaceVolume> read_surface_volume(const SliceStack& stack, int first, int last,
                                          const MaterialOptions& options,
                                          bool is_one_of_several = false);

inline int SurfaceVolume::slice_below(double z_mm) const {
  const double first = origin_mm.front().z(), last = origin_mm.back().z();
  if (!(z_mm >= first)) return -1;
  if (z_mm >= last) return size[2] - 1;
  // The first value of k is exact if slices are evenly spaced. Otherwise the loops correct it.
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
