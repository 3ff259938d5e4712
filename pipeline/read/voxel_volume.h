// SPDX-License-Identifier: GPL-3.0-or-later
// NIfTI files state the size of their voxels twice: by the matrix of the sform, which is used here,
// and by pixdim. The two sizes can differ. For example, if a converter did not correct a tilted
// gantry, the axes of the sform are not at right angles, and a voxel is smaller than the product of
// its sides.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>

namespace trocar::pipeline {

struct Warning;

/// The two different volumes of a voxel.
struct VoxelConflict {
  std::string reason;  ///< how sform and pixdim disagree
  double sform_mm3 = 0, pixdim_mm3 = 0;
  double pixel_mm2 = 0;  ///< area of a pixel of a slice, according to the sform
};

/// The largest deviation of two columns from a right angle, as a text such as "12 degrees".
std::string shear_text(const Eigen::Matrix3d& columns);

/// Compares the voxel size of the sform with that of pixdim. The columns of `axes_mm` are the steps
/// along the axes of the array according to the sform. `pixdim_mm` has the sides of a voxel
/// according to pixdim; a side that is not positive and finite counts as not stated, and the side
/// of the sform replaces it. There is a conflict if a side of the sform differs from that of pixdim
/// by more than 1 % of the latter, or if two columns deviate from a right angle by more than 1e-3
/// rad (0.06 degrees). The caller must set `pixel_mm2` of the result.
std::optional<VoxelConflict> voxel_conflict(const Eigen::Matrix3d& axes_mm,
                                            const std::array<double, 3>& pixdim_mm);

/// The two volumes of the material: the number of its pixels (area over all slices / pixel_mm2)
/// times either volume of a voxel.
struct MaterialVolumes {
  double sform_mm3 = 0, pixdim_mm3 = 0;
};
MaterialVolumes material_volumes(const VoxelConflict& conflict, double area_mm2);

inline constexpr const char* kVoxelVolume = "voxel_volume";
/// The warning kVoxelVolume. Its text has all four volumes.
Warning voxel_volume_warning(const VoxelConflict& conflict, const MaterialVolumes& material,
                             const std::string& file);

}  // namespace trocar::pipeline
