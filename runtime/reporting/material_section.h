// SPDX-License-Identifier: Apache-2.0
// Finds the intervals of a line on a sheet that lie over material, for the pictures of
// a session report.
// Tests: tests/e2e/session_report_test.py
#pragma once

#include <array>
#include <vector>

#include "runtime/contact/sheet.h"

namespace trocar::runtime {

/// Returns the intervals over material in ascending order, in m in {B}. If `axis` is 0, the line
/// runs along x at y = at_m. If `axis` is 1, the line runs along y at x = at_m.
std::vector<std::array<double, 2>> material_along(const Sheet& sheet, int axis, double at_m);

}  // namespace trocar::runtime
