// SPDX-License-Identifier: Apache-2.0
// The estimator against its definition and a simulation in time, the rule for stiffness against the
// formula, and the guard on scripted motions.
#include "runtime/haptics/estimator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <deque>
#include <numbers>
#include <random>

#include "runtime/haptics/loop/guard.h"
#include "tests/support/uniform.h"

namespace trocar::runtime {
namespace {

using trocar::test::uniform;

Pose at(double z_m, double turn_rad = 0) {
  Pose T;
  T.p_m.z() = z_m;
  T.q = from_rotation_vector({0, 0, turn_rad});
  return T;
}

PoseEstimator both(const AxisEstimator& axis) {
  return {axis, axis};
}

TEST(Estimator, IsCriticallyDamped) {
  for (const double w : {100.0, 700.0, 2500.0, 1e9}) {
    const FilterGains g = filter_gains(w, 1e-3);
    // The poles are the roots of z^2 + (alpha + beta - 2) z + 1 - alpha.
    const double half = (2 - g.alpha - g.beta) / 2;
    EXPECT_NEAR(half * half, 1 - g.alpha, 1e-12) << w;
    EXPECT_NEAR(half, std::exp(-w * 1e-3), 1e-12) << w;
  }
}

// Also with readings that are missing now and then, and in rotation.
TEST(Estimator, FollowsASteadyMotionWithoutLag) {
  for (const double w : {200.0, 1000.0, 1e9}) {
    const PoseEstimator estimator = both({w, 1.5e-3});
    EstimatedPose estimate;
    std::mt19937_64 random(1);
    int last = 0;
    for (int k = 0; k < 400; ++k) {
      if (k > 0 && random() % 5 == 0) continue;
      estimate.follow(estimator, at(0.2 * k * 1e-3, 3 * k * 1e-3), (k - last) * 1e-3, 1e-3);
      last = k;
    }
    EXPECT_NEAR(estimate.pose().p_m.z(), 0.2 * last * 1e-3, 1e-9) << w;
    EXPECT_NEAR(estimate.twist_device()[2], 0.2, 1e-7) << w;
    EXPECT_NEAR(estimate.twist_device()[5], 3, 1e-6) << w;
    EXPECT_NEAR(estimate.ahead(estimator).p_m.z(), 0.2 * (last * 1e-3 + 1.5e-3), 1e-9) << w;
    EXPECT_NEAR(displacement(at(0, 3 * last * 1e-3), estimate.ahead(estimator))[5], 4.5e-3, 1e-8);
  }
}

TEST(Estimator, WithoutAFilterItIsTheReading) {
  EstimatedPose estimate;
  std::mt19937_64 random(2);
  double last_m = 0;
  for (int k = 0; k < 100; ++k) {
    const double z_m = uniform(random);
    const Pose reading = at(z_m, uniform(random));
    estimate.follow({}, reading, 1e-3, 1e-3);
    EXPECT_EQ(estimate.pose().p_m, reading.p_m);
    EXPECT_EQ(estimate.ahead({}).q.coeffs(), reading.q.coeffs());
    if (k > 0) {
      EXPECT_NEAR(estimate.twist_device()[2], (z_m - last_m) / 1e-3, 1e-9);
    }
    last_m = z_m;
  }
  estimate.reset();
  estimate.follow({}, at(1), 1e-3, 1e-3);
  EXPECT_EQ(estimate.twist_device(), Twist::Zero()) << "it begins at rest";
}

// At constant acceleration the twist is that of half a period before the reading, whatever the
// intervals.
TEST(Estimator, ALateReadingHasTheTwistOfOneOnTime) {
  EstimatedPose estimate;
  std::mt19937_64 random(8);
  double last_s = 0;
  for (int k = 0; k < 300; ++k) {
    const double interval_s = 1e-3 * static_cast<double>(1 + random() % 6),
                 t_s = last_s + interval_s;
    estimate.follow({}, at(4 * t_s * t_s), interval_s, 1e-3);
    last_s = t_s;
    if (k < 100) continue;  // it began at rest
    EXPECT_NEAR(estimate.twist_device()[2], 8 * (t_s - 0.5e-3), 1e-9) << k;
  }
}

// c and p by definition: led positions of white noise, and of one step of a reading.
TEST(Estimator, StepGainIsThatOfNoise) {
  for (const AxisEstimator axis : {AxisEstimator{}, AxisEstimator{700, 1e-3}, {2600, 9.5e-4}}) {
    const StepGain gain = step_gain(axis, 1e-3);
    std::mt19937_64 random(3);
    std::normal_distribution<double> noise;
    EstimatedPose estimate;
    double last = 0, sum = 0, speed = 0;
    constexpr int kTicks = 200'000;
    for (int k = 0; k < kTicks; ++k) {
      estimate.follow(both(axis), at(noise(random)), 1e-3, 1e-3);
      const double led = estimate.ahead(both(axis)).p_m.z();
      if (k > 0) sum += (led - last) * (led - last);
      last = led;
      speed += estimate.twist_device()[2] * estimate.twist_device()[2];
    }
    EXPECT_NEAR(std::sqrt(sum / kTicks), gain.rms, 0.02 * gain.rms);
    EXPECT_NEAR(std::sqrt(speed / kTicks), speed_noise(axis, 1e-3, {.noise_m = 1}),
                0.02 * std::sqrt(speed / kTicks));
    EstimatedPose stepped;
    stepped.follow(both(axis), at(0), 1e-3, 1e-3);
    stepped.follow(both(axis), at(1), 1e-3, 1e-3);
    EXPECT_NEAR(stepped.ahead(both(axis)).p_m.z(), gain.first, 1e-9);
  }
}

/// Work that a spring K at the led pose takes from an imposed sine, as a damping, N s/m.
double simulated_damping(const AxisEstimator& axis, double period_s, int delay_ticks, double K,
                         double frequency_Hz) {
  constexpr double kAmplitude_m = 1e-3;
  constexpr int kSubsteps = 200;
  const double w = 2 * std::numbers::pi * frequency_Hz;
  // Whole periods of the sine after it has settled.
  const int cycles = std::max(20, static_cast<int>(20 * frequency_Hz * period_s));
  const double settle_s = 1, end_s = settle_s + cycles / frequency_Hz;
  EstimatedPose estimate;
  std::deque<double> waiting(static_cast<std::size_t>(delay_ticks), 0.0);
  double work_J = 0;
  for (int k = 0; k * period_s < end_s; ++k) {
    const double t_s = k * period_s;
    estimate.follow(both(axis), at(kAmplitude_m * std::sin(w * t_s)), period_s, period_s);
    waiting.push_back(K * estimate.ahead(both(axis)).p_m.z());
    const double held_N = waiting.front();
    waiting.pop_front();
    for (int i = 0; i < kSubsteps; ++i) {
      const double at_s = t_s + (i + 0.5) * period_s / kSubsteps;
      if (at_s < settle_s || at_s >= end_s) continue;
      work_J += held_N * kAmplitude_m * w * std::cos(w * at_s) * period_s / kSubsteps;
    }
  }
  return work_J / (kAmplitude_m * kAmplitude_m * w * w / 2 * (end_s - settle_s));
}

TEST(Estimator, RendersTheDampingOfTheFormula) {
  for (const double period_s : {4e-3, 1e-3, 2.5e-4}) {
    for (const int delay : {0, 1}) {
      for (const AxisEstimator axis : {AxisEstimator{}, AxisEstimator{900, 1.2e-3}}) {
        for (const double frequency_Hz : {5.3, 17.1, 59.9}) {
          const double K = 5000,
                       formula = rendered_damping(axis, {period_s, delay * period_s}, {}, K, 0,
                                                  2 * std::numbers::pi * frequency_Hz);
          EXPECT_NEAR(simulated_damping(axis, period_s, delay, K, frequency_Hz), formula,
                      0.02 * K * (period_s + axis.lead_s))
              << period_s << " s, delay " << delay << ", " << frequency_Hz << " Hz";
        }
      }
    }
  }
}

struct DesignCase {
  LoopTiming timing;
  PlateAxis axis;
  double K;
};
std::vector<DesignCase> cases() {
  std::mt19937_64 random(5);
  std::vector<DesignCase> out;
  for (int i = 0; i < 60; ++i) {
    DesignCase c;
    c.timing.period_s = 1 / std::pow(2.0, 9 + 4 * uniform(random));
    c.timing.delay_s = static_cast<double>(random() % 2) * c.timing.period_s;
    c.axis = {0.1 + uniform(random), 3 * uniform(random), 2e-5 * uniform(random),
              1e-5 * uniform(random)};
    const double lag_s = c.timing.lag_s();
    c.K = std::pow(uniform(random), 3) * 0.1 * c.axis.mass_kg / (lag_s * lag_s);
    out.push_back(c);
  }
  return out;
}

double least_damping(const DesignCase& c, const AxisEstimator& axis, bool near_resonance = false) {
  const double resonant = 1.5 * std::sqrt(c.K / c.axis.mass_kg),
               highest = near_resonance ? resonant : std::max(2 * std::numbers::pi * 60, resonant);
  double least = 1e300;
  for (int i = 1; i <= 1000; ++i) {
    const double w = highest * i / 1000;
    if (w * c.timing.period_s > 3.1) break;
    least = std::min(least, rendered_damping(axis, c.timing, c.axis, c.K, 0, w));
  }
  return least;
}

// On a finer grid of frequencies, and against random estimators.
TEST(Estimator, TheDesignDampsAndIsTheQuietest) {
  int designed = 0, decaying = 0;
  std::mt19937_64 random(6);
  for (const DesignCase& c : cases()) {
    const auto axis = design_estimator(c.timing, c.axis, c.K);
    const double reserve = 0.1 * std::min(c.axis.damping_N_s_per_m, c.K * c.timing.lag_s());
    const double decay = 2 * 0.025 * std::sqrt(c.K * c.axis.mass_kg);
    if (axis) {
      EXPECT_GE(least_damping(c, *axis), reserve - 0.01 * c.K * c.timing.lag_s());
      decaying += least_damping(c, *axis, true) > 0.98 * decay;
      ++designed;
    }
    const double own_m =
        axis ? step_gain(*axis, c.timing.period_s).alternation_m(c.axis) : HUGE_VAL;
    for (int i = 0; i < 200; ++i) {
      const AxisEstimator other{60 * std::pow(4 / (60 * c.timing.period_s), uniform(random)),
                                4 * c.timing.lag_s() * uniform(random)};
      if (least_damping(c, other) < reserve || least_damping(c, other, true) < decay) continue;
      EXPECT_LT(own_m, 1.1 * step_gain(other, c.timing.period_s).alternation_m(c.axis));
    }
  }
  EXPECT_GT(designed, 40);
  EXPECT_GT(decaying, 0.6 * designed);  // the others' readings or rates do not allow it
}

TEST(Estimator, ExactReadingsGetTheLeastLead) {
  PlateAxis axis{0.35, 2, 0, 0};
  const LoopTiming timing{1e-3, 0};
  EXPECT_EQ(*design_estimator(timing, axis, 1000), AxisEstimator{}) << "K tau < b";
  const auto led = design_estimator(timing, axis, 20'000);
  ASSERT_TRUE(led);
  EXPECT_EQ(led->bandwidth_per_s, HUGE_VAL);
  const DesignCase c{timing, axis, 20'000};
  EXPECT_GT(led->lead_s, 0);
  EXPECT_LT(least_damping(c, {HUGE_VAL, 0.98 * led->lead_s}), 0.1 * 2) << "with less, too little";
}

// A damper of the tissue is a lead.
TEST(Estimator, ADamperOfTheTissueReplacesTheLead) {
  const PlateAxis axis{0.35, 0.5, 0, 0};
  const LoopTiming timing{1e-3, 0};
  const double lead_s = design_estimator(timing, axis, 5000)->lead_s;
  EXPECT_GT(lead_s, 0);
  EXPECT_NEAR(design_estimator(timing, axis, 5000, 5000 * lead_s / 2)->lead_s, lead_s / 2, 1e-6);
  EXPECT_EQ(design_estimator(timing, axis, 5000, 5000 * lead_s)->lead_s, 0);
}

TEST(Stiffness, IsTheRule) {
  for (const double mass_kg : {0.25, 1.2}) {
    for (const double rate_Hz : {1000.0, 4000.0}) {
      for (const int delay : {0, 1}) {
        const LoopTiming timing{1 / rate_Hz, delay / rate_Hz};
        const PlateAxis axis{mass_kg, 1, 0, 1e-6};
        const double lag_s = timing.lag_s();
        EXPECT_NEAR(stable_stiffness(timing, axis),
                    std::max(1 / lag_s, 0.1 * mass_kg / (lag_s * lag_s)), 1e-6)
            << rate_Hz << " Hz, " << delay;
      }
    }
  }
  // tau of 6 ms: no lead reaches 60 Hz, and only the device's own damping holds.
  EXPECT_LE(stable_stiffness({4e-3, 4e-3}, {0.3, 1, 0, 1e-6}), 1 / 6e-3 * (1 + 1e-9));
  EXPECT_EQ(stable_stiffness({4e-3, 4e-3}, {0.3, 0, 0, 1e-6}), 0);
}

TEST(Stiffness, AQuietOneAlternatesByWhatIsAllowed) {
  const LoopTiming timing{1e-3, 1e-3};
  for (const PlateAxis axis : {PlateAxis{0.3, 1, 2e-5, 1e-6}, {1.2, 2, 0, 38e-6}}) {
    const double K = quiet_stiffness(timing, axis, stable_stiffness(timing, axis));
    const auto alternation_N = [&](double k) {
      return k * step_gain(*design_estimator(timing, axis, k), 1e-3).alternation_m(axis);
    };
    EXPECT_LE(alternation_N(K), kQuiet_N);
    EXPECT_GT(alternation_N(K / 0.9), kQuiet_N);
  }
}

// --- the guard --------------------------------------------------------------------------------

/// Runs the guard on a velocity along z, with a force wherever `force_N` is not 0.
template <typename Velocity, typename Force>
GuardState guarded(double duration_s, Velocity&& velocity, Force&& force_N,
                   double band_m_per_s = 5e-3) {
  GuardState state;
  double last = 1;
  for (int k = 0; k * 1e-3 < duration_s; ++k) {
    GuardInput input;
    input.twist_device[2] = velocity(k * 1e-3);
    input.wrench_device[2] = force_N(k * 1e-3);
    input.band_m_per_s = band_m_per_s;
    guard_contact(input, state);
    EXPECT_GE(state.factor, last - kGuardFall_per_s * 1e-3 - 1e-12) << "it falls gradually";
    if (force_N(k * 1e-3) != 0) {
      EXPECT_LE(state.factor, last) << "it never rises in contact";
    }
    last = state.factor;
  }
  return state;
}

double touching(double) {
  return 5;
}

TEST(Guard, ActsOnAnOscillationThatDoesNotDecay) {
  const auto sine = [](double frequency_Hz, double growth_per_s) {
    return [=](double t_s) {
      return 0.02 * std::exp(growth_per_s * t_s) *
             std::sin(2 * std::numbers::pi * frequency_Hz * t_s);
    };
  };
  EXPECT_LT(guarded(0.5, sine(30, 0), touching).factor, 0.5);
  EXPECT_LT(guarded(0.5, sine(14, 0), touching).factor, 1);
  EXPECT_EQ(guarded(2, sine(11, 0), touching).acted, 0U) << "a hand's tremor";
  EXPECT_EQ(guarded(2, sine(30, -10), touching).acted, 0U) << "it decays";
  EXPECT_EQ(guarded(2, sine(30, 0), [](double) { return 0.0; }).acted, 0U) << "in the air";
  EXPECT_EQ(guarded(2, sine(30, 0), touching, 0.03).acted, 0U) << "noise";
  EXPECT_GE(guarded(60, sine(100, 0), touching).factor, kGuardLeast);
}

TEST(Guard, ActsOnTheSecondThrow) {
  // Comes at 0.2 m/s and leaves at `back` every `every_s`; touches for `touch_s` before it leaves.
  const auto acts = [](double back, double touch_s, double every_s) {
    const auto velocity = [=](double t_s) { return std::fmod(t_s, every_s) < 0.1 ? -0.2 : back; };
    const auto force_N = [=](double t_s) {
      const double at_s = std::fmod(t_s, every_s);
      return at_s > 0.11 - touch_s && at_s < 0.11 ? 5.0 : 0.0;
    };
    return guarded(2.3, velocity, force_N).acted;
  };
  EXPECT_EQ(acts(0.15, 0.02, 0.4), 0U);
  EXPECT_GE(acts(0.3, 0.02, 0.4), 1U);
  EXPECT_EQ(acts(0.3, 0.02, 0.8), 0U) << "a hand jerks back now and then";
  EXPECT_EQ(acts(0.3, 0.09, 0.4), 0U) << "a hand pulls back";
}

TEST(Guard, RestoresOnlyInFreeSpace) {
  const auto shaken = [](double t_s) { return t_s < 0.3 ? 0.02 * std::sin(200 * t_s) : 0; };
  const double low = guarded(5, shaken, touching).factor;
  EXPECT_LT(low, 1) << "in contact it stays";
  const auto leaves = [](double at_s) {
    return [=](double t_s) { return t_s < at_s ? 5.0 : 0.0; };
  };
  EXPECT_EQ(guarded(1.2, shaken, leaves(0.4)).factor, low);
  EXPECT_EQ(guarded(5, shaken, leaves(0.4)).factor, 1);
}

}  // namespace
}  // namespace trocar::runtime
