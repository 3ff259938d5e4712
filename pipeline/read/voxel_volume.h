// SPDX-License-Identifier: GPL-3.0-or-later
// NIfTI files state the size of their voxels twice: by the matrix of the sform, which trocar-mesh
// uses, and by pixdim. If the two sizes differ, they give different volumes of the material. For
// example, if a converter did not correct a tilted gantry, the axes of the sform are not at right
// angles, and the volume of a voxel is less than the product of its sides. This header finds such
// differences and warns of them.
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
/// according to pixdim. If a side in `pixdim_mm` is not positive and finite, the sform's side
/// replaces it. Each of two conditions makes a conflict:
///  - The two values of a side (the length of the column, and pixdim) differ by more than 1 % of
///    pixdim.
///  - The angle between two columns differs from a right angle by more than 1e-3 rad (0.06
///    degrees).
/// The caller must set `pixel_mm2` of the result.
std::optional<VoxelConflict> voxel_conflict(const Eigen::Matrix3d& axes_mm,
                                            const std::array<double, 3>& pixdim_mm);

/// The volume of the material, computed with the voxel of the sform and with that of pixdim.
struct MaterialVolumes {
  double sform_mm3 = 0, pixdim_mm3 = 0;
};
/// `area_mm2` is the area of the material, summed over all slices.
MaterialVolumes material_volumes(const VoxelConflict& conflict, double area_mm2);

inline constexpr const char* kVoxelVolume = "voxel_volume";  ///< the code of the warning
/// A warning that states the reason of the conflict, the two volumes of a voxel and the two volumes
/// of the material.
Warning voxel_volume_warning(const VoxelConflict& conflict, const MaterialVolumes& material,
                             const std::string& file);

}  // namespace trocar::pipeline
