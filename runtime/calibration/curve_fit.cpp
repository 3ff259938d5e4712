// SPDX-License-Identifier: Apache-2.0
#include "runtime/calibration/curve_fit.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "formats/base/text_line.h"
#include "runtime/calibration/curve_model.h"
#include "runtime/calibration/curve_points.h"
#include "runtime/calibration/curve_start.h"
#include "runtime/calibration/residual_noise.h"

namespace trocar::runtime {
namespace {

/// Residuals where the force is small are taken as at least this part of those where it is largest, because no tissue
/// is as linear at the surface as the model.
constexpr double kMinAmplitude = 0.03;
/// Smallest fall of the squared, whitened residuals by which a hard layer is accepted.
constexpr double kLayerEvidence = 36;
constexpr double kMinExplained = 0.5;
constexpr double kQuantile95 = 1.6448536269514722;  ///< quantile of the normal distribution
constexpr int kMostSteps = 60;
/// Smallest cutting force, as a part of the largest force.
constexpr double kMinCutting = 0.02;
/// The force bends between these parts of the depth at which cutting begins.
constexpr double kBendFrom = 0.6, kBendTo = 1.1;
constexpr std::ptrdiff_t kMinRise = 4;  ///< points of the rise that the stiffness needs

struct Problem {
  std::vector<CurveMean> points;  ///< those of the insertion, then those of the withdrawal
  std::size_t insertion = 0;      ///< number of the insertion's points
  NoisePoints noise;
  bool resolves_rise = false;  ///< the rise has points enough for the stiffness
  std::vector<CurveParameter> free;
};

double fitted_N(const Problem& problem, const CurveParameters& parameters, const CurveShape& shape,
                std::size_t i) {
  const double depth_mm = problem.points[i].depth_mm;
  return i < problem.insertion ? insertion_N(parameters, shape, depth_mm)
                               : withdrawal_N(parameters, depth_mm);
}

Eigen::VectorXd residuals_of(const Problem& problem, const CurveParameters& parameters,
                             const CurveShape& shape) {
  Eigen::VectorXd residuals(static_cast<Eigen::Index>(problem.points.size()));
  for (std::size_t i = 0; i < problem.points.size(); ++i)
    residuals[static_cast<Eigen::Index>(i)] =
        problem.points[i].force_N - fitted_N(problem, parameters, shape, i);
  return residuals;
}

/// A small change of a parameter, for differences.
double step_of(CurveParameter parameter, const CurveParameters& at, const RoughCurve& rough) {
  switch (parameter) {
    case kContact:
    case kLayerEnd:
      return 0.02 * rough.rise_spacing_mm;
    case kLogStiffness:
      return 1e-4;
    case kFriction:
    case kDrift:
      return 1e-4 * std::max(at[kCutting], 1e-3) / rough.deepest_mm;
    default:
      return 1e-4 * std::max(at[kCutting], 1e-3);
  }
}

/// Derivatives of the fitted force by the free parameters, by central differences of relative size `scale`.
Eigen::MatrixXd jacobian_of(const Problem& problem, const RoughCurve& rough,
                            const CurveSolution& at, double scale = 1) {
  Eigen::MatrixXd jacobian(problem.points.size(), problem.free.size());
  for (std::size_t k = 0; k < problem.free.size(); ++k) {
    CurveParameters before = at.parameters, after = at.parameters;
    const double step = scale * step_of(problem.free[k], at.parameters, rough);
    before.at(problem.free[k]) -= step;
    after.at(problem.free[k]) += step;
    jacobian.col(static_cast<Eigen::Index>(k)) =
        (residuals_of(problem, before, at.shape) - residuals_of(problem, after, at.shape)) /
        (2 * step);
  }
  return jacobian;
}

/// Keeps the parameters where the model is defined.
void limit(CurveParameters& p, const RoughCurve& rough) {
  p[kLogStiffness] = std::clamp(p[kLogStiffness], std::log(1e-6), std::log(1e7));
  p[kCutting] = std::max(p[kCutting], 1e-6);
  p[kLayerForce] = std::max(p[kLayerForce], 1e-6);
  p[kContact] = std::min(p[kContact], rough.deepest_mm);
}

/// Levenberg-Marquardt with the scaling of Marquardt (D. Marquardt, SIAM J. Appl. Math. 11, 1963).
void minimise(const Problem& problem, const NoiseFactor& factor, const RoughCurve& rough,
              CurveSolution& solution) {
  const auto whitened = [&](const CurveSolution& at) {
    Eigen::MatrixXd column = residuals_of(problem, at.parameters, at.shape);
    whiten(problem.noise, factor, column);
    return Eigen::VectorXd(column.col(0));
  };
  Eigen::VectorXd residuals = whitened(solution);
  solution.cost = residuals.squaredNorm();
  double damping = 1e-3;
  for (int step = 0; step < kMostSteps && damping < 1e8; ++step) {
    Eigen::MatrixXd jacobian = jacobian_of(problem, rough, solution);
    whiten(problem.noise, factor, jacobian);
    Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
    const Eigen::VectorXd gradient = jacobian.transpose() * residuals;
    const double least = 1e-9 * normal.diagonal().maxCoeff() + 1e-300;
    const Eigen::VectorXd diagonal = normal.diagonal().cwiseMax(least * 1e-6);
    bool is_better = false;
    for (; !is_better && damping < 1e8; damping *= is_better ? 0.1 : 5) {
      Eigen::MatrixXd damped = normal;
      damped.diagonal() += damping * diagonal;
      const Eigen::VectorXd change = damped.ldlt().solve(gradient);
      CurveSolution next = solution;
      for (std::size_t k = 0; k < problem.free.size(); ++k)
        next.parameters.at(problem.free[k]) += change[static_cast<Eigen::Index>(k)];
      limit(next.parameters, rough);
      const Eigen::VectorXd there = whitened(next);
      next.cost = there.squaredNorm();
      if (!(next.cost < solution.cost)) continue;
      is_better = true;
      if (solution.cost - next.cost < 1e-7 * solution.cost) damping = 1e9;  // it has converged
      solution = next;
      residuals = there;
    }
  }
}

std::vector<CurveParameter> free_parameters(const RoughCurve& rough, bool has_layer,
                                            bool resolves_rise) {
  std::vector<CurveParameter> free{kCutting, kFriction};
  if (resolves_rise) {
    free.push_back(kContact);
    free.push_back(kLogStiffness);
  }
  if (rough.has_baseline) free.push_back(kBaseline);
  if (!rough.withdrawal.empty()) free.push_back(kDrift);
  if (has_layer) free.push_back(kLayerForce);
  return free;
}

/// Sets the expected sizes of the correlated residuals.
void set_amplitudes(const CurveParameters& parameters, const CurveShape& shape, Problem& problem) {
  const auto n = static_cast<Eigen::Index>(problem.points.size());
  CurveParameters without_friction = parameters;
  without_friction[kFriction] = 0;
  for (const bool is_of_tip : {false, true}) {
    Eigen::VectorXd& amplitude = is_of_tip ? problem.noise.tip_amplitude : problem.noise.amplitude;
    amplitude.resize(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const bool is_tip = is_of_tip && k < problem.insertion;
      amplitude[i] = std::abs(fitted_N(problem, is_tip ? without_friction : parameters, shape, k) -
                              parameters[kBaseline]);
    }
    amplitude /= std::max(amplitude.maxCoeff(), 1e-12);
    amplitude = amplitude.cwiseMax(kMinAmplitude);
  }
}

/// The strength that the tip meets first.
double first_strength_N(const CurveSolution& at) {
  const CurveParameters& p = at.parameters;
  if (at.shape.has_layer) return p[kLayerForce];
  return std::max(p[kCutting] - p[kDrift] * at.shape.middle_mm, 0.1 * p[kCutting]);
}

/// The stretch in which the force first rises.
struct Rise {
  double before_mm = 0,
         behind_mm = 0;  ///< last point before it, first point that has 80 % of the strength
  double least_stiffness_N_per_mm =
      0;  ///< that of a straight rise over this stretch, less a margin
};

Rise rise_of(const RoughCurve& rough, const CurveSolution& at) {
  const double strength_N = first_strength_N(at), baseline_N = at.parameters[kBaseline];
  Rise rise{rough.insertion.front().depth_mm, rough.deepest_mm, 0};
  for (const CurveMean& mean : rough.insertion) {
    if (mean.force_N - baseline_N > 0.8 * strength_N) {
      rise.behind_mm = mean.depth_mm;
      break;
    }
    if (mean.force_N - baseline_N < 0.1 * strength_N) rise.before_mm = mean.depth_mm;
  }
  rise.least_stiffness_N_per_mm =
      0.7 * strength_N / std::max(rise.behind_mm - rise.before_mm, 1e-6);
  return rise;
}

/// Keeps stiffness and contact of a rise with too few points within what these points allow.
void limit_rise(const Rise& rise, CurveParameters& p) {
  const double least = rise.least_stiffness_N_per_mm;
  p[kLogStiffness] = std::clamp(p[kLogStiffness], std::log(least), std::log(5 * least));
  p[kContact] = std::clamp(p[kContact], rise.before_mm, rise.behind_mm);
}

/// The points that the model describes: not those of the withdrawal near the turning point. If `bend` is given,
/// those where its force bends from rising to cutting are left out too, because what the tip meets first is rarely
/// as strong as the mean, so that they would pull the stiffness down. What lies before and behind them counts as
/// independent.
Problem make_problem(const RoughCurve& rough, double diameter_mm,
                     const CurveSolution* bend = nullptr) {
  Problem problem;
  std::size_t rising = 0;
  double from_mm = HUGE_VAL, to_mm = HUGE_VAL;
  if (bend != nullptr) {
    const double elastic_mm = first_strength_N(*bend) / std::exp(bend->parameters[kLogStiffness]),
                 contact_mm = bend->parameters[kContact];
    from_mm = contact_mm + kBendFrom * elastic_mm;
    to_mm = contact_mm + kBendTo * elastic_mm;
    const auto inside =
        std::count_if(rough.insertion.begin(), rough.insertion.end(), [&](const CurveMean& mean) {
          return mean.depth_mm > contact_mm && mean.depth_mm < from_mm;
        });
    problem.resolves_rise = inside >= kMinRise;
    if (!problem.resolves_rise) {
      const Rise rise = rise_of(rough, *bend);
      from_mm = std::nextafter(rise.before_mm, HUGE_VAL);
      to_mm = 1.5 * rise.behind_mm - 0.5 * rise.before_mm;
    }
  }
  if (bend != nullptr && problem.resolves_rise && bend->shape.has_layer) {
    const double end_mm =
        bend->parameters[kLayerEnd] - 0.6 * bend->shape.fall_mm - 0.5 * rough.rise_spacing_mm;
    const auto held = std::count_if(
        rough.insertion.begin(), rough.insertion.end(),
        [&](const CurveMean& mean) { return mean.depth_mm > to_mm && mean.depth_mm < end_mm; });
    if (held < kMinRise)
      to_mm = from_mm;  // the layer is so thin that its strength shows at the bend alone
  }
  const bool has_fall = bend != nullptr && bend->shape.has_layer;
  const double fall_mm = has_fall ? 0.6 * bend->shape.fall_mm + 0.5 * rough.rise_spacing_mm : 0;
  for (const CurveMean& mean : rough.insertion) {
    if (has_fall && std::abs(mean.depth_mm - bend->parameters[kLayerEnd]) < fall_mm) continue;
    if (mean.depth_mm < from_mm) ++rising;
    if (mean.depth_mm < from_mm || mean.depth_mm > to_mm) problem.points.push_back(mean);
  }
  problem.insertion = problem.points.size();
  const double turn_mm =
      std::max(diameter_mm, 1.0) + 1.2 * rough.cutting_N / rough.stiffness_N_per_mm;
  for (const CurveMean& mean : rough.withdrawal)
    if (mean.depth_mm < rough.deepest_mm - turn_mm) problem.points.push_back(mean);
  problem.noise.noise_N = rough.noise_N;
  const auto n = static_cast<Eigen::Index>(problem.points.size());
  problem.noise.depth_mm.resize(n);
  problem.noise.samples.resize(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    problem.noise.depth_mm[i] = problem.points[static_cast<std::size_t>(i)].depth_mm;
    problem.noise.samples[i] = problem.points[static_cast<std::size_t>(i)].samples;
  }
  const Eigen::Index ends[] = {0, static_cast<Eigen::Index>(rising),
                               static_cast<Eigen::Index>(problem.insertion), n};
  for (std::size_t k = 0; k < 3; ++k)
    if (ends[k + 1] > ends[k]) problem.noise.branches.push_back({ends[k], ends[k + 1]});
  return problem;
}

struct Estimate {
  CurveSolution solution;
  NoiseEstimate noise;
};

/// The fit with or without a layer. None: no start led to it.
std::optional<Estimate> estimate(Problem& problem, const RoughCurve& rough, double diameter_mm,
                                 bool has_layer) {
  problem.free = free_parameters(rough, has_layer, true);
  if (has_layer) problem.free.push_back(kLayerEnd);  // later it is known, and the fall is left out
  std::vector<CurveSolution> starts = starts_of(rough, has_layer);
  if (starts.empty()) return std::nullopt;
  NoiseModel model;
  model.ratio = 3;
  Estimate out;
  set_amplitudes(starts.front().parameters, starts.front().shape, problem);
  for (int round = 0; round < 3; ++round) {
    if (round > 0) {
      problem = make_problem(rough, diameter_mm, &out.solution);
      problem.free = free_parameters(rough, has_layer, problem.resolves_rise);
      if (!problem.resolves_rise) limit_rise(rise_of(rough, out.solution), out.solution.parameters);
      set_amplitudes(out.solution.parameters, out.solution.shape, problem);
    }
    const NoiseFactor factor = factor_of(problem.noise, model);
    if (round == 0) {
      for (CurveSolution& each : starts) {
        minimise(problem, factor, rough, each);
        if (each.cost < out.solution.cost) out.solution = each;
      }
      if (!std::isfinite(out.solution.cost)) return std::nullopt;
    } else {
      minimise(problem, factor, rough, out.solution);
    }
    set_amplitudes(out.solution.parameters, out.solution.shape, problem);
    out.noise = estimate_noise(problem.noise,
                               residuals_of(problem, out.solution.parameters, out.solution.shape),
                               jacobian_of(problem, rough, out.solution, 10), round < 2);
    model = out.noise.best;
  }
  return out;
}

/// The squared residuals of a solution, whitened by the noise that the fit with a layer has left.
double squares_with(const Problem& problem, const RoughCurve& rough, const Estimate& noise,
                    CurveSolution solution) {
  minimise(problem, factor_of(problem.noise, noise.noise.best), rough, solution);
  return solution.cost / (noise.noise.scale_N * noise.noise.scale_N);
}

/// The better of the fits with and without a layer; `problem` is left as its fit needs it.
Result<Estimate> choose(Problem& problem, const RoughCurve& rough, double diameter_mm) {
  Problem plain_problem = problem, layer_problem = problem;
  std::optional<Estimate> plain = estimate(plain_problem, rough, diameter_mm, false);
  std::optional<Estimate> layer = estimate(layer_problem, rough, diameter_mm, true);
  if (!plain) return refused("no fit was found");
  if (layer) {
    const CurveParameters& p = layer->solution.parameters;
    Problem compared = layer_problem;
    compared.free = plain_problem.free;
    const double evidence = squares_with(compared, rough, *layer, plain->solution) -
                            squares_with(layer_problem, rough, *layer, layer->solution);
    if (p[kLayerForce] > p[kCutting] && evidence > kLayerEvidence) {
      problem = std::move(layer_problem);
      return std::move(*layer);
    }
  }
  problem = std::move(plain_problem);
  return std::move(*plain);
}

/// Returns a free parameter with its interval.
FittedValue value_of(CurveParameter parameter, const Problem& problem, const Estimate& estimate) {
  const auto found = std::find(problem.free.begin(), problem.free.end(), parameter);
  const Eigen::Index k = found - problem.free.begin();
  const double value = estimate.solution.parameters.at(parameter);
  const double half = kQuantile95 * std::sqrt(estimate.noise.covariance(k, k));
  if (!std::isfinite(half)) return {value, -HUGE_VAL, HUGE_VAL};
  return {value, value - half, value + half};
}

/// The largest force above the baseline.
double largest_N(const Problem& problem, const CurveSolution& at) {
  double largest = 1e-12;
  for (std::size_t i = 0; i < problem.points.size(); ++i)
    largest = std::max(largest, std::abs(fitted_N(problem, at.parameters, at.shape, i) -
                                         at.parameters[kBaseline]));
  return largest;
}

FittedValue at_least_0(FittedValue x) {
  return {std::max(x.value, 0.0), std::max(x.low, 0.0), std::max(x.high, 0.0)};
}

/// Thickness of the layer: the depth at which it breaks, less that of the surface and the tip's elastic displacement.
FittedValue thickness_of(const Problem& problem, const RoughCurve& rough,
                         const Estimate& estimate) {
  const CurveParameters& p = estimate.solution.parameters;
  const double elastic_mm = p[kLayerForce] / std::exp(p[kLogStiffness]);
  Eigen::VectorXd gradient = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(problem.free.size()));
  for (std::size_t k = 0; k < problem.free.size(); ++k) {
    double& slope = gradient[static_cast<Eigen::Index>(k)];
    if (problem.free[k] == kContact) slope = -1;
    if (problem.free[k] == kLogStiffness) slope = elastic_mm;
  }
  const CurveSolution& at = estimate.solution;
  const double value = p[kLayerEnd] - p[kContact] - elastic_mm;
  // The layer breaks at the strength that it has at its end, or its mean strength is not known as well as the depth
  // of the break: the larger of the two, for structure of the estimated size and correlation. Besides, the fall has
  // a length, and a stiffness of which only a bound is known leaves the elastic displacement open.
  const double stretches = std::max(value, 0.0) / (2 * estimate.noise.integral_mm),
               part = std::max(1 - std::exp(-stretches), 1 / (1 + stretches)),
               local_mm = std::sqrt(part) * estimate.noise.structure_N / largest_N(problem, at) *
                          elastic_mm,
               fall_mm = std::max(at.shape.fall_mm, rough.rise_spacing_mm) / std::sqrt(12.0),
               open_mm = problem.resolves_rise ? 0 : elastic_mm;
  const double variance = gradient.dot(estimate.noise.covariance * gradient) + local_mm * local_mm +
                          fall_mm * fall_mm + open_mm * open_mm;
  const double half = kQuantile95 * std::sqrt(variance);
  if (!std::isfinite(half)) return {std::max(value, 0.0), 0, HUGE_VAL};
  return at_least_0({value, value - half, value + half});
}

void set_points(const Problem& problem, const RoughCurve& rough, const CurveSolution& at,
                CurveFit& fit) {
  double squares = 0, total = 0, mean_N = 0, n = 0;
  for (const CurveMean& point : rough.insertion)
    mean_N += point.force_N / static_cast<double>(rough.insertion.size());
  for (const bool is_withdrawal : {false, true})
    for (const CurveMean& point : is_withdrawal ? rough.withdrawal : rough.insertion) {
      const auto begin = problem.points.begin(),
                 middle = begin + static_cast<std::ptrdiff_t>(problem.insertion);
      const bool is_used =
          std::any_of(is_withdrawal ? middle : begin, is_withdrawal ? problem.points.end() : middle,
                      [&](const CurveMean& used) { return used.depth_mm == point.depth_mm; });
      const double fitted = is_withdrawal ? withdrawal_N(at.parameters, point.depth_mm)
                                          : insertion_N(at.parameters, at.shape, point.depth_mm);
      fit.points.push_back({point.depth_mm, point.force_N, fitted, is_withdrawal, is_used});
      if (!is_used) continue;
      n += 1;
      squares += (point.force_N - fitted) * (point.force_N - fitted);
      total += (point.force_N - mean_N) * (point.force_N - mean_N);
    }
  fit.rms_N = std::sqrt(squares / std::max(n, 1.0));
  fit.explained = total > 0 ? 1 - squares / total : 0;
}

}  // namespace

