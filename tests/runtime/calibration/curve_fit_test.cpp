// SPDX-License-Identifier: Apache-2.0
#include "runtime/calibration/curve_fit.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "runtime/calibration/curve_points.h"
#include "tests/runtime/calibration/synthetic_curve.h"

namespace trocar::runtime {
namespace {

constexpr int kCurves = 200;
constexpr std::uint64_t kSeed = 11'000'000;

struct Case {
  SyntheticTissue tissue;
  SyntheticMachine machine;
  ForceCurve curve;
};

/// Every second curve has a hard layer; kinds of structure and withdrawals alternate more slowly, so that all combine.
/// Rough structure is in the force only: a strength that jumps within micrometres makes the front stick at its peaks,
/// so that its mean is not what any tool feels.
Case case_of(int k) {
  std::mt19937_64 random(kSeed + static_cast<std::uint64_t>(k));
  const auto within = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const auto log_within = [&](double low, double high) {
    return std::exp(within(std::log(low), std::log(high)));
  };
  Case out;
  SyntheticTissue& tissue = out.tissue;
  tissue.stiffness_N_per_mm = log_within(80, 800);
  tissue.cutting_N = within(20, 150);
  tissue.friction_N_per_mm = tissue.cutting_N * within(0.01, 0.06);
  tissue.drift_N_per_mm = tissue.cutting_N * within(-0.005, 0.02);
  if (k % 2 == 1) {
    tissue.layer_N = tissue.cutting_N * within(1.5, 3);
    tissue.layer_mm = within(0.5, 2.5);
  }
  SyntheticMachine& machine = out.machine;
  machine.contact_mm = within(1, 5);
  machine.travel_mm = within(15, 30);
  machine.spacing_mm = log_within(0.01, 0.2);
  machine.baseline_N = within(-2, 2);
  machine.noise_N = log_within(0.05, 2);
  machine.structure = within(0.02, 0.08);
  machine.kind = static_cast<Structure>(k / 2 % 3);
  machine.is_of_force = k / 6 % 2 == 1 || machine.kind == Structure::kRough;
  machine.withdraws = k / 12 % 2 == 1;
  out.curve = synthetic_curve(tissue, machine, random);
  return out;
}

struct Count {
  int inside = 0, all = 0;
};

TEST(CurveFit, IntervalsContainTheTruth) {
  std::map<std::string, Count> counts;
  const auto count = [&](const char* name, const FittedValue& fitted, double truth) {
    Count& each = counts[name];
    ++each.all;
    if (fitted.low <= truth && truth <= fitted.high) ++each.inside;
  };
  int layers = 0, found = 0, invented = 0, unresolved = 0, bounds = 0, needless = 0;
  for (int k = 0; k < kCurves; ++k) {
    const Case each = case_of(k);
    const SyntheticTissue& tissue = each.tissue;
    const Result<CurveFit> fit = fit_curve(each.curve, each.machine.diameter_mm);
    ASSERT_TRUE(fit) << k << ": " << fit.error().message;
    ASSERT_EQ(fit->drift_N_per_mm.has_value(), each.machine.withdraws) << k;
    if (std::isinf(fit->stiffness_N_per_mm.high)) {
      ++unresolved;
      // The curve has points enough for the stiffness while the force rises to 60 % of the first strength.
      const double first_N = tissue.layer_N > 0 ? tissue.layer_N : tissue.cutting_N;
      if (0.6 * first_N / tissue.stiffness_N_per_mm >= 4 * each.machine.spacing_mm) ++needless;
    }
    // A lower bound is no interval of 90 %: it must nearly always hold.
    if (std::isinf(fit->stiffness_N_per_mm.high))
      bounds += fit->stiffness_N_per_mm.low <= tissue.stiffness_N_per_mm ? 1 : 0;
    else
      count("stiffness", fit->stiffness_N_per_mm, tissue.stiffness_N_per_mm);
    // Without a withdrawal, the drift counts as friction, and the cutting force is that at the surface.
    if (each.machine.withdraws) {
      count("cutting", fit->cutting_N, tissue.cutting_N + tissue.drift_N_per_mm * fit->middle_mm);
      count("friction", fit->friction_N_per_mm, tissue.friction_N_per_mm);
      count("drift", *fit->drift_N_per_mm, tissue.drift_N_per_mm);
    } else {
      count("cutting", fit->cutting_N, tissue.cutting_N);
      count("friction", fit->friction_N_per_mm, tissue.friction_N_per_mm + tissue.drift_N_per_mm);
    }
    if (tissue.layer_N > 0) ++layers;
    if (fit->layer_N && tissue.layer_N > 0) {
      ++found;
      count("layer_N", *fit->layer_N, tissue.layer_N);
      count("layer_mm", *fit->layer_mm, tissue.layer_mm);
    } else if (fit->layer_N) {
      ++invented;
    }
  }
  for (const auto& [name, each] : counts) {
    const double part = static_cast<double>(each.inside) / each.all;
    std::printf("%s: %d of %d, %.1f %%\n", name.c_str(), each.inside, each.all, 100 * part);
    EXPECT_GE(part, 0.85) << name;
    EXPECT_LE(part, 0.95) << name;
  }
  std::printf("layers: %d of %d found, %d invented; %d stiffnesses with a lower bound only\n",
              found, layers, invented, unresolved);
  EXPECT_GE(found, 0.95 * layers);
  EXPECT_LE(invented, 0.05 * (kCurves - layers));
  EXPECT_GE(bounds, 0.95 * unresolved);
  EXPECT_LE(needless, 0.02 * kCurves);
}

TEST(CurveFit, ExactCurve) {
  SyntheticTissue tissue;
  tissue.layer_N = 120;
  tissue.layer_mm = 1;
  SyntheticMachine machine;
  machine.structure = 0;
  machine.noise_N = 0.01;
  machine.withdraws = true;
  std::mt19937_64 random(1);
  const Result<CurveFit> fit = fit_curve(synthetic_curve(tissue, machine, random), 3);
  ASSERT_TRUE(fit) << fit.error().message;
  EXPECT_NEAR(fit->contact_mm, 2, 0.02);
  EXPECT_NEAR(fit->stiffness_N_per_mm.value, 300, 6);
  EXPECT_NEAR(fit->cutting_N.value, 60, 0.5);
  EXPECT_NEAR(fit->friction_N_per_mm.value, 2, 0.02);
  EXPECT_NEAR(fit->drift_N_per_mm->value, 0, 0.02);
  ASSERT_TRUE(fit->layer_N);
  EXPECT_NEAR(fit->layer_N->value, 120, 1);
  EXPECT_NEAR(fit->layer_mm->value, 1, 0.08);
}

// A machine that states its depth in steps of 0.5 mm: the force rises among the samples of one step.
TEST(CurveFit, ManySamplesOfOneDepth) {
  std::mt19937_64 random(4);
  std::normal_distribution<double> noise(0, 0.02);
  ForceCurve curve;
  for (int step = 0; step <= 40; ++step) {
    for (int i = 0; i < 128; ++i) {
      const double depth_mm = 0.5 * step;
      double force_N = step < 10 ? 0 : 10 + 0.05 * (depth_mm - 5);
      if (step == 10) force_N = 10.0 * i / 127;
      curve.insertion.push_back({depth_mm, force_N + noise(random)});
    }
  }
  const std::vector<CurveMean> means = means_of(curve.insertion, 180, 0.02);
  for (std::size_t i = 1; i < means.size(); ++i)
    EXPECT_GT(means[i].depth_mm, means[i - 1].depth_mm);
  const Result<CurveFit> fit = fit_curve(curve, 3);
  ASSERT_TRUE(fit) << fit.error().message;
  EXPECT_NEAR(fit->cutting_N.value, 10, 0.5);
}

std::string refusal(const std::function<double(double)>& force_N, double noise_N = 0.01) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> noise(0, noise_N);
  ForceCurve curve;
  for (int i = 0; i < 400; ++i)
    curve.insertion.push_back({0.05 * i, force_N(0.05 * i) + noise(random)});
  const Result<CurveFit> fit = fit_curve(curve, 3);
  if (fit) return "accepted";
  EXPECT_EQ(fit.error().code, ExitCode::kRefused);
  return fit.error().message;
}

TEST(CurveFit, Refusals) {
  EXPECT_TRUE(refusal([](double) { return 0.0; }, 0.5)
                  .starts_with("no contact: the force never rises above its noise"));
  EXPECT_EQ(refusal([](double z) { return -std::min(20.0, 30 * std::max(z - 3, 0.0)); }),
            "the force never rises, it falls; force_N must be positive while the tissue resists "
            "the tool");
  EXPECT_TRUE(refusal([](double z) { return 80 + z; }).starts_with("begins with a force of 80"));
  EXPECT_TRUE(
      refusal([](double z) { return z > 19.5 ? 100 * (z - 19.5) : 0; }).starts_with("only "));
  EXPECT_EQ(refusal([](double z) { return 30 * std::max(z - 3, 0.0); }),
            "the force still rises steeply at the end: nothing was cut; the tool must go deeper");
}

}  // namespace
}  // namespace trocar::runtime
