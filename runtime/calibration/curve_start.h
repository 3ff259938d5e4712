// SPDX-License-Identifier: Apache-2.0
// The values from which the fit of a curve starts.
// Tests: tests/runtime/calibration/curve_fit_test.cpp
#pragma once

#include <cmath>
#include <vector>

#include "runtime/calibration/curve_model.h"
#include "runtime/calibration/curve_points.h"

namespace trocar::runtime {

struct CurveSolution {
  CurveParameters parameters{};
  CurveShape shape;
  double cost = HUGE_VAL;  ///< sum of squares of the residuals after whiten()
};

/// Returns starting values that differ in stiffness. If `has_layer` is true, they also differ in
/// the depth of the layer's end and in the length of the force's fall there. In that case there are
/// none if the force falls nowhere.
std::vector<CurveSolution> starts_of(const RoughCurve& rough, bool has_layer);

}  // namespace trocar::runtime
