// SPDX-License-Identifier: Apache-2.0
// Fits the force law `cutting` (curve_model.h) to a measured curve of force over depth, and says
// how uncertain each parameter is.
//
// The fit is a nonlinear least squares problem, solved by the Levenberg-Marquardt method from
// several starts. The residuals (measured minus fitted forces) are correlated; residual_noise.h
// estimates their covariance. A 90 % interval extends 1.645 standard deviations to either side of
// the value. The standard deviations include the uncertainty of the estimated covariance. For this
// reason short curves have wider intervals. For each parameter, the test
// (tests/runtime/calibration/curve_fit_test.cpp) finds the true value inside the interval in 85 to
// 95 % of 200 synthetic curves.
//
// A curve of force over depth shows only the sum or the product of some quantities. The fit gives
// one value for each such sum or product:
//  - The cutting force is the sum of the pressure force under the tip, the friction on the tip's
//    faces and the tearing force.
//  - Friction per length is the product of the coefficient of friction, the pressure on the shaft
//    and the circumference of the shaft.
//  - If the curve has no withdrawal, its slope is the sum of the friction per length and the drift
//    (the change of the strength with depth).
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
  double fitted_N = 0;               ///< force that the fitted law gives at this depth
  bool is_withdrawal = false;
  /// False: the fit leaves the point out, because it lies where the withdrawal begins, where
  /// cutting begins, or where the force falls at the end of a hard layer.
  bool is_used = true;
};

struct CurveFit {
  double contact_mm = 0;  ///< depth of the tissue's surface
  /// Stiffness of tip and tissue, before anything is cut. If too few points lie where the force
  /// first rises, only a lower bound of the stiffness is known, and `high` is infinite.
  FittedValue stiffness_N_per_mm;
  FittedValue cutting_N;  ///< force of the tip at the middle of the cut
  double middle_mm = 0;   ///< depth of the middle of the cut below the surface
  /// Friction for each millimetre of the tool that is in the tissue. Without a withdrawal this
  /// value includes the drift.
  FittedValue friction_N_per_mm;
  /// Change of the cutting force with depth; nullopt if the curve has no withdrawal.
  std::optional<FittedValue> drift_N_per_mm;
  /// Strength and thickness of a hard layer at the surface; nullopt if the curve shows no layer.
  std::optional<FittedValue> layer_N, layer_mm;
  /// Force that the load cell shows before contact; 0 if the curve has too few points there. Of all
  /// forces here, only those of `points` contain it.
  double baseline_N = 0;
  /// The residuals are the sum of a correlated part and of noise (residual_noise.h). structure_N is
  /// the standard deviation of the correlated part where the force is largest. correlation_mm is
  /// the integral of its correlation over the distance in depth.
  double structure_N = 0;
  double correlation_mm = 0;
  double noise_N = 0;    ///< standard deviation of the load cell's noise
  double rms_N = 0;      ///< root mean square of the residuals
  double explained = 0;  ///< fraction of the force's variance that the fit explains
  std::vector<FittedPoint> points;
};

/// Fits the law to a curve. `diameter_mm`: the tool's diameter. When the withdrawal begins, crushed
/// tissue holds the tip until the tip has moved by about one diameter. The fit leaves out the
/// points of this stretch. Errors: those of rough_curve(); kRefused if no fit is found, if nothing
/// was cut, or if the fit explains at most half of the force's variance. The messages do not
/// contain the file's name.
Result<CurveFit> fit_curve(const ForceCurve& curve, double diameter_mm);

}  // namespace trocar::runtime
