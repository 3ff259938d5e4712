// SPDX-License-Identifier: Apache-2.0
// What can be said of a force-depth curve before a model is fitted: means over short stretches of depth, the load
// cell's noise, and rough values from which the fit starts. Curves from which nothing can be fitted are refused here.
// Tests: tests/runtime/calibration/curve_fit_test.cpp
#pragma once

#include <vector>

#include "formats/base/result.h"
#include "runtime/calibration/force_curve.h"

namespace trocar::runtime {

/// The mean of the curve's points in a stretch of depth.
struct CurveMean {
  double depth_mm = 0, force_N = 0;
  double samples = 1;  ///< number of points
};

/// Means over at most `most` stretches, by growing depth. The stretches have equal length, except that they are
/// shorter where the force changes quickly. Stretches without a point are left out. `noise_N`: standard deviation of
/// the noise of one point.
std::vector<CurveMean> means_of(const std::vector<CurvePoint>& points, std::size_t most,
                                double noise_N);

struct RoughCurve {
  std::vector<CurveMean> insertion, withdrawal;
  double noise_N = 0;     ///< standard deviation of one point, from the differences of neighbours
  double baseline_N = 0;  ///< mean force before contact; 0 if it is not known
  bool has_baseline = false;  ///< enough of the curve lies before contact
  double contact_mm = 0;
  double spacing_mm = 0;       ///< mean distance of the insertion's means
  double rise_spacing_mm = 0;  ///< the same where the force first rises
  double cutting_N = 0,
         slope_N_per_mm = 0;      ///< straight line through the deeper part, from the contact on
  double stiffness_N_per_mm = 0;  ///< mean slope up to half of the force at which it bends
  double deepest_mm = 0;
};

/// Errors (refused, without the file's name): the force never rises above its noise, it falls, the curve begins in
/// contact, or too little of it lies behind the contact.
Result<RoughCurve> rough_curve(const ForceCurve& curve);

}  // namespace trocar::runtime
