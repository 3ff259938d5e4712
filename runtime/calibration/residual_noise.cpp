// SPDX-License-Identifier: Apache-2.0
#include "runtime/calibration/residual_noise.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

namespace trocar::runtime {
namespace {

constexpr std::array kRatios{0.1, 0.3, 1.0, 2.0, 4.0, 8.0, 20.0, 60.0, 200.0, 1000.0};
constexpr std::array kLengths_mm{0.2, 0.35, 0.6, 1.0, 1.8};
constexpr double kPriorLength_mm = 0.6, kPriorSpread = 0.5;
constexpr double kNoiseSpread = 0.3;

double correlation(const NoiseModel& model, double distance_mm) {
  if (!model.is_smooth) return std::exp(-distance_mm / model.length_mm);
  const double x = std::sqrt(5.0) * distance_mm / model.length_mm;
  return (1 + x + x * x / 3) * std::exp(-x);
}

/// The generalised least squares step for one covariance.
struct Candidate {
  NoiseModel model;
  double log_weight = 0, scale_squared = 0;
  Eigen::VectorXd step;
  Eigen::MatrixXd covariance;
};

Candidate candidate_of(const NoisePoints& points, const NoiseModel& model,
                       const Eigen::VectorXd& residuals, const Eigen::MatrixXd& jacobian) {
  const Eigen::Index n = residuals.size(), p = jacobian.cols();
  const NoiseFactor factor = factor_of(points, model);
  Eigen::MatrixXd white(n, p + 1);
  white << jacobian, residuals;
  whiten(points, factor, white);
  const Eigen::MatrixXd normal = white.leftCols(p).transpose() * white.leftCols(p);
  // Scaled to a unit diagonal, because the parameters have different units.
  const Eigen::VectorXd unit = normal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd scaled =
      unit.asDiagonal() * normal * unit.asDiagonal() + 1e-12 * Eigen::MatrixXd::Identity(p, p);
  const Eigen::LLT<Eigen::MatrixXd> llt(scaled);
  Candidate out;
  out.model = model;
  out.step = unit.asDiagonal() *
             llt.solve(unit.asDiagonal() * white.leftCols(p).transpose() * white.col(p));
  out.covariance =
      unit.asDiagonal() * llt.solve(Eigen::MatrixXd::Identity(p, p)) * unit.asDiagonal();
  const double squares = (white.col(p) - white.leftCols(p) * out.step).squaredNorm();
  const double freedom = std::max(static_cast<double>(n - p), 1.0);
  out.scale_squared = squares / freedom;
  out.covariance *= out.scale_squared;
  double log_determinant = -2 * unit.array().log().sum();
  const Eigen::MatrixXd lower = llt.matrixL();
  log_determinant += 2 * lower.diagonal().array().log().sum();
  for (const Eigen::MatrixXd& block : factor)
    log_determinant += 2 * block.diagonal().array().log().sum();
  const double prior = std::log(model.integral_mm() / kPriorLength_mm) / kPriorSpread;
  // The part beyond the noise of neighbouring points belongs to the structure.
  const double excess =
      std::max(std::log(std::sqrt(out.scale_squared) / std::max(points.noise_N, 1e-9)), 0.0) /
      kNoiseSpread;
  out.log_weight = -0.5 * (log_determinant + freedom * std::log(std::max(squares, 1e-300)) +
                           prior * prior + excess * excess);
  return out;
}

}  // namespace

double NoiseModel::integral_mm() const {
  return is_smooth ? 8 * length_mm / (3 * std::sqrt(5.0)) : length_mm;
}

NoiseFactor factor_of(const NoisePoints& points, const NoiseModel& model) {
  const Eigen::VectorXd& amplitude = model.is_of_tip ? points.tip_amplitude : points.amplitude;
  NoiseFactor factor;
  for (const NoiseBranch& branch : points.branches) {
    const Eigen::Index n = branch.end - branch.begin;
    Eigen::MatrixXd& matrix = factor.emplace_back(n, n);
    for (Eigen::Index j = 0; j < n; ++j) {
      const Eigen::Index b = branch.begin + j;
      for (Eigen::Index i = j; i < n; ++i) {
        const Eigen::Index a = branch.begin + i;
        matrix(i, j) = model.ratio * model.ratio * amplitude[a] * amplitude[b] *
                       correlation(model, std::abs(points.depth_mm[a] - points.depth_mm[b]));
      }
      matrix(j, j) += 1 / points.samples[b] + 1e-9;
    }
    Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>, Eigen::Lower> in_place(matrix);
  }
  return factor;
}

void whiten(const NoisePoints& points, const NoiseFactor& factor,
            Eigen::Ref<Eigen::MatrixXd> columns) {
  for (std::size_t k = 0; k < factor.size(); ++k) {
    const NoiseBranch& branch = points.branches[k];
    auto rows = columns.middleRows(branch.begin, branch.end - branch.begin);
    factor[k].triangularView<Eigen::Lower>().solveInPlace(rows);
  }
}

NoiseEstimate estimate_noise(const NoisePoints& points, const Eigen::VectorXd& residuals,
                             const Eigen::MatrixXd& jacobian, bool is_rough) {
  std::vector<Candidate> candidates;
  for (const bool is_smooth : {false, true})
    for (const bool is_of_tip : {false, true})
      for (const double length_mm : kLengths_mm)
        for (const double ratio : kRatios) {
          if (is_rough && (is_smooth || is_of_tip)) continue;
          candidates.push_back(
              candidate_of(points, {ratio, length_mm, is_smooth, is_of_tip}, residuals, jacobian));
        }
  const Candidate& best = *std::max_element(
      candidates.begin(), candidates.end(),
      [](const Candidate& a, const Candidate& b) { return a.log_weight < b.log_weight; });
  const Eigen::Index p = jacobian.cols();
  NoiseEstimate out;
  out.best = best.model;
  out.scale_N = std::sqrt(best.scale_squared);
  out.covariance = Eigen::MatrixXd::Zero(p, p);
  double sum = 0;
  for (const Candidate& each : candidates) {
    const double weight = std::exp(each.log_weight - best.log_weight);
    if (weight < 1e-6) continue;
    sum += weight;
    out.integral_mm += weight * each.model.integral_mm();
    out.structure_N += weight * each.model.ratio * std::sqrt(each.scale_squared);
    out.covariance += weight * (each.covariance + each.step * each.step.transpose());
  }
  out.integral_mm /= sum;
  out.structure_N /= sum;
  out.covariance /= sum;
  return out;
}

}  // namespace trocar::runtime
