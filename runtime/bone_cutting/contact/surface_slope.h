// SPDX-License-Identifier: Apache-2.0
// The slope of the bone's surface under the tip. Between two neighbouring slices the surface is where the distance to
// the outline, interpolated linearly between them, is zero (shape-based interpolation: G. Herman, J. Zheng,
// C. Bucholtz, IEEE Comput. Graph. Appl. 12(3), 1992). So it is smooth where the slices are steps.
//
// Contract (tests/runtime/bone_cutting/contact/surface_slope_test.cpp):
//  1. A plane is exact at every slope. The outlines of a segmentation move by whole pixels from slice to slice, so the
//     slope is fitted to all slices within kSlopeWindow_m of the surface, but it is at most kMostSteeper times as steep
//     as between the nearest two.
//  2. The end of a body, and a step wider than EdgeDistance::kReach_mm, are level.
//  3. Beside a rim, where no surface lies near under the tip, the face of the tip touches the rim: the slope is that of
//     the face, downhill away from the material.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "runtime/bone_cutting/material/bone_volume.h"

namespace trocar::runtime {

inline constexpr double kSlopeWindow_m = 2.6e-3;
inline constexpr int kMaxSlopeSheets =
    6;  ///< sheets that are read above and below the surface, each
inline constexpr double kMostSteeper = 1.5;

/// The gradient of the surface's depth by x and y, at most kMaxSlope long; none: bone surrounds the tip, or nothing is
/// near. `sheet`: index of the sheet that holds the cutting front, at the depth `front_m`. `at_m`: x and y of the tip.
/// No allocation; at most 3 * kMaxSlopeSheets distances are read.
std::optional<Eigen::Vector2d> surface_slope(const BoneVolume& bone,
                                             std::span<const Sheet* const> sheets, int sheet,
                                             double front_m, const Eigen::Vector2d& at_m) noexcept;

}  // namespace trocar::runtime
