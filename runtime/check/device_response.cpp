// SPDX-License-Identifier: Apache-2.0
#include "runtime/check/device_response.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace trocar::runtime {
namespace {

constexpr double kLeastMotion_m = 2e-4;
constexpr int kParameters = 4;
using Parameters = Eigen::Matrix<double, kParameters, 1>;  // log mass, damping, coulomb, delay

/// Positions of the model at the times of the samples.
std::vector<double> simulate(std::span<const ResponseSample> samples, const Parameters& p) {
  constexpr int kSubsteps = 20;
  const double mass_kg = std::exp(p[0]), damping = std::max(0.0, p[1]),
               coulomb_N = std::max(0.0, p[2]), delay_s = std::max(0.0, p[3]);
  std::vector<double> out{samples.front().position_m};
  double x = samples.front().position_m, v = 0;
  std::size_t commanded = 0;  // the command that acts
  for (std::size_t k = 1; k < samples.size(); ++k) {
    const double from_s = samples[k - 1].t_s, h_s = (samples[k].t_s - from_s) / kSubsteps;
    for (int i = 0; i < kSubsteps; ++i) {
      // The mean command in the substep, so that the position depends smoothly on the delay.
      const double begin_s = from_s + i * h_s - delay_s, end_s = begin_s + h_s;
      double force_N = 0;
      while (commanded + 1 < samples.size() && samples[commanded + 1].t_s <= begin_s)
        ++commanded;
      for (std::size_t c = commanded; c < samples.size() && samples[c].t_s < end_s; ++c) {
        const double until_s = c + 1 < samples.size() ? samples[c + 1].t_s : end_s;
        const double held_s = std::min(end_s, until_s) - std::max(begin_s, samples[c].t_s);
        force_N += samples[c].force_N * std::max(0.0, held_s) / h_s;
      }
      v = (v + h_s * force_N / mass_kg) / (1 + h_s * damping / mass_kg);
      const double dry = h_s * coulomb_N / mass_kg;
      v = v > dry ? v - dry : v < -dry ? v + dry : 0;
      x += h_s * v;
    }
    out.push_back(x);
  }
  return out;
}

double misfit2(std::span<const ResponseSample> samples, const std::vector<double>& model) {
  double sum = 0;
  for (std::size_t k = 0; k < samples.size(); ++k)
    sum += (samples[k].position_m - model[k]) * (samples[k].position_m - model[k]);
  return sum / static_cast<double>(samples.size());
}

/// Improves the parameters, and returns the mean of the squared misfits.
double improve(std::span<const ResponseSample> samples, Parameters& p) {
  constexpr int kRounds = 60;
  const Parameters step(1e-4, 1e-3, 1e-4, 1e-6);
  const Parameters unit(1, 1, 0.1, 1e-3);  // sizes of the parameters
  double damping = 1e-3;
  std::vector<double> model = simulate(samples, p);
  double best = misfit2(samples, model);
  for (int round = 0; round < kRounds; ++round) {
    Eigen::Matrix<double, kParameters, kParameters> A =
        Eigen::Matrix<double, kParameters, kParameters>::Zero();
    Parameters g = Parameters::Zero();
    std::array<std::vector<double>, kParameters> derivative;
    for (int i = 0; i < kParameters; ++i) {
      Parameters other = p;
      other[i] += step[i];
      derivative[static_cast<std::size_t>(i)] = simulate(samples, other);
    }
    for (std::size_t k = 0; k < samples.size(); ++k) {
      Parameters row;
      for (int i = 0; i < kParameters; ++i)
        row[i] = (derivative[static_cast<std::size_t>(i)][k] - model[k]) / step[i] * unit[i];
      A += row * row.transpose();
      g += row * (samples[k].position_m - model[k]);
    }
    for (int i = 0; i < kParameters; ++i)
      A(i, i) *= 1 + damping;
    A.diagonal().array() += 1e-30;
    Parameters next = p + unit.cwiseProduct(A.ldlt().solve(g));
    next.tail<3>() = next.tail<3>().cwiseMax(0.0);
    const std::vector<double> found = simulate(samples, next);
    const double now = misfit2(samples, found);
    if (now < best) {
      const bool is_settled = best - now < 1e-9 * best;
      p = next;
      best = now;
      model = found;
      damping = std::max(1e-9, damping / 4);
      if (is_settled) break;
    } else if ((damping *= 8) > 1e6) {
      break;
    }
  }
  return best;
}

}  // namespace

std::optional<DeviceResponse> fit_response(std::span<const ResponseSample> samples) {
  if (samples.size() < 20) return std::nullopt;
  const auto [low, high] =
      std::minmax_element(samples.begin(), samples.end(),
                          [](const auto& a, const auto& b) { return a.position_m < b.position_m; });
  const double range_m = high->position_m - low->position_m;
  if (!(range_m > kLeastMotion_m)) return std::nullopt;
  const double period_s = samples[1].t_s - samples[0].t_s;
  double best = HUGE_VAL;
  Parameters found = Parameters::Zero();
  for (const double mass_kg : {0.1, 0.4, 1.5}) {
    for (const double delay_ticks : {0.0, 1.5, 4.0}) {
      Parameters p(std::log(mass_kg), 1, 0.05, delay_ticks * period_s);
      const double misfit = improve(samples, p);
      if (!(misfit < best)) continue;
      best = misfit;
      found = p;
    }
  }
  constexpr double kWorst = 0.1;  // of the range: then it is no such device
  if (!(std::sqrt(best) < kWorst * range_m)) return std::nullopt;
  return DeviceResponse{std::exp(found[0]), found[1], found[2], found[3], std::sqrt(best)};
}

double ResponsePush::take(double position_m) noexcept {
  constexpr double kTurned_m = 2e-4;
  if (samples_.empty()) from_m_ = low_m_ = position_m;
  const double moved_m = position_m - from_m_, along_m = phase_ == kPushBack ? -moved_m : moved_m;
  low_m_ = std::min(low_m_, position_m);
  const bool is_late = since_s_ >= kLongest_s / 4 - period_s_ / 2;
  const bool is_far = phase_ == kPush || phase_ == kPushBack ? along_m > kFar_m
                      : phase_ == kBrake                     ? position_m > low_m_ + kTurned_m
                                                             : std::abs(moved_m) > kFar_m;
  if (is_late || is_far) {
    // A device that has come to rest needs no braking.
    phase_ = phase_ == kCoast && is_late ? kDone : Phase(phase_ + (phase_ != kDone ? 1 : 0));
    since_s_ = 0;
    from_m_ = low_m_ = position_m;
  }
  if (std::abs(moved_m) > kFarthest_m) phase_ = kDone;
  const double force_N = phase_ == kPush || phase_ == kBrake ? force_N_
                         : phase_ == kPushBack               ? -force_N_
                                                             : 0;
  if (samples_.size() < samples_.capacity()) samples_.push_back({t_s_, position_m, force_N});
  t_s_ += period_s_;
  since_s_ += period_s_;
  return force_N;
}

}  // namespace trocar::runtime
