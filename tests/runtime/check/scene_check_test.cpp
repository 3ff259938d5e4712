// SPDX-License-Identifier: Apache-2.0
// A scene is checked with the device that will run it: here one without joints and motors.
#include "runtime/check/scene_check.h"

#include <gtest/gtest.h>

#include <atomic>
#include <string>
#include <utility>

#include "runtime/check/new_scene.h"
#include "runtime/session/live_hand.h"
#include "runtime/session/open_device.h"
#include "tests/support/handle_device.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

/// The device of a check, and how often a simulated one was made of it.
struct Handle {
  explicit Handle(double force_max_N, double stop_z_m = 0.05)
      : specification(force_max_N, stop_z_m) {}
  DeviceToCheck to_check() {
    return {specification, [this](const Scene& scene) -> Result<std::shared_ptr<HandDevice>> {
              ++made;
              HandTrajectory path = hand_trajectory(scene);
              if (!specification.margins(path.keyframes.front().T_device_tool).is_reachable)
                return refused("the handle cannot be there");
              return std::shared_ptr<HandDevice>(
                  std::make_shared<test::HandleDevice>(specification, std::move(path)));
            }};
  }
  test::HandleSpecification specification;
  int made = 0;
};

/// The tip goes through one sheet, which breaks at 35 N, and 15 mm below it.
Scene one_sheet() {
  Scene scene = test::descent_scene({0.12}, 0.13, 0.105, 0.05);
  scene.tissue = Tissue{};
  return scene;
}

SceneCheck check(const Scene& scene, Handle& handle) {
  const Asset asset = test::square_asset(1);
  SessionOptions options;
  options.clock = Clock::kVirtual;
  options.duration_s = scene.duration_s;
  auto checked = check_scene(scene, handle.to_check(), *place_slices(scene, asset, "a"),
                             choose_tissues(scene, asset), {}, options);
  if (!checked) throw std::runtime_error(checked.error().message);
  return std::move(*checked);
}

bool has(const std::string& text, const char* part) {
  return text.find(part) != std::string::npos;
}

TEST(SceneCheck, TellsOnlyWhatADeviceHas) {
  Handle handle(50);
  const SceneCheck done = check(one_sheet(), handle);
  EXPECT_TRUE(done.warnings.empty()) << done.warnings.front();
  EXPECT_TRUE(has(done.text, "device     handle, 50 N\n")) << done.text;
  EXPECT_TRUE(has(done.text, "threshold needs 35.0 of 50.0 N")) << done.text;
  EXPECT_TRUE(has(done.text, "1 of 1 slices touched, 1 punctured; at most 3")) << done.text;
  for (const char* foreign : {"Nm", "theta", "condition"})
    EXPECT_FALSE(has(done.text, foreign)) << foreign << ": " << done.text;
}

TEST(SceneCheck, StatesTheThresholdThatIsRendered) {
  Handle handle(50);
  Scene scene = one_sheet();
  scene.force_law.force_scale = 0.5;
  const SceneCheck done = check(scene, handle);
  EXPECT_TRUE(has(done.text, " of 17.5 N, punctured at ")) << done.text;
}

TEST(SceneCheck, WarnsOfAForceThatTheDeviceDoesNotRender) {
  Handle handle(20);
  const SceneCheck done = check(one_sheet(), handle);
  ASSERT_EQ(done.warnings.size(), 1U) << done.text;
  EXPECT_TRUE(has(done.warnings[0], ": the device renders too little force, down to 5"))
      << done.warnings[0];
}

TEST(SceneCheck, WarnsOfTheDevicesOwnLimits) {
  Handle handle(50, 0.11);
  const SceneCheck stopped = check(one_sheet(), handle);
  ASSERT_EQ(stopped.warnings.size(), 1U);
  EXPECT_TRUE(has(stopped.warnings[0], "the session ends with the fault pose_residual"))
      << stopped.warnings[0];
  EXPECT_TRUE(has(stopped.warnings[0], "keep the path's height within 0.11"))
      << stopped.warnings[0];
  EXPECT_GT(handle.made, 0);

  Handle high(50, 0.2);
  const SceneCheck refused = check(one_sheet(), high);
  ASSERT_FALSE(refused.warnings.empty());
  EXPECT_TRUE(
      has(refused.warnings[0],
          "cannot start with the tip at (0.0000, 0.0000, 0.1300) m: the handle is at 0.130 m; "
          "the limit is 0.2 m"))
      << refused.warnings[0];
}

