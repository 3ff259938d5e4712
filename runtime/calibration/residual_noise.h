// SPDX-License-Identifier: Apache-2.0
// The covariance of a curve's residuals, estimated from the residuals themselves. Bone is not uniform, so the
// residuals of a real curve are correlated over about a millimetre. If they were taken as
// independent, the claimed uncertainty would be several times too small.
//
// A branch of the curve is a stretch without gaps, for example the withdrawal. The residuals of one
// branch have the covariance
//   scale^2 (diag(1 / samples) + ratio^2 a_i a_j k(|z_i - z_j| / length)).
// Here z_i is the depth of point i, and a_i is the fitted force at this point divided by the
// largest fitted force, but at least 0.03. The fitted force is that of the tip alone or includes
// friction, measured from the baseline in both cases. The correlation k is an exponential or a
// Matern-5/2 function. Residuals of different branches are independent. Many combinations of ratio,
// length, a and k are tried. The weight of a combination is the product of three factors:
//  - its restricted likelihood (H. Patterson, R. Thompson, Biometrika 58, 1971), which accounts for
//    the residuals that the fit has absorbed
//  - a prior for the integral of the correlation: log-normal, median 0.6 mm, geometric standard
//    deviation 1.6
//  - a prior that disfavours a scale above the noise of neighbouring points
// The covariance of the parameters is that of generalised least squares, averaged with these
// weights over the combinations. So this covariance includes the uncertainty of the correlation.
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
  Eigen::VectorXd depth_mm, samples;  ///< samples: number of the curve's points in each mean
  /// The factors a_i of the formula above, which are the expected sizes of correlated residuals:
  /// `amplitude` if tip force and friction vary alike, `tip_amplitude` if only the tip force does.
  Eigen::VectorXd amplitude, tip_amplitude;
  std::vector<NoiseBranch> branches;
  double noise_N = 0;  ///< standard deviation of one sample, from differences of neighbours
};

/// One combination of the values in the formula above.
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
  /// Weighted mean of the correlated part's standard deviation at amplitude 1.
  double structure_N = 0;
  Eigen::MatrixXd covariance;  ///< covariance of the fitted parameters
};

/// Estimates the covariance. `residuals`: measured minus fitted. `jacobian`: derivatives of the
/// fitted force by the parameters, of full rank.
/// `is_rough`: only the exponential correlation with `amplitude` is tried.
NoiseEstimate estimate_noise(const NoisePoints& points, const Eigen::VectorXd& residuals,
                             const Eigen::MatrixXd& jacobian, bool is_rough = false);

}  // namespace trocar::runtime
