// SPDX-License-Identifier: GPL-3.0-or-later
// A NIfTI file can place its array in the patient twice: by its sform, which trocar-mesh uses, and
// by its qform. If the two differ, one of them is wrong: programs that use the other show the scan
// mirrored, rotated or elsewhere.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>

namespace trocar::pipeline {

/// Describes how `qform` places an array of `n` voxels compared with `sform`: mirrored, rotated (in
/// degrees), shifted (in mm, at the array's centre), with other voxel sizes, and how far a voxel
/// moves at most. Empty if the two have the same handedness and no corner of the array moves by more
/// than half a voxel along an axis of the array. Both matrices map voxel indices to LPS, mm.
/// Precondition: their determinants are not 0.
std::string form_difference(const Eigen::Matrix4d& qform, const Eigen::Matrix4d& sform,
                            const std::array<std::int64_t, 3>& n);

}  // namespace trocar::pipeline