TEST(SceneCheck, ALiveHandStaysAboveTheDevicesStop) {
  Scene scene = one_sheet();
  scene.hand.live = true;
  scene.hand.trajectory.resize(1);
  const test::HandleSpecification specification(50, 0.115);
  const SafetyLimits safety;
  const auto limits = live_hand_limits(scene, specification, safety);
  ASSERT_TRUE(limits) << limits.error().message;
  EXPECT_GE(limits->min_m.z(), 0.115);
  EXPECT_LT(limits->min_m.z(), 0.125);

  LiveHand hand(*limits, make_tool(scene.tool), specification, safety, TargetPath(0));
  TelemetryHand message;
  message.is_held = true;
  message.target = {0.01, 0, 0.05, 0, 0, 0.3};
  Pose tip = limits->T_device_tool_start;
  for (int i = 0; i < 1000; ++i) {
    message.count = static_cast<std::uint64_t>(i) + 1;
    hand.receive(message, i * std::int64_t{1'000'000});
    hand.begin_step(1e-3 * i, 1e-3, tip);
    tip = hand.target(1e-3 * (i + 1)).T_device_tool;
    ASSERT_GE(tip.p_m.z(), limits->min_m.z() - 1e-12);
  }
  EXPECT_NEAR(tip.p_m.x(), 0.01, 1e-4);
  EXPECT_NEAR(tip.p_m.z(), limits->min_m.z(), 1e-4);
  EXPECT_NEAR(rotation_vector(tip.q).z(), 0.3, 1e-3);
}

TEST(NewScene, LiesWhereTheDeviceReaches) {
  const Asset asset = test::square_asset(3);
  SessionOptions options;
  options.clock = Clock::kVirtual;
  Handle handle(50, 0.1);
  const auto made = propose_scene(asset, "a.glb", "s.json", handle.to_check(), options);
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_TRUE(has(made->text, "heights 0.100 to 0.2")) << made->text;
  Handle nowhere(50, 1);
  EXPECT_FALSE(propose_scene(asset, "a.glb", "s.json", nowhere.to_check(), options));
}

// The stop comes while the n-th simulated session is prepared, whichever that is.
TEST(NewScene, AnInterruptGivesNoSceneAtAnyMoment) {
  const Asset asset = test::square_asset(3);
  std::atomic<bool> stop{false};
  SessionOptions options;
  options.clock = Clock::kVirtual;
  options.stop = &stop;
  const auto propose = [&](int stop_at) {
    Handle handle(50, 0.1);
    DeviceToCheck device = handle.to_check();
    stop = stop_at == 0;
    device.simulate = [&, make = device.simulate](const Scene& scene) {
      auto made = make(scene);
      if (handle.made == stop_at) stop = true;
      return made;
    };
    auto made = propose_scene(asset, "a.glb", "s.json", device, options);
    return std::pair(std::move(made), handle.made);
  };
  const auto [whole, sessions] = propose(-1);
  ASSERT_TRUE(whole) << whole.error().message;
  ASSERT_GE(sessions, 2);
  for (int n = 0; n <= sessions; ++n) {
    const auto made = propose(n).first;
    ASSERT_FALSE(made) << n << ": " << made->text;
    EXPECT_EQ(made.error().code, ExitCode::kDeviceFault) << n;
    EXPECT_TRUE(has(made.error().message, "interrupted")) << n << ": " << made.error().message;
  }
}

TEST(SceneCheck, AnInterruptGivesNoFigures) {
  const Scene scene = one_sheet();
  const Asset asset = test::square_asset(1);
  std::atomic<bool> stop{true};
  SessionOptions options;
  options.clock = Clock::kVirtual;
  options.duration_s = scene.duration_s;
  options.stop = &stop;
  Handle handle(50);
  const auto checked = check_scene(scene, handle.to_check(), *place_slices(scene, asset, "a"),
                                   choose_tissues(scene, asset), {}, options);
  ASSERT_FALSE(checked) << checked->text;
  EXPECT_EQ(checked.error().code, ExitCode::kDeviceFault);
}

}  // namespace
}  // namespace trocar::runtime
