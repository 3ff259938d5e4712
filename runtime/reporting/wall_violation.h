// SPDX-License-Identifier: Apache-2.0
// Measures how far the tool's shaft comes out of the bone in which the tool is inserted. The result
// grades the final position of the tool.
//
// Definitions:
//  1. Bone is the material of the uncut sheets. The tool is a prism that begins at the tip and
//     extends upwards. The outline on a slice is the section of this prism with the plane of the
//     slice. Slices below the tip have no outline.
//  2. Each corner of an outline has a distance to the bone. If the corner is over material of its
//     own slice, the distance is 0. Otherwise it is the distance to the nearest material of any
//     slice, which is the smallest value of sqrt(d^2 + h^2) over all slices. d is the horizontal
//     distance from the corner to a slice's material, and h is the difference between the heights
//     of the corner and this slice.
//  3. The distance of an outline is the largest distance of its corners.
//  4. The bone begins at the first slice, counted from the top, at which the tool's axis is over
//     material. The entry is the upper part of the bone, where the tool comes in from outside. The
//     entry ends before the first slice whose outline has the distance 0. If no slice down to
//     kEntry_m below the beginning of the bone has this distance, the entry ends before the first
//     slice that is more than kEntry_m below the beginning. The entry is not judged. All slices
//     from the end of the entry down to the tip are judged. If no slice is judged, the tool is not
//     in bone and has no grade.
//  5. The violation is the largest distance of a judged outline, rounded to 1 nm. The grade is 0
//     for a violation of 0, 1 for less than 2 mm, 2 for 2 to 4 mm, and 3 for more than 4 mm.
#pragma once

#include <array>
#include <optional>
#include <span>

#include "runtime/contact/sheet.h"

namespace trocar::runtime {

inline constexpr double kEntry_m = 5e-3;  ///< largest height of the entry (definition 4)

struct WallViolation {
  double outside_m = 0;  ///< the violation
  /// Slice index of the outline with the largest distance. If several outlines have this distance,
  /// the topmost one counts. -1: the violation is 0.
  int slice = -1;
  int first_slice = 0;    ///< slice index of the topmost slice that is judged
  int slices_judged = 0;  ///< number of slices that are judged
};

/// Measures the violation. Returns none if the tool is not in bone (definition 4) or is tilted too
/// far (is_upright()). `sheets`: the uncut sheets, the topmost first. `tip_m`: the tool's tip in
/// {B}. `q`: orientation of the plate, w x y z.
std::optional<WallViolation> measure_wall_violation(std::span<const Sheet* const> sheets,
                                                    const Tool& tool,
                                                    const std::array<double, 3>& tip_m,
                                                    const std::array<double, 4>& q);

/// Returns the grade of a violation (definition 5).
int grade_of(double outside_m);
/// Returns the range of violations with this grade: "0", "under 2 mm", "2 to 4 mm" or "over 4 mm".
const char* words_of_grade(int grade);

}  // namespace trocar::runtime
