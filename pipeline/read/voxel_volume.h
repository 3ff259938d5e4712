// SPDX-License-Identifier: GPL-3.0-or-later
// NIfTI files state the size of their voxels twice: by the sform's matrix, which is used, and by
// pixdim. The two can disagree. For example, a converter that did not correct a tilted gantry
// leaves an sform whose axes are not at right angles, so that a voxel is smaller than the product
// of its sides.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>

namespace trocar::pipeline {

struct Warning;

/// The two volumes of a voxel.
struct VoxelConflict {
  std::string reason;  ///< how sform and pixdim disagree
  double sform_mm3 = 0, pixdim_mm3 = 0;
  double pixel_mm2 = 0;  ///< area of a slice's pixel by sform
};

/// The largest deviation of two columns from a right angle, as "12 degrees".
std::string shear_text(const Eigen::Matrix3d& columns);

/// The columns of `axes_mm` are the sform's steps along the axes of the array; `pixdim_mm` has the
/// sides by pixdim. A side that is not positive and finite counts as not stated, and the sform's
/// replaces it. There is a conflict if a side differs by more than 1 % of pixdim's, or if two
/// columns are not at right angles within 1e-3 (0.06 degrees).
std::optional<VoxelConflict> voxel_conflict(const Eigen::Matrix3d& axes_mm,
                                            const std::array<double, 3>& pixdim_mm);

/// The material's volumes: its pixels (area over all slices / pixel_mm2) times the voxel's volumes.
struct MaterialVolumes {
  double sform_mm3 = 0, pixdim_mm3 = 0;
};
MaterialVolumes material_volumes(const VoxelConflict& conflict, double area_mm2);

inline constexpr const char* kVoxelVolume = "voxel_volume";
/// The warning kVoxelVolume, with all four volumes.
Warning voxel_volume_warning(const VoxelConflict& conflict, const MaterialVolumes& material,
                             const std::string& file);

}  // namespace trocar::pipeline
