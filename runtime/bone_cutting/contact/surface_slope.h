// SPDX-License-Identifier: Apache-2.0
// The slope of the bone's surface under the tip. Each slice gives a signed distance to its outline. Between two
// neighbouring slices the distance is interpolated linearly, and the surface is where it is zero (shape-based
// interpolation: G. Herman, J. Zheng, C. Bucholtz, IEEE Comput. Graph. Appl. 12(3), 1992). So the surface is smooth,
// although the slices form steps.
//
// Contract (tests/runtime/bone_cutting/contact/surface_slope_test.cpp):
//  1. The slope of a plane is exact at every steepness. The outlines of a segmentation move by whole pixels from slice
//     to slice. Therefore the slope is fitted to all slices within kSlopeWindow_m of the surface. It is at most
//     kMostSteeper times as steep as the slope between the two slices nearest to the surface.
//  2. The slope is 0 at the end of a bone volume and on a step wider than EdgeDistance::kReach_mm.
//  3. If no surface lies near below the tip, the tip is beside a rim, and its face touches the rim. The slope is then
//     that of the face, downhill away from the material.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "runtime/bone_cutting/material/bone_volume.h"

namespace trocar::runtime {

inline constexpr double kSlopeWindow_m = 2.6e-3;
inline constexpr int kMaxSlopeSheets =
    6;  ///< largest number of sheets that are read on each side of the surface
inline constexpr double kMostSteeper = 1.5;

/// Returns the gradient of the surface's depth by x and y; its length is at most kMaxSlope. None: bone surrounds the
/// tip, or nothing is near. `sheet`: index of the sheet that holds the cutting front. `front_m`: depth of the front.
/// `at_m`: x and y of the tip. No allocation; at most 3 * kMaxSlopeSheets distances are read.
std::optional<Eigen::Vector2d> surface_slope(const BoneVolume& bone,
                                             std::span<const Sheet* const> sheets, int sheet,
                                             double front_m, const Eigen::Vector2d& at_m) noexcept;

}  // namespace trocar::runtime
