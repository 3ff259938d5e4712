// SPDX-License-Identifier: Apache-2.0
// The admissible region of the tool's axis in a sheet: a convex region around the present position in which
// the axis touches no uncut material, for a tool that approaches a wall from outside.
//
// Contract (tests/runtime/bone_cutting/contact/admissible_region_test.cpp):
//  1. The distance from the region to material is at least the tool's radius. An axis that presses on a wall lies
//     outside of the region by as much as the tool overlaps the wall.
//  2. At most kMaxWalls lines bound the region. Each is perpendicular to a shortest connection between axis
//     and material, and is shifted inwards if material lies between the lines. The region is a subset of
//     all admissible positions, and extends at most kSight_m from the axis, so it must be computed again
//     when the axis has moved.
//  3. If the axis is inside material, or in a gap narrower than the tool, the region is that point alone.
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
