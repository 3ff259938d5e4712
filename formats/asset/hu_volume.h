// SPDX-License-Identifier: Apache-2.0
// The HU of a scan, as volumes of samples. A volume has at most one HuPlane for each slice. The
// samples of a HuPlane lie in the plane of the slice itself, so that tilt and uneven spacing need
// no resampling. A volume covers either the material and a margin around the material, or
// everything. asset.md has the layout in the file.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

namespace trocar {

/// The grid of samples, the same in all planes of a volume.
struct HuGrid {
  Eigen::Vector2d origin_mm = Eigen::Vector2d::Zero();  ///< position of sample (0, 0) in the plane
  Eigen::Vector2d pitch_mm = Eigen::Vector2d::Ones();   ///< distances of columns (x) and rows (y)
  int columns = 0, rows = 0;
  int step_hu = 8;  ///< stored HU are multiples of this step
  /// Samples are stored up to this distance from the material, in lattice steps. A negative value
  /// means that all samples are stored.
  std::int32_t margin_steps = -1;

  bool covers_everything() const { return margin_steps < 0; }
};

/// The samples of one slice.
class HuPlane {
 public:
  int index = 0;                                              ///< AssetSlice::index of the slice
  Eigen::Affine3d T_lps_plane = Eigen::Affine3d::Identity();  ///< AssetSlice::T_lps_plane
  Eigen::Vector2d origin_mm = Eigen::Vector2d::Zero();        ///< position of the first sample
  Eigen::Vector2d pitch_mm = Eigen::Vector2d::Ones();
  int first_column = 0, first_row = 0;  ///< the first sample's column and row in the grid
  int columns = 0, rows = 0;
  std::vector<float> hu;  ///< HU row by row; NaN where no sample is stored

  /// Bilinear interpolation of the four samples around the point (x, y) of the slice plane. Samples
  /// that are not stored have no weight. NaN if none of the four is stored. Does not allocate.
  float at(double x_mm, double y_mm) const noexcept;
  /// The mean of at() over a disc, taken at the 19 disc_points(). Points without a value are
  /// ignored. NaN if no point has a value. Does not allocate; takes less than a microsecond.
  float mean(double x_mm, double y_mm, double radius_mm) const noexcept;
};

struct HuVolume {
  HuGrid grid;
  std::vector<HuPlane> planes;  ///< ascending by index

  /// The plane of a slice, or null. O(log planes).
  const HuPlane* find(int index) const noexcept;
  /// HU at a position in the patient's frame (LPS, mm). The HU are interpolated bilinearly in each
  /// of the two planes around the position, and linearly between these planes along their normals.
  /// If only one of the two planes has a value at the position, the result is this value. If
  /// neither plane has a value, the result is NaN. Beyond the outermost planes, the result is the
  /// value of the nearest plane. Precondition: along their normal the planes are in the order of
  /// their indices, or in the reverse order. O(log planes).
  float at(const Eigen::Vector3d& p_lps_mm) const noexcept;
};

/// 19 points of the disc of radius 1, in rings of 1, 6 and 12 points. Each point represents the
/// same area.
const std::array<Eigen::Vector2d, 19>& disc_points() noexcept;

}  // namespace trocar
