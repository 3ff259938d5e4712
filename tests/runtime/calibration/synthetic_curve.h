// SPDX-License-Identifier: Apache-2.0
// Force-depth curves of tissues that are known, made without the code that fits them: the tool is moved in steps of
// 5 um, and in each step the front is advanced until the tip's force no longer exceeds the strength there.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "runtime/calibration/force_curve.h"

namespace trocar::runtime {

struct SyntheticTissue {
  double stiffness_N_per_mm = 300, cutting_N = 60, friction_N_per_mm = 2;
  double drift_N_per_mm = 0;  ///< begins at the surface, where the strength is cutting_N
  double layer_N = 0, layer_mm = 0;
};

enum class Structure : std::uint8_t { kKnots, kSmooth, kRough };

struct SyntheticMachine {
  double contact_mm = 2, travel_mm = 25, spacing_mm = 0.05;
  double baseline_N = 0.5, noise_N = 0.5;
  double structure = 0.05;  ///< relative standard deviation of strength or force
  Structure kind = Structure::kKnots;
  bool is_of_force = false;  ///< the structure is a factor on the force, not on the strength
  bool withdraws = false;
  double diameter_mm = 3;
};

/// A random function of depth with unit variance that is correlated over about 1 mm.
class RandomDepth {
 public:
  template <typename Random>
  RandomDepth(Structure kind, double length_mm, Random& random) {
    std::normal_distribution<double> normal;
    const auto n = static_cast<std::size_t>(length_mm / kStep_mm) + 2;
    values_.resize(n);
    if (kind == Structure::kKnots) {  // straight between independent values at each millimetre
      std::vector<double> knots(static_cast<std::size_t>(length_mm) + 3);
      for (double& knot : knots)
        knot = normal(random) / std::sqrt(2.0 / 3);
      for (std::size_t i = 0; i < n; ++i) {
        const double x = static_cast<double>(i) * kStep_mm;
        const auto k = static_cast<std::size_t>(x);
        values_[i] = knots[k] + (x - static_cast<double>(k)) * (knots[k + 1] - knots[k]);
      }
    } else if (kind == Structure::kRough) {  // an Ornstein-Uhlenbeck process of length 0.5 mm
      const double keep = std::exp(-kStep_mm / 0.5);
      values_[0] = normal(random);
      for (std::size_t i = 1; i < n; ++i)
        values_[i] = keep * values_[i - 1] + std::sqrt(1 - keep * keep) * normal(random);
    } else {  // white noise smoothed by a Gaussian of 0.35 mm
      const int half = static_cast<int>(1.2 / kStep_mm);
      std::vector<double> kernel, white(n + 2 * static_cast<std::size_t>(half));
      double squares = 0;
      for (int k = -half; k <= half; ++k) {
        kernel.push_back(std::exp(-0.5 * std::pow(k * kStep_mm / 0.35, 2)));
        squares += kernel.back() * kernel.back();
      }
      for (double& w : white)
        w = normal(random) / std::sqrt(squares);
      for (std::size_t i = 0; i < n; ++i)
        for (std::size_t k = 0; k < kernel.size(); ++k)
          values_[i] += kernel[k] * white[i + k];
    }
  }
  double operator()(double depth_mm) const {
    const auto i = static_cast<std::size_t>(std::max(depth_mm, 0.0) / kStep_mm);
    return values_[std::min(i, values_.size() - 1)];
  }

 private:
  static constexpr double kStep_mm = 0.02;
  std::vector<double> values_;
};

template <typename Random>
ForceCurve synthetic_curve(const SyntheticTissue& tissue, const SyntheticMachine& machine,
                           Random& random) {
  constexpr double kStep_mm = 0.005, kCutStep_mm = 0.001, kPresliding_mm = 0.2, kHold = 0.25;
  const RandomDepth strength(machine.kind, machine.travel_mm + 1, random),
      friction(machine.kind, machine.travel_mm + 1, random),
      back(machine.kind, machine.travel_mm + 1, random);
  std::normal_distribution<double> noise(0, machine.noise_N);
  std::uniform_real_distribution<double> phase(0, machine.spacing_mm);
  const double of_strength = machine.is_of_force ? 0 : machine.structure,
               of_force = machine.is_of_force ? machine.structure : 0;
  ForceCurve curve;
  double cut_mm = 0, shaft_N = 0, tip_N = 0, next_mm = phase(random);
  const double deepest_mm = machine.contact_mm + machine.travel_mm;
  for (int k = 0; k * kStep_mm < deepest_mm; ++k) {
    const double depth_mm = k * kStep_mm;
    const double u_mm = depth_mm - machine.contact_mm;
    for (;;) {
      const bool is_layer = cut_mm < tissue.layer_mm;
      const double nominal_N =
          is_layer ? tissue.layer_N : tissue.cutting_N + tissue.drift_N_per_mm * cut_mm;
      tip_N = tissue.stiffness_N_per_mm * std::max(u_mm - cut_mm, 0.0);
      if (tip_N <= nominal_N * (1 + of_strength * strength(cut_mm))) break;
      shaft_N += tissue.friction_N_per_mm * (1 + of_strength * friction(cut_mm)) * kCutStep_mm;
      cut_mm += kCutStep_mm;
    }
    if (depth_mm < next_mm) continue;
    next_mm += machine.spacing_mm;
    const double force_N = (tip_N + shaft_N) * (1 + of_force * strength(u_mm));
    curve.insertion.push_back({depth_mm, machine.baseline_N + force_N + noise(random)});
  }
  if (!machine.withdraws) return curve;
  const double first_mm = phase(random);
  for (int k = 0; first_mm + k * machine.spacing_mm < deepest_mm; ++k) {
    const double up_mm = first_mm + k * machine.spacing_mm;
    const double u_mm = machine.travel_mm - up_mm;
    const double elastic_N = tip_N - tissue.stiffness_N_per_mm * up_mm;
    const double hold_N = kHold * tissue.cutting_N * std::max(1 - up_mm / machine.diameter_mm, 0.0);
    const double slides = std::clamp(1 - 2 * up_mm / kPresliding_mm, -1.0, 1.0);
    const double force_N = std::max(elastic_N, -hold_N) + slides * tissue.friction_N_per_mm *
                                                              std::max(u_mm, 0.0) *
                                                              (1 + machine.structure * back(u_mm));
    curve.withdrawal.push_back(
        {machine.contact_mm + u_mm, machine.baseline_N + (u_mm > 0 ? force_N : 0) + noise(random)});
  }
  return curve;
}

}  // namespace trocar::runtime
