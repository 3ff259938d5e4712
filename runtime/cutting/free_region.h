// SPDX-License-Identifier: Apache-2.0
// Where the tool's axis is free of a sheet's material: a convex region around where it is now, for
// a tool that comes to a wall from outside.
//
// Contract (tests/runtime/cutting/free_region_test.cpp):
//  1. Nothing of the material is nearer to the region than the tool's radius. An axis that presses
//  on
//     a wall is outside of it by as much as the tool overlaps the wall.
//  2. The region is cut off by at most kMostWalls lines, across the shortest ways to the material,
//     and moved in where material is between them: it is a part of all that is free, at most
//     kSight_m around the axis. It is to be found again when the axis has moved.
//  3. Of an axis within material, or in a place narrower than the tool, it is that point alone.
#pragma once

#include <Eigen/Core>

#include "runtime/contact/sheet.h"
#include "runtime/cutting/slot.h"

namespace trocar::runtime {

inline constexpr double kSight_m = 5e-3;
inline constexpr int kMostWalls = 8;

/// `at_m`: where the axis meets the sheet, in {B}. No allocation; time proportional to the
/// triangles within kSight_m and the radius.
Slot free_region(const Sheet& sheet, const Eigen::Vector2d& at_m, double radius_m) noexcept;

}  // namespace trocar::runtime
