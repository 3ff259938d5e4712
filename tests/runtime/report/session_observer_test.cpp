// SPDX-License-Identifier: Apache-2.0
// Figures of made-up rows that real sessions have rarely; plunges that are continuous in the forces, and
// the damper after a break (break_through.h).
#include "runtime/report/session_observer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "runtime/haptics/loop/break_through.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/uniform.h"

namespace trocar::runtime {
namespace {

using trocar::test::uniform;

// Figures of made-up rows that real sessions have rarely.

constexpr double kObservedSheet_m = 0.12;
constexpr int kSlice = 3;

/// A tick in the state `running`. Slices below a tip that is beside them are not in bone.
ObservedTick tick(ContactPhase phase, double z_m) {
  ObservedTick made;
  made.row.safety = SafetyState::kRunning;
  made.row.phase = phase;
  made.row.active_slice = phase == ContactPhase::kFree ? -1 : kSlice;
  made.row.tool_m = {0, 0, z_m};
  return made;
}

ObservedTick stopped(SafetyState safety, Fault fault) {
  ObservedTick made = tick(ContactPhase::kFault, kObservedSheet_m);
  made.row.safety = safety;
  made.row.fault = fault;
  return made;
}

Scene scene_with_layer() {
  Scene scene = test::descent_scene({kObservedSheet_m}, 0.15, 0.1, 0.015);
  SceneLayer skin;
  skin.name = "skin";
  skin.top_z_m = 0.14;
  skin.thickness_m = 0.002;
  scene.layers = {skin};
  return scene;
}

/// Figures of a session of these ticks, at 1 kHz.
SessionFigures figures_of(const Scene& scene, std::vector<ObservedTick> ticks) {
  SessionObserver observer(scene, {{kSlice, kObservedSheet_m, ""}}, 1000);
  for (std::size_t i = 0; i < ticks.size(); ++i) {
    ticks[i].row.t_s = static_cast<double>(i) / 1000;
    observer.observe(ticks[i]);
  }
  return observer.figures();
}

TEST(SessionObserver, ATipThatMovesUpAsItTouchesTheBoneBeginsAnAttempt) {
  using enum ContactPhase;
  const SessionFigures found = figures_of(
      scene_with_layer(),
      {tick(kFree, 0.1201), tick(kFree, 0.12), tick(kContact, 0.12001), tick(kContact, 0.119),
       tick(kFree, 0.13), tick(kFree, 0.1199), tick(kContact, 0.11991), tick(kContact, 0.119)});
  ASSERT_EQ(found.attempts.count, 2U);
  EXPECT_EQ(found.attempts.list[0].from_s, 0.002);
  EXPECT_EQ(found.attempts.list[0].to_s, 0.003);
  EXPECT_EQ(found.attempts.list[1].from_s, 0.006);
  EXPECT_EQ(found.attempts.list[1].to_s, 0.007);
  // Also where slices are above the tip, beside which it has come down.
  EXPECT_EQ(figures_of(scene_with_layer(), {tick(kMissed, 0.1199), tick(kContact, 0.11991)})
                .attempts.count,
            1U);
}

TEST(SessionObserver, ATipThatIsDrawnBackIntoTheBoneFromBelowBeginsNone) {
  using enum ContactPhase;
  const std::vector<ObservedTick> back = {tick(kFree, 0.121),     tick(kContact, 0.119),
                                          tick(kPunctured, 0.11), tick(kMissed, 0.1),
                                          tick(kMissed, 0.105),   tick(kPunctured, 0.111)};
  const SessionFigures drawn_back = figures_of(scene_with_layer(), back);
  ASSERT_EQ(drawn_back.attempts.count, 1U);
  EXPECT_EQ(drawn_back.attempts.list[0].to_s, 0.005);
  std::vector<ObservedTick> onwards = back;
  onwards.back().row.tool_m[2] = 0.104;  // further down, into other bone
  EXPECT_EQ(figures_of(scene_with_layer(), onwards).attempts.count, 2U);
  // From a soft layer below the bone.
  std::vector<ObservedTick> from_layer = back;
  for (std::size_t i = 3; i < 5; ++i) {
    from_layer[i].row.phase = kContact;
    from_layer[i].row.active_slice = -1;
  }
  EXPECT_EQ(figures_of(scene_with_layer(), from_layer).attempts.count, 1U);
  from_layer.back().row.phase = kContact;  // bone that is not cut yet: the tip comes from above
  EXPECT_EQ(figures_of(scene_with_layer(), from_layer).attempts.count, 2U);
}

TEST(SessionObserver, WhatIsPuncturedInTheTickInWhichItIsReachedIsTheFirstContact) {
  using enum ContactPhase;
  Scene scene = scene_with_layer();
  scene.goals.emplace();
  scene.goals->time_max_s = 1;
  ObservedTick through_skin = tick(kFree, 0.1395), through_slice = tick(kPunctured, 0.119);
  through_skin.layers_punctured = 1;
  through_slice.punctured = 1;
  const std::vector<ObservedTick> slice = {tick(kFree, 0.121), through_slice,
                                           tick(kPunctured, 0.118)};
  std::vector<ObservedTick> skin = slice;
  skin[0] = through_skin;
  for (const auto& [ticks, first_s] : {std::pair{slice, 0.001}, std::pair{skin, 0.0}}) {
    const SessionFigures found = figures_of(scene, ticks);
    ASSERT_TRUE(found.first_contact_s && found.insertion_m && found.last_puncture_s);
    EXPECT_EQ(*found.first_contact_s, first_s);
    EXPECT_NEAR(*found.insertion_m, ticks[first_s > 0 ? 1 : 0].row.tool_m[2] - 0.118, 1e-12);
    ASSERT_EQ(found.goals.size(), 1U);
    ASSERT_TRUE(found.goals[0].value);
    EXPECT_EQ(*found.goals[0].value, 0.001 - first_s);
    EXPECT_TRUE(found.goals[0].met);
  }
}

TEST(SessionObserver, ATargetThatIsReachedBeforeTheFirstContactTakesNoTime) {
  using enum ContactPhase;
  Scene scene = scene_with_layer();
  scene.goals.emplace();
  scene.goals->time_max_s = 1;
  scene.goals->target = GoalTarget{{0, 0, 0.121}, 0.002};
  const SessionFigures found = figures_of(
      scene, {tick(kFree, 0.15), tick(kFree, 0.1215), tick(kFree, 0.1205), tick(kContact, 0.1195)});
  ASSERT_EQ(found.goals.size(), 2U);
  EXPECT_EQ(found.goals[1].goal, "time");
  ASSERT_TRUE(found.goals[1].value);
  EXPECT_EQ(*found.goals[1].value, 0);
}

TEST(SessionObserver, AnEmergencyStopDuringTheRecoveryFromAnotherOneIsAnotherFault) {
  const ObservedTick free = tick(ContactPhase::kFree, 0.13);
  const auto stop = stopped(SafetyState::kFault, Fault::kEmergencyStop),
             recovering = stopped(SafetyState::kRecovering, Fault::kEmergencyStop);
  const SessionFigures found = figures_of(
      scene_with_layer(), {free, stop, stop, recovering, recovering, stop, recovering, free});
  ASSERT_EQ(found.faults.count, 2U);
  EXPECT_EQ(found.faults.list[0].t_s, 0.001);
  EXPECT_FALSE(found.faults.list[0].recovered_s);
  EXPECT_EQ(found.faults.list[1].t_s, 0.005);
  ASSERT_TRUE(found.faults.list[1].recovered_s);
  EXPECT_EQ(*found.faults.list[1].recovered_s, 0.007);
  // A refused request is no fault, a second press is one.
  ObservedTick asked = stop, pressed = stop;
  asked.row.recovery_asked = 1;
  EXPECT_EQ(figures_of(scene_with_layer(), {free, stop, asked, stop, recovering}).faults.count, 1U);
  pressed.row.device_read = DeviceStatus::kEmergencyStop;
  EXPECT_EQ(figures_of(scene_with_layer(), {free, pressed, pressed, stop, pressed}).faults.count,
            2U);
}

TEST(SessionObserver, GoalsThatWereNeverTriedAreNotMet) {
  using enum ContactPhase;
  Scene scene = scene_with_layer();
  SceneGoals& goals = scene.goals.emplace();
  goals.force_max_N = 30;
  goals.time_max_s = 5;
  goals.plunge_max_m = 0.002;
  goals.target = GoalTarget{{0, 0, 0.11}, 0.002};
  goals.line = PlannedLine{};
  goals.line->entry_m = {0, 0, 0.14};
  goals.line->direction = {0, 0, -1};
  goals.line->entry_radius_m = goals.line->corridor_m = 0.01;
  ForbiddenZone& zone = goals.zones.emplace_back();
  zone.name = "canal";
  zone.low_m = zone.high_m = {0.05, 0, 0.1};
  zone.radius_m = 0.001;
  const SessionFigures idle = figures_of(scene, {tick(kFree, 0.13), tick(kFree, 0.13)});
  ASSERT_EQ(idle.goals.size(), 7U);
  for (const GoalResult& goal : idle.goals)
    EXPECT_FALSE(goal.attempted || goal.met) << goal.goal;
  // Touched, and nothing broken through.
  const SessionFigures touched = figures_of(scene, {tick(kFree, 0.13), tick(kContact, 0.1195)});
  for (const GoalResult& goal : touched.goals) {
    EXPECT_EQ(goal.attempted, goal.goal != "plunge") << goal.goal;
    EXPECT_EQ(goal.met, goal.attempted && goal.goal != "target" && goal.goal != "time")
        << goal.goal;
  }
}

TEST(SessionObserver, AirAboveTheBoneIsNoMiss) {
  using enum ContactPhase;
  const std::vector<ObservedTick> in_air = {tick(kFree, 0.125), tick(kMissed, 0.119),
                                            tick(kMissed, 0.118), tick(kContact, 0.117)};
  EXPECT_EQ(figures_of(scene_with_layer(), in_air).misses.count, 0U);
  std::vector<ObservedTick> aside = in_air;
  aside.push_back(tick(kMissed, 0.116));
  const SessionFigures found = figures_of(scene_with_layer(), aside);
  EXPECT_EQ(found.misses.count, 1U);
  EXPECT_EQ(found.missed_ticks, 1U);
  // Out again, and down beside the bone: known at the end, or when the tip is above all of it again.
  aside.push_back(tick(kFree, 0.122));
  aside.push_back(tick(kMissed, 0.119));
  EXPECT_EQ(figures_of(scene_with_layer(), aside).misses.count, 2U);
  aside.push_back(tick(kFree, 0.122));
  aside.push_back(tick(kMissed, 0.119));
  aside.push_back(tick(kContact, 0.117));
  const SessionFigures both = figures_of(scene_with_layer(), aside);
  EXPECT_EQ(both.misses.count, 2U);
  EXPECT_EQ(both.missed_ticks, 2U);
}

TEST(SessionObserver, TremorIsAcrossTheNeedle) {
  // 8 Hz and 0.1 mm, along the needle, which is tilted by 20 deg, and across it.
  const double tilt_rad = 20 * M_PI / 180;
  for (const bool is_across : {false, true}) {
    std::vector<ObservedTick> ticks;
    for (int k = 0; k < 3000; ++k) {
      ObservedTick made = tick(ContactPhase::kContact, 0.11);
      made.row.q = {std::cos(tilt_rad / 2), 0, std::sin(tilt_rad / 2), 0};
      const double step_m = 1e-4 * std::sin(2 * M_PI * 8 * k / 1000) - 1e-6 * k;
      const double angle_rad = is_across ? tilt_rad + M_PI / 2 : tilt_rad;
      made.row.tool_m = {step_m * std::sin(angle_rad), 0, 0.11 + step_m * std::cos(angle_rad)};
      ticks.push_back(made);
    }
    const Tremor tremor = figures_of(scene_with_layer(), ticks).tremor_contact;
    const double rms_m = std::sqrt(tremor.squares_m2 / static_cast<double>(tremor.ticks));
    if (is_across) {
      EXPECT_NEAR(rms_m, 1e-4 / std::sqrt(2), 2e-5);
    } else {
      EXPECT_LT(rms_m, 1e-9);
    }
  }
}

// The laws of break_through.h: plunges that are continuous in the forces, and the damper after a break.

// The laws of runtime/haptics/loop/break_through.h, and plunges that are continuous in the forces.

constexpr double kBrokenSheet_m = 0.12;

/// What a tick meets: force on the tip, depth of the tip, and a sheet that is punctured in it.
struct Met {
  double force_N = 0, depth_m = 0;
  bool passes_slice = false, releases = false;
  /// Of a tip fixed to the plate; none: depth_m.
  std::optional<double> hand_depth_m = std::nullopt;
  bool is_running = true;
};

/// A session in `running`, of so many ticks at this rate, along a shaft that is tilted by 20 deg.
SessionFigures figures_of(int ticks, double rate_Hz, const std::function<Met(double t_s)>& met) {
  const Scene scene = test::descent_scene({kBrokenSheet_m}, 0.15, 0.1, 0.015);
  SessionObserver observer(scene, {{0, kBrokenSheet_m, ""}}, rate_Hz);
  BreakThroughState state;
  const Eigen::Vector3d inward(std::sin(0.35), 0, -std::cos(0.35));
  double last_N = 0;
  for (int k = 0; k < ticks; ++k) {
    const Met now = met(k / rate_Hz);
    ContactOutput contact;
    contact.force_N = now.force_N;
    contact.force_before_N = last_N;
    contact.punctured_now = now.passes_slice || now.releases;
    contact.cut.sheet = 0;
    contact.is_released = now.releases;
    contact.active_sheet = 0;
    last_N = now.force_N;
    ObservedTick tick;
    tick.row.t_s = k / rate_Hz;
    tick.row.safety = now.is_running ? SafetyState::kRunning : SafetyState::kFault;
    tick.row.phase = now.force_N > 0 ? ContactPhase::kContact : ContactPhase::kPunctured;
    tick.row.active_slice = 0;
    const Eigen::Vector3d top_m(0, 0, kBrokenSheet_m), tip_m = top_m + now.depth_m * inward;
    const Eigen::Vector3d plate_tip_m = top_m + now.hand_depth_m.value_or(now.depth_m) * inward;
    tick.row.tool_m = {tip_m.x(), tip_m.y(), tip_m.z()};
    if (now.is_running) {
      tick.break_through =
          find_break_through({1 / rate_Hz, tip_m, plate_tip_m, inward, contact}, state);
    } else {
      state = {};
    }
    observer.observe(tick);
  }
  return observer.figures();
}

/// Presses 48.27 N for a second at 7 mm/s; the force then falls to a part of that over some ticks.
SessionFigures dive(double part, int fall_ticks, double rate_Hz = 1000) {
  return figures_of(static_cast<int>(2 * rate_Hz), rate_Hz, [=](double t_s) {
    const double fallen = std::clamp(((t_s - 1) * rate_Hz + 1) / fall_ticks, 0.0, 1.0);
    return Met{48.27 * std::min(1.0, 5 * t_s) * (1 - fallen * (1 - part)), 7e-3 * t_s, false,
               false};
  });
}

TEST(BreakThrough, TwoDivesThatDifferByOnePercentHaveTheSamePlunge) {
  double last_m = 0;
  for (int n = 0; n < 110; ++n) {
    const double part = 0.25 * std::pow(1.01, n);
    const double plunge_m = dive(part, 1).plunge_max_m;
    if (last_m > 0) {
      EXPECT_NEAR(plunge_m / last_m, 1, 0.1) << part;
    }
    EXPECT_NEAR(dive(part, 2).plunge_max_m / plunge_m, 1, 0.1) << part << ": over two ticks";
    last_m = plunge_m;
  }
  // 48.27 to 24.08 N in a tick, 48.28 to 24.43 N over two.
  EXPECT_NEAR(dive(24.08 / 48.27, 1).plunge_max_m / dive(24.43 / 48.28, 2).plunge_max_m, 1, 0.1);
}

TEST(BreakThrough, ThePlungeIsTheWayThatTheTipRunsOn) {
  for (const double rate_Hz : {500.0, 1000.0, 8000.0}) {
    const SessionFigures found = dive(0, 1, rate_Hz);
    ASSERT_EQ(found.break_throughs.count, 1U) << rate_Hz;
    const BreakThrough& made = found.break_throughs.list[0];
    EXPECT_NEAR(made.t_s, 1, 0.006) << rate_Hz;
    EXPECT_NEAR(made.plunge_m, 7e-3 * kPlunge_s, 2e-4) << rate_Hz;
    EXPECT_NEAR(made.hand_m, made.plunge_m, 1e-9) << "no coupling";
    EXPECT_NEAR(made.tip_N, 48.27, 0.5);
    EXPECT_EQ(made.ended_by, PlungeEnd::kTime);
  }
}

TEST(BreakThrough, TheHandsPartOfAPlungeIsItsOwnWay) {
  // The spring of the coupling lets go over 5 ms: the tip runs 1 mm ahead of the hand.
  const SessionFigures found = figures_of(2000, 1000, [](double t_s) {
    const double ahead_m = 1e-3 * std::clamp((t_s - 1) / 5e-3, 0.0, 1.0);
    return Met{t_s < 1 ? 48.0 : 0, 7e-3 * t_s + ahead_m, false, false, 7e-3 * t_s};
  });
  ASSERT_EQ(found.break_throughs.count, 1U);
  EXPECT_NEAR(found.break_throughs.list[0].plunge_m, 7e-3 * kPlunge_s + 1e-3, 2e-4);
  EXPECT_NEAR(found.break_throughs.list[0].hand_m, 7e-3 * kPlunge_s, 2e-4);
}

TEST(BreakThrough, APlungeEndsWhenTheTipComesBackOrForcesAreZeroed) {
  // Through at 1 s, and back from 1.2 s on; or a fault at 1.3 s.
  const auto dive_until = [](double back_s, double fault_s) {
    return figures_of(2000, 1000, [=](double t_s) {
      return Met{t_s < 1 ? 48.0 : 0,
                 7e-3 * (t_s < back_s ? t_s : 2 * back_s - t_s),
                 false,
                 false,
                 std::nullopt,
                 t_s < fault_s};
    });
  };
  const SessionFigures back = dive_until(1.2, 3), faulty = dive_until(3, 1.3);
  ASSERT_EQ(back.break_throughs.count, 1U);
  EXPECT_EQ(back.break_throughs.list[0].ended_by, PlungeEnd::kReversed);
  EXPECT_NEAR(back.break_throughs.list[0].plunge_m, 7e-3 * 0.2, 5e-5);
  ASSERT_EQ(faulty.break_throughs.count, 1U);
  EXPECT_EQ(faulty.break_throughs.list[0].ended_by, PlungeEnd::kFault);
  EXPECT_NEAR(faulty.break_throughs.list[0].plunge_m, 7e-3 * 0.3, 5e-5);
  EXPECT_NEAR(faulty.break_throughs.list[0].ended_t_s, 1.3, 2e-3);
}

// The spring of hand and coupling throws the tip forwards, further than the reference reaches.
TEST(BreakThrough, AJumpOfTheTipIsOneBreakThroughAtAllRates) {
  for (const double rate_Hz : {500.0, 1000.0, 4000.0, 8000.0}) {
    for (const double jump_m : {0.5e-3, 3e-3, 8e-3}) {
      for (const double left : {0.0, 0.1, 0.4}) {
        const SessionFigures found =
            figures_of(static_cast<int>(2 * rate_Hz), rate_Hz, [=](double t_s) {
              const double done = std::clamp((t_s - 1) / 4e-3, 0.0, 1.0);
              return Met{100 * std::min(1.0, 5 * t_s) * (t_s < 1 ? 1 : left),
                         7e-3 * t_s + jump_m * done};
            });
        ASSERT_EQ(found.break_throughs.count, 1U)
            << rate_Hz << " Hz, " << jump_m << " m, " << left << " left";
        EXPECT_NEAR(found.break_throughs.list[0].tip_N, 100, 3) << rate_Hz << ' ' << jump_m;
        EXPECT_NEAR(found.break_throughs.list[0].t_s, 1, 0.03) << rate_Hz << ' ' << jump_m;
      }
    }
  }
}

TEST(BreakThrough, SlicesOfEqualBoneAreNone) {
  // A slice every 0.83 s, of constant 24 N with the loop's noise; the far side after 10 s.
  int tick = 0;
  const SessionFigures found = figures_of(11'000, 1000, [&tick](double t_s) {
    const bool is_in = t_s < 10;
    const bool passes = is_in && std::fmod(t_s, 0.83) < 0.0005 && t_s > 0.5;
    const double noise_N = ++tick % 2 == 0 ? 3 : -3;
    return Met{is_in ? 24 * std::min(1.0, 10 * t_s) + (t_s > 0.2 ? noise_N : 0) : 0, 1e-3 * t_s,
               passes, false};
  });
  ASSERT_EQ(found.break_throughs.count, 1U);
  EXPECT_NEAR(found.break_throughs.list[0].t_s, 10, 0.05);
}

TEST(BreakThrough, NeitherUnloadingNorPressingAgainIsOne) {
  const SessionFigures found = figures_of(8000, 1000, [](double t_s) {
    const double load = std::abs(std::sin(3 * t_s));  // elastic: 0.3 mm at 40 N, once 2 mm back
    const double back_m = t_s > 4 && t_s < 5 ? -2e-3 * std::sin(M_PI * (t_s - 4)) : 0;
    return Met{back_m < 0 ? 0 : 40 * load, 3e-4 * load + back_m, false, false};
  });
  EXPECT_EQ(found.break_throughs.count, 0U);
  EXPECT_LT(found.plunge_max_m, 2e-5);
}

TEST(BreakThrough, AFallInStepsIsOne) {
  const SessionFigures found = figures_of(3000, 1000, [](double t_s) {
    const double depth_m = 5e-3 * t_s;
    const double fallen = std::clamp((depth_m - 5e-3) / 1.2e-3, 0.0, 1.0);
    return Met{48 * std::min(1.0, 10 * t_s) * (1 - std::floor(4 * fallen) / 4), depth_m, false,
               false};
  });
  EXPECT_EQ(found.break_throughs.count, 1U);
}

TEST(BreakThrough, ForcesLikeNoiseAreNone) {
  const SessionFigures found = figures_of(3000, 1000, [](double t_s) {
    return Met{std::fmod(t_s, 0.2) < 0.1 ? 0.8 : 0.0, 10e-3 * t_s, false, false};
  });
  EXPECT_EQ(found.break_throughs.count, 0U);
}

TEST(BreakThrough, EachPunctureOfASheetIsOne) {
  // Sheets of 5 N, 2 mm apart; the next bears at once. The proxy jumps by 1 mm at each.
  const SessionFigures found = figures_of(2000, 1000, [](double t_s) {
    const auto tick = std::lround(1000 * t_s);
    const auto sheet = tick / 400;
    const auto in_s = static_cast<double>(tick % 400) / 1000;
    return Met{5 * in_s / 0.4, 5e-3 * t_s + 1e-3 * static_cast<double>(sheet), false,
               tick >= 400 && tick % 400 == 0};
  });
  ASSERT_EQ(found.break_throughs.count, 4U);
  for (const BreakThrough& made : found.break_throughs.list) {
    EXPECT_NEAR(made.tip_N, 5, 0.05);
    EXPECT_GT(made.plunge_m, 1e-3) << "the jump";
  }
}

// The damper after a break, on random motions and on a point mass that coasts.

constexpr double kMass_kg = 0.35;

Tool tool_with_offset() {
  Tool tool;
  tool.tip_plate_m = {0.01, -0.02, -0.1};
  return tool;
}

TEST(BreakDamper, OnlyTakesEnergyAndActsAtTheTipAlongTheShaft) {
  std::mt19937_64 random(2);
  const Tool tool = tool_with_offset();
  const auto around_zero = [&] { return uniform(random) - 0.5; };
  BreakDamperState state;
  BreakInput input;
  int pushed = 0;
  for (int i = 0; i < 20'000; ++i) {
    Pose& plate = input.T_device_plate;
    plate.q =
        (from_rotation_vector(1e-3 * Eigen::Vector3d(around_zero(), around_zero(), around_zero())) *
         plate.q)
            .normalized();
    for (int k = 0; k < 6; ++k)
      input.twist_device[k] = (k < 3 ? 0.1 : 1) * around_zero();
    input.lost_force_N = i % 50 == 0 ? 60 * uniform(random) : 0;
    const Wrench wrench = damp_break(kMass_kg, tool, input, state);
    const Eigen::Vector3d lever_m = plate.q * tool.tip_plate_m, up = plate.q * tool.axis_plate,
                          force_N = wrench.head<3>(), moment_Nm = lever_m.cross(force_N);
    ASSERT_NEAR(force_N.cross(up).norm(), 0, 1e-12);
    ASSERT_NEAR((Eigen::Vector3d(wrench.tail<3>()) - moment_Nm).norm(), 0, 1e-12);
    const Eigen::Vector3d linear = input.twist_device.head<3>(),
                          turning = input.twist_device.tail<3>();
    const double inward = -up.dot(linear + turning.cross(lever_m));
    if (inward <= 0) {
      ASSERT_EQ(wrench, Wrench::Zero()) << i;
      continue;
    }
    ASSERT_GE(force_N.dot(up), 0);
    ASSERT_LE(force_N.dot(up), damping_max(kMass_kg, 1e-3) * inward + 1e-9);
    pushed += force_N.dot(up) > 0;
  }
  EXPECT_GT(pushed, 5000);
}

TEST(BreakDamper, TheCoefficientFallsWithTheSquareOfTimeAndALaterBreakOnlyRaisesIt) {
  BreakDamperState state;
  BreakInput input;
  input.twist_device[2] = -0.1;
  const auto coefficient_after = [&](double lost_N) {
    input.lost_force_N = lost_N;
    return damp_break(kMass_kg, Tool(), input, state)[2] / 0.1;
  };
  EXPECT_EQ(coefficient_after(0), 0);
  const double start_N_s_per_m = 30 / kBreakSpeed_m_per_s;
  EXPECT_NEAR(coefficient_after(30), start_N_s_per_m, 1e-9) << "from the tick of the break on";
  for (int k = 1; k < 50; ++k)
    ASSERT_NEAR(coefficient_after(0),
                start_N_s_per_m * (1 - std::pow(k * 1e-3 / kBreakDamping_s, 2)), 1e-9);
  // Three quarters of 30 N are left, so 20 N change nothing.
  EXPECT_NEAR(coefficient_after(20), start_N_s_per_m * 0.75, 1e-9);
  EXPECT_NEAR(coefficient_after(25), 25 / kBreakSpeed_m_per_s, 1e-9);
  for (int k = 0; k < 99; ++k)
    EXPECT_GT(coefficient_after(0), 0);
  EXPECT_NEAR(coefficient_after(0), 0, 1e-9);
}

// Stamps that are off do not reach it: its speed is that of the estimator. Noise and jumps of a
// tenth of a millimetre do.
TEST(BreakDamper, WhateverTheSpeedsTheForceIsAtMostTheLostForceAndStepsByAFifthOfIt) {
  std::mt19937_64 random(3);
  for (const double speed_m_per_s : {0.05, 0.3, 1.0, 4.0}) {
    for (const double bandwidth_per_s : {300.0, 1000.0, 1e9}) {
      const PoseEstimator estimator{{bandwidth_per_s, 1e-3}, {bandwidth_per_s, 1e-3}};
      EstimatedPose estimate;
      BreakDamperState state;
      double before_N = 0, max_N = 0;
      constexpr double kLost_N = 10;
      for (int k = 1; k <= 300; ++k) {
        BreakInput input;
        // Now and then the tip turns back, or a reading is off by 0.1 mm.
        const double noise_m = k % 23 == 0 ? 1e-4 * (2 * uniform(random) - 1) : 0;
        const double way_m = 1e-3 * speed_m_per_s * k;
        input.T_device_plate.p_m.z() = (k / 30 == 2 ? way_m : -way_m) + noise_m;
        estimate.follow(estimator, input.T_device_plate, 1e-3, 1e-3);
        input.twist_device = estimate.twist_device();
        input.lost_force_N = k == 20 ? kLost_N : 0;
        const double now_N = damp_break(kMass_kg, Tool(), input, state)[2];
        ASSERT_GE(now_N, 0);
        ASSERT_LE(now_N, kLost_N) << speed_m_per_s << " m/s, tick " << k;
        ASSERT_LE(std::abs(now_N - before_N), kLost_N / 5 + 1e-9)
            << speed_m_per_s << " m/s, tick " << k;
        before_N = now_N;
        max_N = std::max(max_N, now_N);
      }
      EXPECT_GT(max_N, 0.5 * kLost_N * std::min(1.0, speed_m_per_s / kBreakSpeed_m_per_s));
      EXPECT_EQ(before_N, 0) << "after its time it is zero";
    }
  }
}

// A plate that coasts freely goes as far as the exact solution of m dv/dt = -b(t) v says, up to the
// way of a tick and a half (the delay of sampling), and never turns back.
TEST(BreakDamper, StopsAPlateThatCoastsWithoutTurningItBack) {
  constexpr double kLost_N = 30, kSpeed_m_per_s = 0.2;
  constexpr double kRate_per_s = kLost_N / kBreakSpeed_m_per_s / kMass_kg;
  double exact_m = 0;
  constexpr int kSteps = 10'000;
  for (int i = 0; i < kSteps; ++i) {
    const double t_s = (i + 0.5) / kSteps * kBreakDamping_s;
    exact_m += kBreakDamping_s / kSteps * kSpeed_m_per_s *
               std::exp(-kRate_per_s * (t_s - std::pow(t_s, 3) / 3 / std::pow(kBreakDamping_s, 2)));
  }
  for (const double rate_Hz : {250.0, 500.0, 1000.0, 8000.0}) {
    BreakDamperState state;
    BreakInput input{.interval_s = 1 / rate_Hz, .lost_force_N = kLost_N};
    double z_m = 0, v_m_per_s = -kSpeed_m_per_s, last_m = kSpeed_m_per_s / rate_Hz;
    for (int i = 0; i < std::lround(kBreakDamping_s * rate_Hz); ++i) {
      input.twist_device[2] = (z_m - std::exchange(last_m, z_m)) * rate_Hz;
      const double a = damp_break(kMass_kg, Tool(), input, state)[2] / kMass_kg;
      input.lost_force_N = 0;
      z_m += v_m_per_s / rate_Hz + 0.5 * a / (rate_Hz * rate_Hz);
      v_m_per_s += a / rate_Hz;
      ASSERT_LE(v_m_per_s, 1e-12) << rate_Hz;
    }
    EXPECT_NEAR(-z_m, exact_m, 0.01 * exact_m + 1.5 / rate_Hz * kSpeed_m_per_s) << rate_Hz;
    EXPECT_GT(v_m_per_s, -0.05 * kSpeed_m_per_s) << rate_Hz;
  }
}

}  // namespace
}  // namespace trocar::runtime
