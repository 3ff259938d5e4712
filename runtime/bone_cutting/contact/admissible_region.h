// SPDX-License-Identifier: Apache-2.0
// The admissible region of the tool's axis in a sheet: a convex region around the present position of the axis
// in which the tool touches no uncut material. The boundary of this region is the wall on which a tool presses
// from the side.
//
// Contract (tests/runtime/bone_cutting/contact/admissible_region_test.cpp):
//  1. The distance from the region to material is at least the tool's radius. If the tool presses on a wall,
//     the axis lies outside the region by the depth to which tool and wall overlap.
//  2. The region is bounded by a square of half-diagonal kSight_m and at most kMaxWalls lines. Each line is
//     perpendicular to the shortest segment from the axis to material that no other line keeps away. If
//     material remains nearer than the tool's radius, lines are moved inwards. The region does not contain all
//     admissible positions near the axis, so it must be computed again when the axis has moved.
//  3. If the axis is inside material or in a gap narrower than the tool, the region is that point alone.
#pragma once

#include <Eigen/Core>

#include "runtime/bone_cutting/law/slot.h"
#include "runtime/contact/sheet.h"

namespace trocar::runtime {

inline constexpr double kSight_m = 5e-3;
inline constexpr int kMaxWalls = 8;

/// `at_m`: intersection of the axis and the sheet, in {B}. No allocation; time proportional to the number of
/// triangles within kSight_m plus the radius.
Slot admissible_region(const Sheet& sheet, const Eigen::Vector2d& at_m, double radius_m) noexcept;

}  // namespace trocar::runtime
