// SPDX-License-Identifier: Apache-2.0
// Figures of made-up rows that real sessions have rarely.
#include "runtime/report/session_observer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

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

}  // namespace
}  // namespace trocar::runtime
