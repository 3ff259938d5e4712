// SPDX-License-Identifier: Apache-2.0
// The hand's path against the limits: poses are judged as the loop judges them, places and speeds
// are those of the path, and every point of the stated workspace can be reached.
#include "runtime/check/needle_path.h"
#include "runtime/session/pose_session.h"

#include <gtest/gtest.h>

#include <array>
#include <numbers>
#include <vector>

#include "tests/runtime/haptics/loop/loop_fixture.h"
#include "tests/support/device_workspace.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/sheet_law_fixture.h"

namespace trocar::runtime {
namespace {

using testing_support::Random;
using testing_support::random_workspace_pose;
using testing_support::ScriptedDevice;
using testing_support::Workspace;

// Yields the first value, the last one, and those between.
std::vector<double> steps(double first, double last, double step) {
  std::vector<double> out(static_cast<std::size_t>((last - first) / step + 1e-6) + 1);
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = first + static_cast<double>(i) * step;
  return out;
}

HandKeyframe keyframe(double t_s, const Eigen::Vector3d& tip_m, const Eigen::Vector3d& turn_rad) {
  return {t_s, {tip_m, from_rotation_vector(turn_rad)}};
}

/// The fault of the loop's first tick at a pose.
Fault loop_fault(const LoopModel& model, const DeviceDescription& description,
                 const JointAngles& joints) {
  ScriptedDevice device;
  device.next.encoder_rad = encoder_angles(joints);
  FourLegs four_legs(description, device);
  LoopState state;
  SheetLaw law = test::hooke_law(model);
  TickResult result;
  haptic_tick(model, {}, four_legs, law, state, result);
  return result.new_fault;
}

TEST(PoseFault, IsTheLoops) {
  constexpr Workspace kWide{.z_min_m = 0.05, .z_max_m = 0.25, .lateral_m = 0.07, .tilt_rad = 0.8};
  LoopModel model;
  const DeviceDescription description = default_device_description();
  const FourLegsSpecification device(description);
  SceneTool tilted;
  tilted.tilt_deg = 35;
  model.tool = make_tool(tilted);
  std::array<int, kFaults> seen{};
  Random random(1);
  for (int i = 0; i < 20000; ++i) {
    const Pose T = random_workspace_pose(random, kWide);
    const PoseMargins margins = pose_margins(device, model.limits, model.tool, T);
    const Fault fault = pose_fault(model.limits, margins);
    ++seen[static_cast<std::size_t>(fault)];
    const std::string what = describe_pose_fault(fault, device, model.limits, model.tool, T);
    ASSERT_EQ(what.empty(), fault == Fault::kNone) << to_string(fault) << ' ' << what;
    const InverseResult inverse = inverse_kinematics(description, T);
    if (!inverse.status) {
      ASSERT_EQ(fault, Fault::kPoseResidual);
      continue;
    }
    ASSERT_EQ(fault, loop_fault(model, description, inverse.joints)) << i << ": " << what;
  }
  for (const Fault fault : {Fault::kNone, Fault::kJointLimit, Fault::kSingularity,
                            Fault::kWorkspace, Fault::kToolTilt, Fault::kPoseResidual}) {
    EXPECT_GT(seen[static_cast<std::size_t>(fault)], 50) << to_string(fault);
  }
}

TEST(PathReport, HasThePathsExtremesAndTheFirstPlaceBeyondALimit) {
  SceneTool scene_tool;
  scene_tool.tip_in_plate_m = {0, 0, -0.05};
  const Tool tool = make_tool(scene_tool);
  const SafetyLimits limits;
  const FourLegsSpecification device(default_device_description());
  const auto evaluate = [&](std::vector<HandKeyframe> keyframes, double to_s,
                            const SafetyLimits& with) {
    HandTrajectory path;
    path.keyframes = std::move(keyframes);
    return evaluate_path(path, device, with, tool, 1000, to_s);
  };
  // The hand passes the box's side at 0.06 m after 1.5 s. Later it turns by 0.8 rad in 1 s about the
  // tip, 0.05 m from the plate's origin; beyond 0.6 rad the tilt is too large.
  const std::vector<HandKeyframe> keyframes = {
      keyframe(0, {0, 0, 0.1}, {0, 0, 0}), keyframe(2, {0.08, 0, 0.1}, {0, 0, 0}),
      keyframe(4, {0, 0, 0.1}, {0, 0, 0}), keyframe(5, {0, 0, 0.1}, {0.8, 0, 0}),
      keyframe(5.01, {0.03, 0, 0.1}, {0.8, 0, 0})};
  const PathReport all = evaluate(keyframes, 9, limits);
  EXPECT_EQ(all.tip_min_m, Eigen::Vector3d(0, 0, 0.1));
  EXPECT_EQ(all.tip_max_m, Eigen::Vector3d(0.08, 0, 0.1));
  EXPECT_NEAR(all.box_min_m, -0.02, 1e-12);
  EXPECT_NEAR(all.tilt_max_rad, 0.8, 1e-12);
  EXPECT_NEAR(all.speed_max_m_per_s, 3, 1e-9);
  ASSERT_TRUE(all.breach);
  EXPECT_EQ(all.breach->fault, Fault::kWorkspace);
  EXPECT_NEAR(all.breach->t_s, 1.5, 1.1e-3);
  const PathReport start = evaluate(keyframes, 1.4, limits);
  EXPECT_NEAR(start.tip_max_m.x(), 0.056, 1e-12);
  EXPECT_FALSE(start.breach);
  EXPECT_NEAR(start.speed_max_m_per_s, 0.04, 1e-9);
  const std::vector<HandKeyframe> turns = {keyframe(0, {0, 0, 0.1}, {0, 0, 0}),
                                           keyframe(1, {0, 0, 0.1}, {0.8, 0, 0})};
  const PathReport turn = evaluate(turns, 9, limits);
  EXPECT_NEAR(turn.speed_max_m_per_s, 0.8 * 0.05, 1e-9);
  ASSERT_TRUE(turn.breach);
  EXPECT_NEAR(turn.breach->t_s, 0.75, 2e-3);
  EXPECT_NE(turn.breach->what.find("tilted by 34."), std::string::npos);
  SafetyLimits slow = limits;
  slow.rotation_rate_max_rad_per_s = 0.7;
  const PathReport fast = evaluate(turns, 9, slow);
  ASSERT_TRUE(fast.breach);
  EXPECT_EQ(fast.breach->fault, Fault::kSpeed);
  EXPECT_NE(fast.breach->what.find("turns at 0.8 rad/s"), std::string::npos) << fast.breach->what;
}

TEST(SheetCrossings, AreWhereTheTipGoesBelow) {
  const Scene scene = test::descent_scene({0.12}, 0.2, 0.1, 0.015);  // a square of 40 mm
  const auto sheets = place_slices(scene, test::square_asset(1), "a");
  ASSERT_TRUE(sheets);
  HandTrajectory path;
  path.keyframes = {
      keyframe(0, {0, 0, 0.14}, {0, 0, 0}),    keyframe(1, {0.004, 0, 0.10}, {0, 0, 0}),
      keyframe(2, {0.04, 0, 0.12}, {0, 0, 0}),  // touches it from below: above again
      keyframe(3, {0.04, 0, 0.11}, {0, 0, 0}), keyframe(4, {0.02, 0, 0.13}, {0, 0, 0}),
      keyframe(5, {0.02, 0, 0.11}, {0, 0, 0})};
  const auto found = sheet_crossings(path, make_tool(scene.tool), *(*sheets)[0]);
  ASSERT_EQ(found.size(), 3U);
  EXPECT_NEAR(found[0].t_s, 0.5, 1e-12);
  EXPECT_NEAR(found[0].tip_m.x(), 0.002, 1e-12);
  EXPECT_EQ(found[0].coverage, 1);
  EXPECT_EQ(found[1].t_s, 2);
  EXPECT_EQ(found[1].coverage, 0);
  EXPECT_NEAR(found[2].coverage, 0.5, 0.01);
}

TEST(Reach, HoldsWhatItStates) {
  const FourLegsSpecification device(default_device_description());
  const SafetyLimits limits;
  SceneTool scene_tool;
  scene_tool.tip_in_plate_m = {0.01, -0.02, -0.05};
  const Tool tool = make_tool(scene_tool);
  const auto is_good = [&](double x_m, double y_m, double z_m) {
    // Sides that lie on the workspace's box: rounding must not take them out of it.
    x_m -= 1e-12 * (x_m > 0.01 ? 1 : -1);
    y_m -= 1e-12 * (y_m > -0.02 ? 1 : -1);
    Pose T;
    T.p_m = Eigen::Vector3d(x_m, y_m, z_m) - tool.tip_plate_m;
    return pose_fault(limits, pose_margins(device, limits, tool, T)) == Fault::kNone;
  };
  const auto heights = workspace_heights(device, limits, tool);
  ASSERT_TRUE(heights);
  EXPECT_GT(heights->max_m - heights->min_m, 0.15);
  for (const double z_m : steps(heights->min_m, heights->max_m, 5e-4))
    ASSERT_TRUE(is_good(0.01, -0.02, z_m)) << z_m;
  EXPECT_FALSE(is_good(0.01, -0.02, heights->min_m - 0.0021));
  EXPECT_FALSE(is_good(0.01, -0.02, heights->max_m + 0.0021));
  EXPECT_FALSE(workspace_rectangle(device, limits, tool, heights->min_m - 0.0021));
  for (const double z_m : {0.03, 0.05, 0.09, 0.13}) {  // of the tip: 5 cm below the plate
    const auto r = workspace_rectangle(device, limits, tool, z_m);
    ASSERT_TRUE(r);
    EXPECT_LE(r->min_m.x(), 0.01 - 0.008);
    EXPECT_GE(r->max_m.y(), -0.02 + 0.008);
    bool beyond_is_good[4] = {true, true, true, true};
    for (const double x_m : steps(r->min_m.x(), r->max_m.x(), 1e-3)) {
      for (const double y_m : steps(r->min_m.y(), r->max_m.y(), 1e-3))
        ASSERT_TRUE(is_good(x_m, y_m, z_m)) << x_m << ' ' << y_m << ' ' << z_m;
      beyond_is_good[0] = beyond_is_good[0] && is_good(x_m, r->min_m.y() - 0.0021, z_m);
      beyond_is_good[1] = beyond_is_good[1] && is_good(x_m, r->max_m.y() + 0.0021, z_m);
    }
    for (const double y_m : steps(r->min_m.y(), r->max_m.y(), 1e-3)) {
      beyond_is_good[2] = beyond_is_good[2] && is_good(r->min_m.x() - 0.0021, y_m, z_m);
      beyond_is_good[3] = beyond_is_good[3] && is_good(r->max_m.x() + 0.0021, y_m, z_m);
    }
    for (const bool good : beyond_is_good)
      EXPECT_FALSE(good) << "a side could be moved out at " << z_m << " m";
  }
}

}  // namespace
}  // namespace trocar::runtime
