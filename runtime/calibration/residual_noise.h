// SPDX-License-Identifier: Apache-2.0
// Estimates the covariance of a curve's residuals (measured minus fitted forces) from the residuals
// themselves. Bone is not uniform, so the residuals of a real curve are correlated over about a
// millimetre. If they were taken as independent, the claimed uncertainty would be several times too
// small.
//
// Each residual is the sum of noise and of a correlated part. A branch of the curve is a stretch
// without gaps, for example the withdrawal. The residuals of one branch have the covariance
//   scale^2 (diag(1 / samples) + ratio^2 a_i a_j k(|z_i - z_j| / length)).
// The symbols are:
//  - scale: standard deviation of the noise of one sample (a measured point of the curve)
//  - samples: number of samples whose mean is point i
//  - ratio: size of the correlated part relative to the noise
//  - a_i: fitted force at point i divided by the largest fitted force, but at least 0.03. The
//    load cell's force before contact is subtracted from both. Two variants of a_i exist, with and
//    without friction.
//  - k: correlation, an exponential or a Matern-5/2 function; z_i: depth of point i; length: length
//    scale of the correlation, in depth
// Residuals of different branches are independent. Many combinations of ratio, length, a and k are
// tried. The weight of a combination is the product of three factors:
//  - its restricted likelihood (H. Patterson, R. Thompson, Biometrika 58, 1971), which takes into
//    account that the fit itself has made the residuals smaller
//  - a prior for the integral of the correlation over depth: log-normal, median 0.6 mm, geometric
//    standard deviation 1.6
//  - a prior that makes a scale above NoisePoints::noise_N less probable
// For each combination, one step of generalised least squares leads from the given parameters to
// new ones, and also gives their covariance. The combination's contribution is this covariance plus
// the outer product of the step with itself. The result is the weighted mean of the contributions.
// So the result includes the uncertainty about the correlation of the residuals.
// Tests: tests/runtime/calibration/curve_fit_test.cpp
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

namespace trocar::runtime {

struct NoiseBranch {
  Eigen::Index begin = 0, end = 0;  ///< indices of the branch's points: [begin, end)
};

struct NoisePoints {
  Eigen::VectorXd depth_mm, samples;  ///< samples: number of the curve's samples in each point
  /// The factors a_i of the formula above. `amplitude`: the fitted force includes friction.
  /// `tip_amplitude`: the same, but during the insertion the fitted force is that of the tip alone,
  /// without friction.
  Eigen::VectorXd amplitude, tip_amplitude;
  std::vector<NoiseBranch> branches;
  /// Standard deviation of the noise of one sample, computed from differences of neighbours.
  double noise_N = 0;
};

/// One combination of ratio, length, correlation k and factors a in the formula above.
struct NoiseModel {
  double ratio = 1, length_mm = 0.6;
  bool is_smooth = false;  ///< true: Matern-5/2 correlation; false: exponential
  bool is_of_tip = false;  ///< true: a_i is NoisePoints::tip_amplitude; false: amplitude
  /// Integral of the correlation over the distance in depth, from 0 to infinity, in mm.
  double integral_mm() const;
};

/// Lower Cholesky factor of the covariance (for scale 1), one matrix for each branch.
using NoiseFactor = std::vector<Eigen::MatrixXd>;
NoiseFactor factor_of(const NoisePoints& points, const NoiseModel& model);
/// Solves factor * x = columns for x, and stores x in `columns`. If the columns are residuals, the
/// results are uncorrelated and have equal variance.
void whiten(const NoisePoints& points, const NoiseFactor& factor,
            Eigen::Ref<Eigen::MatrixXd> columns);

struct NoiseEstimate {
  NoiseModel best;         ///< the combination with the largest weight
  double scale_N = 0;      ///< scale of `best`
  double integral_mm = 0;  ///< weighted mean of NoiseModel::integral_mm()
  /// Weighted mean of the correlated part's standard deviation where a_i is 1, that is, at the
  /// largest fitted force.
  double structure_N = 0;
  Eigen::MatrixXd covariance;  ///< covariance of the fitted parameters
};

/// Estimates the noise of the residuals, and from it the covariance of the fitted parameters.
/// `residuals`: measured minus fitted. `jacobian`: derivatives of the
/// fitted force by the parameters, of full rank. `is_rough`: only the exponential correlation with
/// `amplitude` is tried, to save time.
NoiseEstimate estimate_noise(const NoisePoints& points, const Eigen::VectorXd& residuals,
                             const Eigen::MatrixXd& jacobian, bool is_rough = false);

}  // namespace trocar::runtime
