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
  double cost = HUGE_VAL;  ///< sum of squares of the whitened residuals
};

/// Starts that differ in stiffness, and in the layer's end and fall if `has_layer`.
std::vector<CurveSolution> starts_of(const RoughCurve& rough, bool has_layer);

}  // namespace trocar::runtime