Result<CurveFit> fit_curve(const ForceCurve& curve, double diameter_mm) {
  Result<RoughCurve> rough = rough_curve(curve);
  if (!rough) return rough.error();
  Problem problem = make_problem(*rough, diameter_mm);
  if (problem.points.size() < problem.insertion + 8) {  // too little of the withdrawal
    rough->withdrawal.clear();
    problem = make_problem(*rough, diameter_mm);
  }
  const Result<Estimate> estimate = choose(problem, *rough, diameter_mm);
  if (!estimate) return estimate.error();
  const CurveSolution& at = estimate->solution;
  const CurveParameters& p = at.parameters;
  CurveFit fit;
  set_points(problem, *rough, at, fit);
  if (!(fit.explained > kMinExplained))
    return refused(
        text_line("is not like an insertion: the fit explains %.0f %% of the force's variance only",
                  100 * std::max(fit.explained, 0.0)));
  const double travel_mm = rough->deepest_mm - p[kContact];
  const double elastic_mm = p[kCutting] / std::exp(p[kLogStiffness]);
  // A straight rise to the end is fitted as friction alone.
  if (p[kCutting] < kMinCutting * largest_N(problem, at) ||
      travel_mm - elastic_mm < std::max(0.2 * travel_mm, 10 * rough->spacing_mm))
    return refused(
        "the force still rises steeply at the end: nothing was cut; the tool must go deeper");

  fit.contact_mm = p[kContact];
  if (problem.resolves_rise) {
    const FittedValue log_stiffness = value_of(kLogStiffness, problem, *estimate);
    fit.stiffness_N_per_mm = {std::exp(log_stiffness.value), std::exp(log_stiffness.low),
                              std::exp(log_stiffness.high)};
  } else {
    fit.stiffness_N_per_mm = {std::exp(p[kLogStiffness]),
                              rise_of(*rough, at).least_stiffness_N_per_mm, HUGE_VAL};
  }
  fit.cutting_N = at_least_0(value_of(kCutting, problem, *estimate));
  fit.middle_mm = at.shape.middle_mm;
  fit.friction_N_per_mm = at_least_0(value_of(kFriction, problem, *estimate));
  if (!rough->withdrawal.empty()) fit.drift_N_per_mm = value_of(kDrift, problem, *estimate);
  if (at.shape.has_layer) {
    fit.layer_N = at_least_0(value_of(kLayerForce, problem, *estimate));
    fit.layer_mm = thickness_of(problem, *rough, *estimate);
  }
  fit.baseline_N = p[kBaseline];
  fit.structure_N = estimate->noise.structure_N;
  fit.correlation_mm = estimate->noise.integral_mm;
  fit.noise_N = rough->noise_N;
  return fit;
}

}  // namespace trocar::runtime
