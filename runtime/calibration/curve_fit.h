// SPDX-License-Identifier: Apache-2.0
// Fits the law `cutting` (curve_model.h) to a force-depth curve, and says how uncertain each parameter is.
//
// The fit is a nonlinear least squares problem, solved by the Levenberg-Marquardt method from several starts, with
// the covariance of the residuals that residual_noise.h estimates. Intervals are 1.645 standard deviations to either
// side; the standard deviations include the uncertainty of that covariance, which is the correction for short
// curves. In the test the intervals contain the true value in 85 to 95 % of 200 synthetic curves, for each parameter.
//
// What cannot be told apart is given as one value:
//  - The cutting force is the pressure under the tip with the friction of its faces, and the tearing, together.
//  - Friction per length is the coefficient of friction times the pressure on the shaft times its circumference.
//  - Without a withdrawal, friction and a drift of the strength with depth are one slope.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "formats/base/result.h"
#include "runtime/calibration/force_curve.h"

namespace trocar::runtime {

struct FittedValue {
  double value = 0;
  double low = 0, high = 0;  ///< 90 % interval
};

struct FittedPoint {
  double depth_mm = 0, force_N = 0;  ///< mean over a short stretch of the curve
  double fitted_N = 0;
  bool is_withdrawal = false;
  bool is_used = true;  ///< false: left out, where the tool turns round or the force bends
};

struct CurveFit {
  double contact_mm = 0;  ///< depth of the surface
  /// Stiffness of tip and tissue, before anything is cut. If the rise has too few points, only its lower bound is
  /// known, and `high` is infinite.
  FittedValue stiffness_N_per_mm;
  FittedValue cutting_N;  ///< force of the tip at the middle of the cut
  double middle_mm = 0;   ///< that depth below the surface
  /// Friction per embedded length; without a withdrawal it includes the drift.
  FittedValue friction_N_per_mm;
  std::optional<FittedValue>
      drift_N_per_mm;  ///< change of the cutting force with depth; needs a withdrawal
  /// A hard layer at the surface, if the curve shows one: its force and its thickness.
  std::optional<FittedValue> layer_N, layer_mm;
  double baseline_N = 0;  ///< force before contact, which has been subtracted
  double structure_N =
      0;  ///< standard deviation of the correlated residuals where the force is largest
  double correlation_mm = 0;  ///< integral of their correlation
  double noise_N = 0;         ///< standard deviation of the load cell's noise
  double rms_N = 0;           ///< root mean square of the residuals
  double explained = 0;       ///< part of the variance of the force that the fit explains
  std::vector<FittedPoint> points;
};

/// `diameter_mm`: the tool's diameter. Crushed tissue holds the tip over this length when it turns round, so that
/// these points are left out. Errors: (refused, without the file's name) those of rough_curve(); nothing was cut; the
/// curve is not like an insertion.
Result<CurveFit> fit_curve(const ForceCurve& curve, double diameter_mm);

}  // namespace trocar::runtime
