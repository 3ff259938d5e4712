// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/voxel_volume.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "pipeline/read/number_ranges.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {
namespace {

std::string short_text(double value) {
  return text_of(value, 4);
}

std::string sides_text(const std::array<double, 3>& mm) {
  return short_text(mm[0]) + " x " + short_text(mm[1]) + " x " + short_text(mm[2]) + " mm";
}

// The largest cosine of an angle between two columns.
double largest_cosine(const Eigen::Matrix3d& columns) {
  double out = 0;
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d a = columns.col(k).normalized(),
                          b = columns.col((k + 1) % 3).normalized();
    out = std::max(out, std::abs(a.dot(b)));
  }
  return std::min(out, 1.0);
}

}  // namespace

std::string shear_text(const Eigen::Matrix3d& columns) {
  return short_text(std::asin(largest_cosine(columns)) * 180 / std::numbers::pi) + " degrees";
}

std::optional<VoxelConflict> voxel_conflict(const Eigen::Matrix3d& axes_mm,
                                            const std::array<double, 3>& pixdim_mm) {
  // Sides that differ by exactly 1 % agree, because of the margin for the rounding of 32-bit
  // floats.
  constexpr double kMaxRelative = 0.01 + 1e-6, kMaxCosine = 1e-3;
  std::array<double, 3> by_sform{}, by_pixdim{};
  bool differs = false;
  VoxelConflict out{{}, std::abs(axes_mm.determinant()), 1, 0};
  for (int k = 0; k < 3; ++k) {
    by_sform[k] = axes_mm.col(k).norm();
    const bool is_stated = std::isfinite(pixdim_mm[k]) && pixdim_mm[k] > 0;
    by_pixdim[k] = is_stated ? pixdim_mm[k] : by_sform[k];
    differs |= std::abs(by_sform[k] - by_pixdim[k]) > kMaxRelative * by_pixdim[k];
    out.pixdim_mm3 *= by_pixdim[k];
  }
  if (largest_cosine(axes_mm) > kMaxCosine)
    out.reason = "its sform shears by " + shear_text(axes_mm);
  if (differs)
    out.reason += (out.reason.empty() ? "its" : ", and its") + std::string(" spacing is ") +
                  sides_text(by_sform) + " by sform but " + sides_text(by_pixdim) + " by pixdim";
  if (out.reason.empty()) return {};
  return out;
}

MaterialVolumes material_volumes(const VoxelConflict& conflict, double area_mm2) {
  const double voxels = area_mm2 / conflict.pixel_mm2;
  return {voxels * conflict.sform_mm3, voxels * conflict.pixdim_mm3};
}

Warning voxel_volume_warning(const VoxelConflict& conflict, const MaterialVolumes& material,
                             const std::string& file) {
  return {kVoxelVolume, file,
          conflict.reason + "; the sform is used; a voxel has " + short_text(conflict.sform_mm3) +
              " mm^3 by sform, " + short_text(conflict.pixdim_mm3) +
              " by pixdim; the material has " + short_text(material.sform_mm3) +
              " mm^3 by sform, " + short_text(material.pixdim_mm3) + " by pixdim"};
}

}  // namespace trocar::pipeline
