// SPDX-License-Identifier: Apache-2.0
// Fits the law `cutting` (curve_model.h) to a force-depth curve, and says how uncertain each parameter is.
//
// The fit is a nonlinear least squares problem, solved by the Levenberg-Marquardt method from several starts, with
// the covariance of the residuals that residual_noise.h estimates. A 90 % interval extends 1.645
// standard deviations to either side of the value. The standard deviations include the uncertainty
// of the estimated covariance, which makes the intervals of short curves wider. For each parameter,
// the test finds the true value inside the interval in 85 to 95 % of 200 synthetic curves.
//
// Quantities that a force-depth curve does not separate are given as one value:
//  - The cutting force is the sum of the pressure force under the tip, the friction on the tip's
//    faces and the tearing force.
//  - Friction per length is the product of the coefficient of friction, the pressure on the shaft
//    and the circumference of the shaft.
//  - If the curve has no withdrawal, friction and drift (the change of the strength with depth)
//    give one slope.
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
  /// False: the fit leaves the point out, because it lies where the withdrawal begins, or where the
  /// force bends or falls.
  bool is_used = true;
};

struct CurveFit {
  double contact_mm = 0;  ///< depth of the tissue's surface
  /// Stiffness of tip and tissue, before anything is cut. If the first rise of the force has too
  /// few points, only a lower bound of the stiffness is known, and `high` is infinite.
  FittedValue stiffness_N_per_mm;
  FittedValue cutting_N;  ///< force of the tip at the middle of the cut
  double middle_mm = 0;   ///< depth below the surface at which cutting_N holds
  /// Friction per length of the tool in the tissue. Without a withdrawal this value
  /// includes the drift.
  FittedValue friction_N_per_mm;
  /// Change of the cutting force with depth; none if the curve has no withdrawal.
  std::optional<FittedValue> drift_N_per_mm;
  /// Force and thickness of a hard layer at the surface; none: the curve shows no such layer.
  std::optional<FittedValue> layer_N, layer_mm;
  double baseline_N = 0;  ///< force before contact, which has been subtracted
  /// Standard deviation of the residuals' correlated part at the largest force (residual_noise.h).
  double structure_N = 0;
  double correlation_mm = 0;  ///< integral of the residuals' correlation over depth
  double noise_N = 0;         ///< standard deviation of the load cell's noise
  double rms_N = 0;           ///< root mean square of the residuals
  double explained = 0;       ///< fraction of the force's variance that the fit explains
  std::vector<FittedPoint> points;
};

/// Fits the law to a curve. `diameter_mm`: the tool's diameter. When the withdrawal begins, crushed
/// tissue holds the tip over about one diameter. The points of this stretch are left out. Errors:
/// those of rough_curve(); kRefused if no fit is found, if nothing was cut, or if the fit explains
/// at most half of the force's variance. The messages do not contain the file's name.
Result<CurveFit> fit_curve(const ForceCurve& curve, double diameter_mm);

}  // namespace trocar::runtime
