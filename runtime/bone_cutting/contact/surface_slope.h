// SPDX-License-Identifier: Apache-2.0
// The slope of the bone's surface under the tip. Each slice gives the distance from the tip's
// position to the slice's outline, positive inside the material and negative outside
// (edge_distance.h). Between two neighbouring slices this distance is interpolated linearly, and
// the surface is where this distance is zero (shape-based interpolation: G. Herman, J. Zheng, C.
// Bucholtz, IEEE Comput. Graph. Appl. 12(3), 1992). So the surface is continuous, with kinks at the
// slices, although the slices themselves form steps.
//
// Contract (tests/runtime/bone_cutting/contact/surface_slope_test.cpp):
//  1. On a plane surface the slope is exact up to kMaxSlope (cutting_law.h). On steeper surfaces
//     the tip increasingly touches with its face. While the slope of the surface grows from
//     kMaxSlope to twice kMaxSlope, the result changes gradually from kMaxSlope to the slope of the
//     tip's face (item 3). In a segmentation the outline moves by whole pixels from slice to slice.
//     Therefore the slope is fitted to all slices within kSlopeWindow_m of the surface. The fitted
//     slope is at most kMostSteeper times the slope between the two slices nearest to the surface.
//  2. The slope is 0 at the top of a bone volume. It is also 0 on a wide step: the tip is more than
//     EdgeDistance::kReach_mm away, horizontally, from the outline of the slice above the surface.
//  3. If no surface is found within a diameter of the tool below the front, a face of the tip is
//     assumed to touch an edge of the bone. In this case the slope is that of the tip's face, but
//     at most kMaxSlope, and the gradient points away from the material.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "runtime/bone_cutting/material/bone_volume.h"

namespace trocar::runtime {

inline constexpr double kSlopeWindow_m = 2.6e-3;
/// Largest number of sheets that are read to search for the surface, and on each side of the
/// surface for the fit.
inline constexpr int kMaxSlopeSheets = 6;
inline constexpr double kMostSteeper = 1.5;

/// Returns the gradient of the surface's depth with respect to x and y. The gradient points
/// downhill, and its length is at most kMaxSlope. Returns nothing in two cases. Either bone
/// surrounds the tip: the tip lies within the outlines of the front's slice and of the slice above.
/// Or the tip lies outside the material of the front's slice, at least EdgeDistance::kReach_mm away
/// from it. `sheet`: index of the sheet whose slab contains the cutting front. `front_m`: depth of
/// the front. `at_m`: x and y of the tip. No allocation. The time is bounded, because at most 3 *
/// kMaxSlopeSheets + 1 distances are read: 1 for the front's sheet, kMaxSlopeSheets in the search
/// for the surface, and kMaxSlopeSheets on each side of the surface.
std::optional<Eigen::Vector2d> surface_slope(const BoneVolume& bone,
                                             std::span<const Sheet* const> sheets, int sheet,
                                             double front_m, const Eigen::Vector2d& at_m) noexcept;

}  // namespace trocar::runtime
