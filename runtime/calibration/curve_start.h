// SPDX-License-Identifier: Apache-2.0
// Chooses the values from which the fit of a curve of force over depth (curve_fit.h) starts.
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
  double cost = HUGE_VAL;  ///< sum of squares of the residuals that whiten() has decorrelated
};

/// Returns several starts; the fit keeps the best of their results. The starts differ in stiffness.
/// If `has_layer` is true, they also differ in kLayerEnd, kLayerForce and CurveShape::fall_mm. If
/// `has_layer` is true and the force does not fall in the upper half of the cut, the result is
/// empty.
std::vector<CurveSolution> starts_of(const RoughCurve& rough, bool has_layer);

}  // namespace trocar::runtime
