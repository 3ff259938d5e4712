// SPDX-License-Identifier: Apache-2.0
// Finds the parts of a straight line in the x-y plane at which a sheet, seen from above, has
// material. The pictures of a session report show this material.
#pragma once

#include <array>
#include <vector>

#include "runtime/contact/sheet.h"

namespace trocar::runtime {

/// Returns the intervals [from, to] of the line that lie over material, in ascending order, in m
/// in {B}. If `axis` is 0, the line is y = at_m, and the intervals are intervals of x. If `axis` is
/// 1, the line is x = at_m, and the intervals are intervals of y.
std::vector<std::array<double, 2>> material_along(const Sheet& sheet, int axis, double at_m);

}  // namespace trocar::runtime
