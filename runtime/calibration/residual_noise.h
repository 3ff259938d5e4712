// SPDX-License-Identifier: Apache-2.0
// The covariance of a curve's residuals, estimated from the residuals themselves. Bone is not uniform, so the
// residuals of a real curve are correlated over about a millimetre; taking them as independent would make the claimed
// uncertainty several times too small.
//
// The residuals of one branch of the curve have the covariance
//   scale^2 (diag(1 / samples) + ratio^2 a_i a_j k(|z_i - z_j| / length)),
// with a_i the size of the fitted force, of the tip alone or with friction, relative to the largest one, and k an exponential or a Matern-5/2 correlation.
// Branches are independent. Each combination of ratio, length, a and k is weighted by its restricted
// likelihood (H. Patterson, R. Thompson, Biometrika 58, 1971), which accounts for the residuals that the fit has
// absorbed, and by a prior for the correlation's integral (log-normal, median 0.6 mm, factor 1.6). The covariance of
// the parameters is that of generalised least squares, averaged over the combinations with these weights, so that it
// includes the uncertainty of the correlation itself. A scale above the noise that neighbouring points show is unlikely.
// Tests: tests/runtime/calibration/curve_fit_test.cpp
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

namespace trocar::runtime {

struct NoiseBranch {
  Eigen::Index begin = 0, end = 0;  ///< range of points
};

struct NoisePoints {
  Eigen::VectorXd depth_mm, samples;
  /// Expected sizes of the correlated residuals relative to the largest, if tissue and friction vary alike, and if
  /// only the tip's force varies.
  Eigen::VectorXd amplitude, tip_amplitude;
  std::vector<NoiseBranch> branches;
  double noise_N = 0;  ///< standard deviation of one sample, from the differences of neighbours
};

struct NoiseModel {
  double ratio = 1, length_mm = 0.6;
  bool is_smooth = false;  ///< Matern-5/2 instead of exponential
  bool is_of_tip = false;  ///< NoisePoints::tip_amplitude instead of amplitude
  /// The integral of the correlation over depth from 0 on, mm.
  double integral_mm() const;
};

/// Lower Cholesky factor of the covariance with scale 1, one matrix for each branch.
using NoiseFactor = std::vector<Eigen::MatrixXd>;
NoiseFactor factor_of(const NoisePoints& points, const NoiseModel& model);
/// Solves factor * x = columns, in place.
void whiten(const NoisePoints& points, const NoiseFactor& factor,
            Eigen::Ref<Eigen::MatrixXd> columns);

struct NoiseEstimate {
  NoiseModel best;         ///< the combination with the largest weight
  double scale_N = 0;      ///< its scale
  double integral_mm = 0;  ///< weighted mean of NoiseModel::integral_mm()
  double structure_N =
      0;  ///< weighted mean standard deviation of the correlated part at amplitude 1
  Eigen::MatrixXd covariance;  ///< covariance of the parameters at which the residuals were taken
};

/// `residuals`: measured minus fitted. `jacobian`: derivatives of the fitted force by the parameters, of full rank.
/// `is_rough`: only the exponential correlation is tried.
NoiseEstimate estimate_noise(const NoisePoints& points, const Eigen::VectorXd& residuals,
                             const Eigen::MatrixXd& jacobian, bool is_rough = false);

}  // namespace trocar::runtime
