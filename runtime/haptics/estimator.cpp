// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/estimator.h"

#include <algorithm>
#include <complex>
#include <numbers>

namespace trocar::runtime {
namespace {

using Complex = std::complex<double>;

constexpr double kLongestLag_s = 2.6e-3;
constexpr double kInertiaShare = 0.1;  // the first hand to shake was at 0.12
constexpr double kDampingReserve = 0.1;
/// Damping ratio of the plate on the spring: above that at which the guard (guard.h) acts, 0.016.
constexpr double kDampingRatio = 0.025, kNearResonance = 1.5;
/// 3.3 sigma are exceeded once in some thousand ticks.
constexpr double kQuietReserve = 0.95;
constexpr int kBandwidths = 40, kLeads = 41, kFrequencies = 120;
constexpr double kSlowest_per_s = 60, kFastest = 4, kMostLags = 4, kMostLead_s = 2e-3;

/// Real parts of (H_x, H_v) hold exp(-j w delay) / (j w).
struct Rendered {
  double position = 0, velocity = 0;
};
Rendered rendered(const FilterGains& gains, const LoopTiming& timing, double w) {
  const double T = timing.period_s;
  const Complex back = std::exp(Complex(0, -w * T));
  const Complex denominator =
      1.0 + (gains.alpha + gains.beta - 2) * back + (1 - gains.alpha) * back * back;
  const Complex held = (1.0 - back) / (Complex(0, w) * T) *
                       std::exp(Complex(0, -w * timing.delay_s)) / Complex(0, w) / denominator;
  return {((gains.alpha + (gains.beta - gains.alpha) * back) * held).real(),
          (gains.beta / T * (1.0 - back) * held).real()};
}

double highest_frequency(const PlateAxis& axis, double K_N_per_m) noexcept {
  return std::max(2 * std::numbers::pi * kHandMotion_Hz, 1.5 * std::sqrt(K_N_per_m / axis.mass_kg));
}

/// Steps of position and velocity in answer to a reading of 1 in one tick.
struct Impulse {
  double xx = 0, xv = 0, vv = 0;  ///< sums of products of the steps
  double v2 = 0;                  ///< sum of squares of the velocity
  double first_x = 0, first_v = 0;
};
Impulse impulse(const FilterGains& gains, double period_s) {
  constexpr int kTicks = 600;
  Impulse out{0, 0, 0, 0, gains.alpha, gains.beta / period_s};
  double x = 0, v = 0;
  for (int k = 0; k < kTicks; ++k) {
    const double predicted = x + period_s * v, error = (k == 0 ? 1 : 0) - predicted;
    const double next_x = predicted + gains.alpha * error;
    const double next_v = v + gains.beta / period_s * error;
    out.xx += (next_x - x) * (next_x - x);
    out.xv += (next_x - x) * (next_v - v);
    out.vv += (next_v - v) * (next_v - v);
    out.v2 += next_v * next_v;
    x = next_x;
    v = next_v;
  }
  return out;
}

StepGain step_gain(const Impulse& of, double lead_s) noexcept {
  return {std::sqrt(std::max(0.0, of.xx + lead_s * (2 * of.xv + lead_s * of.vv))),
          of.first_x + lead_s * of.first_v};
}

}  // namespace

StepGain step_gain(const AxisEstimator& estimator, double period_s) {
  return step_gain(impulse(filter_gains(estimator.bandwidth_per_s, period_s), period_s),
                   estimator.lead_s);
}

double speed_noise(const AxisEstimator& estimator, double period_s, const PlateAxis& axis) {
  const Impulse of = impulse(filter_gains(estimator.bandwidth_per_s, period_s), period_s);
  // Rounding to a step is like noise that is uniform over the step.
  return std::sqrt(of.v2 *
                   (axis.noise_m * axis.noise_m + axis.resolution_m * axis.resolution_m / 12));
}

double rendered_damping(const AxisEstimator& estimator, const LoopTiming& timing,
                        const PlateAxis& axis, double K_N_per_m, double tissue_N_s_per_m,
                        double w) {
  const Rendered r = rendered(filter_gains(estimator.bandwidth_per_s, timing.period_s), timing, w);
  return axis.damping_N_s_per_m + K_N_per_m * r.position +
         (K_N_per_m * estimator.lead_s + tissue_N_s_per_m) * r.velocity;
}

namespace {

/// design_estimator() with the oscillation of the plate on the spring decaying, or only not
/// growing.
std::optional<AxisEstimator> design(const LoopTiming& timing, const PlateAxis& axis,
                                    double K_N_per_m, double tissue_N_s_per_m, double quiet_N,
                                    bool decays) {
  const double T = timing.period_s, lag_s = timing.lag_s();
  const double reserve = kDampingReserve * std::min(axis.damping_N_s_per_m, K_N_per_m * lag_s);
  const double resonance = std::sqrt(K_N_per_m / axis.mass_kg),
               decay = 2 * kDampingRatio * std::sqrt(K_N_per_m * axis.mass_kg);
  const double highest = highest_frequency(axis, K_N_per_m);
  const bool is_exact = !(axis.noise_m > 0 || axis.resolution_m > 0);
  std::optional<AxisEstimator> best;
  double best_m = std::numeric_limits<double>::infinity();
  for (int i = kBandwidths; i >= (is_exact ? kBandwidths : 0); --i) {
    AxisEstimator candidate;
    if (i < kBandwidths)
      candidate.bandwidth_per_s =
          kSlowest_per_s * std::pow(kFastest / (T * kSlowest_per_s), i / (kBandwidths - 1.0));
    const FilterGains gains = filter_gains(candidate.bandwidth_per_s, T);
    // At each frequency the damping is linear in the lead: find the leads that suffice at all.
    double from_s = 0, to_s = std::max(kMostLags * lag_s, kMostLead_s);
    for (int k = 1; k <= kFrequencies; ++k) {
      const double w = highest * k / kFrequencies;
      if (w * T > 3.1) break;
      const bool is_near = decays && w < kNearResonance * resonance;
      const double least = is_near ? std::max(reserve, decay) : reserve;
      const Rendered r = rendered(gains, timing, w);
      const double missing =
          least - axis.damping_N_s_per_m - K_N_per_m * r.position - tissue_N_s_per_m * r.velocity;
      const double slope = K_N_per_m * r.velocity;
      if (slope > 0)
        from_s = std::max(from_s, missing / slope);
      else if (slope < 0)
        to_s = std::min(to_s, missing / slope);
      else if (missing > 0)
        to_s = -1;
    }
    if (!(from_s <= to_s)) continue;
    const Impulse steps = impulse(gains, T);
    for (int k = 0; k < kLeads; ++k) {
      candidate.lead_s = from_s + (to_s - from_s) * k / (kLeads - 1);
      const double all_s = candidate.lead_s + tissue_N_s_per_m / K_N_per_m;
      const double alternation_m = step_gain(steps, all_s).alternation_m(axis);
      if (!(alternation_m < best_m)) continue;
      best_m = alternation_m;
      best = candidate;
    }
    if (K_N_per_m * best_m <= quiet_N) break;  // the fastest that is quiet
  }
  return best;
}

}  // namespace

std::optional<AxisEstimator> design_estimator(const LoopTiming& timing, const PlateAxis& axis,
                                              double K_N_per_m, double tissue_N_s_per_m,
                                              double quiet_N) {
  if (!(K_N_per_m > 0)) return AxisEstimator{};
  const bool is_exact = !(axis.noise_m > 0 || axis.resolution_m > 0);
  const auto decaying =
      is_exact ? std::nullopt : design(timing, axis, K_N_per_m, tissue_N_s_per_m, quiet_N, true);
  return decaying ? decaying : design(timing, axis, K_N_per_m, tissue_N_s_per_m, quiet_N, false);
}

double stable_stiffness(const LoopTiming& timing, const PlateAxis& axis, double margin) {
  const double lag_s = timing.lag_s();
  double K = axis.damping_N_s_per_m / lag_s;
  if (lag_s <= kLongestLag_s)
    K = std::max(K, kInertiaShare * axis.mass_kg / margin / (lag_s * lag_s));
  constexpr double kStep = 0.98;
  for (int i = 0; i < 400 && K > 0; ++i, K *= kStep)
    if (design_estimator(timing, axis, K)) return K;
  return 0;
}

double quiet_stiffness(const LoopTiming& timing, const PlateAxis& axis, double most_N_per_m) {
  constexpr double kStep = 0.97;
  double K = most_N_per_m;
  for (int i = 0; i < 400 && K > 0; ++i, K *= kStep) {
    const auto estimator = design_estimator(timing, axis, K);
    if (estimator &&
        K * step_gain(*estimator, timing.period_s).alternation_m(axis) <= kQuietReserve * kQuiet_N)
      return K;
  }
  return 0;
}

void EstimatedPose::follow(const PoseEstimator& estimator, const Pose& T_device_plate,
                           double interval_s, double period_s) noexcept {
  if (!has_begun_) {
    has_begun_ = true;
    pose_ = T_device_plate;
    twist_.setZero();
    return;
  }
  const Pose predicted = moved(pose_, interval_s * twist_);
  const Twist error = displacement(predicted, T_device_plate);
  const FilterGains p = filter_gains(estimator.translation.bandwidth_per_s, interval_s),
                    r = filter_gains(estimator.rotation.bandwidth_per_s, interval_s);
  // The error is that of the mean twist, in the middle of the interval, and the last twist is that
  // of half a period before the last reading. Without a filter, too, a short interval counts
  // little.
  const double share = interval_s / period_s,
               late = share > 1 ? 2 * share / (share + 1) : std::min(1.0, 2 * share);
  const auto gain = [&](const FilterGains& gains) {
    return (share > 1 || gains.alpha == 1 ? late : 1) * gains.beta / interval_s;
  };
  twist_.head<3>() += gain(p) * error.head<3>();
  twist_.tail<3>() += gain(r) * error.tail<3>();
  // Without a filter the pose is the reading, to the last bit.
  pose_.p_m =
      p.alpha < 1 ? Eigen::Vector3d(predicted.p_m + p.alpha * error.head<3>()) : T_device_plate.p_m;
  pose_.q = r.alpha < 1
                ? (from_rotation_vector(r.alpha * error.tail<3>()) * predicted.q).normalized()
                : T_device_plate.q;
}

Pose EstimatedPose::ahead(const PoseEstimator& estimator) const noexcept {
  const double lead_s = estimator.translation.lead_s, turned_s = estimator.rotation.lead_s;
  Pose out = pose_;
  if (lead_s > 0) out.p_m += lead_s * twist_.head<3>();
  if (turned_s > 0)
    out.q = (from_rotation_vector(turned_s * twist_.tail<3>()) * out.q).normalized();
  return out;
}

}  // namespace trocar::runtime
