// SPDX-License-Identifier: Apache-2.0
// Where a line on a sheet lies over the sheet's material, for the pictures of a session report.
// Tests: tests/e2e/session_report_test.py
#pragma once

#include <array>
#include <vector>

#include "runtime/contact/sheet.h"

namespace trocar::runtime {

/// The intervals over material, ascending, in metres of {B}. The line runs along x at y = at_m for
/// `axis` 0, and along y at x = at_m for `axis` 1.
std::vector<std::array<double, 2>> material_along(const Sheet& sheet, int axis, double at_m);

}  // namespace trocar::runtime
