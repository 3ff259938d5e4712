// SPDX-License-Identifier: Apache-2.0
// How far the tool's outline is outside bone along its path, for the grade of a final position.
//
// Definitions:
//  1. Bone is the material of the uncut sheets. The outline on a slice is the section of the tool, a
//     prism from the tip up, with the plane of the slice. Slices below the tip have none.
//  2. A corner of an outline is 0 outside if it is over material of its slice. Otherwise its distance
//     is the smallest over all slices of the square root of the sum of two squares: the distance in
//     the plane to that slice's material, and the difference of the heights.
//  3. The outline on a slice is as far outside as its farthest corner.
//  4. The bone begins at the first slice, counted from the top, with the tool's axis over material.
//     The entry is excluded: it ends before the first slice from there whose outline is not outside at
//     all, and at most kEntry_m below the begin. The slices from its end to the tip are judged. If
//     there is none, the tool is not in bone and has no grade.
//  5. The violation is the largest distance of a judged slice, rounded to 1 nm. Grade 0: 0; 1: under 2 mm; 2: 2 to 4 mm;
//     3: over 4 mm.
// Tests: tests/e2e/session_report_test.py
#pragma once

#include <array>
#include <optional>
#include <span>

#include "runtime/contact/sheet.h"

namespace trocar::runtime {

inline constexpr double kEntry_m = 5e-3;

struct WallViolation {
  double outside_m = 0;
  int slice =
      -1;  ///< slice index of the largest distance, the topmost of several; -1: nothing is outside
  int first_slice = 0;  ///< slice index of the first slice that is judged
  int slices_judged = 0;
};

/// `sheets`: the topmost first. `tip_m`: the tool's tip in {B}. `q`: orientation of the plate, w x y z.
std::optional<WallViolation> measure_wall_violation(std::span<const Sheet* const> sheets,
                                                    const Tool& tool,
                                                    const std::array<double, 3>& tip_m,
                                                    const std::array<double, 4>& q);

int grade_of(double outside_m);
/// "0", "under 2 mm", "2 to 4 mm" or "over 4 mm".
const char* words_of_grade(int grade);

}  // namespace trocar::runtime
