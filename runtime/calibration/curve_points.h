// SPDX-License-Identifier: Apache-2.0
// Evaluates a curve of force over depth before a model is fitted to it. The results are means over
// short stretches of depth, the load cell's noise, and rough values from which the fit starts.
// rough_curve() refuses curves to which no model can be fitted.
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

/// Returns means over at most `most` stretches of depth. The depths of the means rise strictly. The
/// stretches have equal length, except where the force changes quickly: there the stretches are
/// shorter. Stretches without a point are left out. `noise_N`: standard deviation of the noise of
/// one point; changes that the noise can explain do not count as quick.
std::vector<CurveMean> means_of(const std::vector<CurvePoint>& points, std::size_t most,
                                double noise_N);

struct RoughCurve {
  std::vector<CurveMean> insertion, withdrawal;
  double noise_N = 0;          ///< standard deviation of one point's noise
  double baseline_N = 0;       ///< mean force before contact; 0 if it is not known
  bool has_baseline = false;   ///< the curve has enough points before contact
  double contact_mm = 0;       ///< depth at which the tool touches the tissue
  double spacing_mm = 0;       ///< mean difference in depth between neighbours in `insertion`
  double rise_spacing_mm = 0;  ///< like spacing_mm, but only where the force first rises
  /// A straight line is fitted to the deeper part of the curve. slope_N_per_mm is its slope.
  /// cutting_N is its force at contact_mm, but at least a tenth of the largest force of the
  /// insertion. (baseline_N is subtracted from both forces.)
  double cutting_N = 0, slope_N_per_mm = 0;
  double stiffness_N_per_mm = 0;  ///< mean slope between the contact and half of cutting_N
  double deepest_mm = 0;
};

/// Computes the rough values. Errors: kRefused if the force never rises above its noise, if the
/// force falls instead of rising, if the curve has too few different depths, if it begins in
/// contact, or if too little of it is deeper than the contact. The messages do not contain the
/// file's name.
Result<RoughCurve> rough_curve(const ForceCurve& curve);

}  // namespace trocar::runtime
