// SPDX-License-Identifier: Apache-2.0
// Computes the admissible region of the tool's axis in a sheet, a convex region around the axis.
// While the axis is in this region, the tool touches no uncut material. The boundary of the region
// is a wall for a tool that presses on the material from the side.
//
// Contract (tests/runtime/haptics/bone/admissible_region_test.cpp):
//  1. The distance from the region to material is at least the tool's radius. If the tool has been
//     pressed into a wall by some depth, the axis lies outside the region by that depth.
//  2. The region is a square around the axis, with its corners at the distance kSight_m. At most
//     kMaxWalls lines cut off the parts of the square that are too close to material. Each line
//     deals with the nearest material to which the region is still too close. The line is
//     perpendicular to the shortest segment from the axis to this material. If kMaxWalls lines do
//     not suffice, lines are moved inwards. A straight line cuts off admissible positions, too, so
//     the caller must compute the region again when the axis has moved.
//  3. If the axis is inside material or in a gap narrower than the tool, the region is only the
//     present position of the axis.
#pragma once

#include <Eigen/Core>

#include "runtime/haptics/bone/walls.h"
#include "runtime/haptics/sheet.h"

namespace trocar::runtime {

inline constexpr double kSight_m = 5e-3;
inline constexpr int kMaxWalls = 8;

/// Computes the region. `at_m`: intersection of the axis and the sheet, in {B}. `radius_m`: radius
/// of the tool. No allocation. The time is proportional to the number of triangles at the
/// sheet's boundary within the distance kSight_m + radius_m of the axis.
Slot admissible_region(const Sheet& sheet, const Eigen::Vector2d& at_m, double radius_m) noexcept;

}  // namespace trocar::runtime
