// SPDX-License-Identifier: Apache-2.0
// The hand's path against the limits, and the needle's path through a scan.
#include "runtime/check/needle_path.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "runtime/session/pose_session.h"
#include "tests/runtime/haptics/loop/loop_fixture.h"
#include "tests/support/device_workspace.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/sheet_law_fixture.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;
using testing_support::Random;
using testing_support::random_workspace_pose;
using testing_support::ScriptedDevice;
using testing_support::Workspace;

// The hand's path against the limits: poses are judged as the loop judges them, places and speeds
// are those of the path, and every point of the stated workspace can be reached.

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

/// Squares of 40 mm around (80, 60) mm, 2 mm apart, in a patient who lies askew. `empty`: slices that have none.
struct Stack {
  explicit Stack(int slices, const std::vector<int>& empty = {})
      : asset(test::square_asset(slices)) {
    T_lps.linear() = Eigen::AngleAxisd(0.7, Vector3d(1, 2, 3).normalized()).toRotationMatrix();
    T_lps.translation() = Vector3d(-31, 12, 250);
    for (AssetSlice& slice : asset.slices) {
      slice.z_mm = 2.0 * slice.index;
      slice.T_lps_plane = T_lps * Eigen::Translation3d(0, 0, slice.z_mm);
    }
    for (const int index : empty)
      asset.slices[static_cast<std::size_t>(index)].mesh.triangles.clear();
    for (auto slice = asset.slices.rbegin(); slice != asset.slices.rend(); ++slice) {
      if (!slice->mesh.triangles.empty()) levels.push_back({&*slice, slice->z_mm});
    }
  }

  std::array<double, 3> lps(double u, double v, double z) const {
    const Vector3d at = T_lps * Vector3d(u, v, z);
    return {at.x(), at.y(), at.z()};
  }
  /// Moves a slice's material along x.
  void move(std::size_t i, double mm) {
    for (LatticePoint& vertex : asset.slices[i].mesh.vertices)
      vertex.x += static_cast<int>(mm / asset.lattice.step_mm());
  }
  Result<NeedlePath> plan(std::array<double, 3> entry, std::optional<std::array<double, 3>> target,
                          const PathLimits& limits = {}) const {
    return plan_needle_path(asset, levels, {entry, target}, limits);
  }
  std::string refusal(std::array<double, 3> entry,
                      std::optional<std::array<double, 3>> target) const {
    const auto path = plan(entry, target);
    return path ? "" : path.error().message;
  }

  Asset asset;
  Eigen::Affine3d T_lps = Eigen::Affine3d::Identity();
  std::vector<Level> levels;
};

bool near(const Vector3d& a, const Vector3d& b) {
  return (a - b).norm() < 1e-9;
}

TEST(NeedlePath, EntersWhereItMeetsTheBone) {
  const Stack stack(10);
  // Chosen inside the bone, above it, and between two levels.
  const auto inside = stack.plan(stack.lps(80, 60, 9), {});
  ASSERT_TRUE(inside) << inside.error().message;
  EXPECT_TRUE(near(inside->entry_mm, {80, 60, 18}));
  EXPECT_NEAR(inside->entry_shift_mm, 9, 1e-9);
  const auto above = stack.plan(stack.lps(80, 60, 30), stack.lps(80, 66, 6));
  ASSERT_TRUE(above) << above.error().message;
  EXPECT_TRUE(near(above->entry_mm, {80, 63, 18}));

  const Stack lower(
      10, {7, 8, 9});  // the topmost level is at 12 mm, and its surface within half a slice above
  const auto surface = lower.plan(lower.lps(80, 60, 12.9), {});
  EXPECT_TRUE(surface && near(surface->entry_mm, {80, 60, 12.9}));
  const auto air = lower.plan(lower.lps(80, 60, 13.5), {});
  EXPECT_TRUE(air && near(air->entry_mm, {80, 60, 12}));
}

TEST(NeedlePath, SlicesWithoutMaterialPartTheBone) {
  const Stack stack(10, {4, 5});
  EXPECT_NE(stack.refusal(stack.lps(80, 60, 6), {}).find("through the bone of slice 9"),
            std::string::npos);
  // Air above the lower piece, where the upper one is absent.
  Stack aside(10, {4, 5});
  for (std::size_t i = 6; i < 10; ++i)
    aside.move(i, 60);
  const auto path = aside.plan(aside.lps(80, 60, 9), {});
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_TRUE(near(path->entry_mm, {80, 60, 6}));
  EXPECT_NEAR(path->entry_shift_mm, 3, 1e-9);
}

TEST(NeedlePath, NeedsSlicesStraightAboveEachOther) {
  Stack stack(10);
  for (AssetSlice& slice : stack.asset.slices)
    slice.T_lps_plane = slice.T_lps_plane * Eigen::Translation3d(0.1 * slice.index, 0, 0);
  EXPECT_NE(stack.refusal(stack.lps(80, 60, 18), {}).find("tilted gantry"), std::string::npos);
}

TEST(NeedlePath, KeepsASurfacePointBetweenLevels) {
  Stack stack(10);
  // Only the lower half of the stack has material at this point.
  for (std::size_t i = 5; i < 10; ++i)
    stack.move(i, 40);
  const auto path = stack.plan(stack.lps(75, 60, 8.6), {});
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_TRUE(near(path->entry_mm, {75, 60, 8.6}));
  EXPECT_EQ(path->entry_shift_mm, 0);
  EXPECT_EQ(stack.levels[path->first].slice->index, 4);
}

TEST(NeedlePath, EndsAtAGapThatIsTooWide) {
  const Stack stack(10, {4, 5});
  const auto path = stack.plan(stack.lps(80, 60, 18), {}, {.gap_mm = 3});
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_TRUE(near(path->end_mm, {80, 60, 12}));
  EXPECT_EQ(path->max_gap_mm, 2);
  const auto through = stack.plan(stack.lps(80, 60, 18), stack.lps(80, 60, 1), {.gap_mm = 3});
  EXPECT_TRUE(through && through->max_gap_mm == 6);
}

TEST(NeedlePath, AGapOfMoreThanThreeMillimetresEndsTheBone) {
  // Levels 2 mm apart; some lie 60 mm aside, so that the path meets no bone there.
  const auto with_gap = [](std::size_t from, std::size_t to) {
    Stack stack(12);
    for (std::size_t i = from; i <= to; ++i)
      stack.move(i, 60);
    return stack;
  };
  const Stack narrow = with_gap(5, 5), wide = with_gap(5, 6);
  const auto through = narrow.plan(narrow.lps(80, 60, 22), {});
  ASSERT_TRUE(through) << through.error().message;
  EXPECT_EQ(through->last, 11U) << "a gap of 2 mm";
  EXPECT_TRUE(bone_gaps(narrow.levels, *through).empty());
  const auto ended = wide.plan(wide.lps(80, 60, 22), {});
  ASSERT_TRUE(ended) << ended.error().message;
  EXPECT_EQ(ended->last, 4U) << "slice 7, above the gap of 4 mm";
  EXPECT_NEAR(ended->thickness_mm, 10, 1e-9);
  const std::vector<BoneGap> after = bone_gaps(wide.levels, *ended);
  ASSERT_EQ(after.size(), 1U);
  EXPECT_NEAR(after[0].mm, 4, 1e-9);
  EXPECT_EQ(after[0].above, ended->last);
  EXPECT_EQ(wide.levels[after[0].below].slice->index, 4);
  // To a target below the gap, which is then known; only bone counts.
  const auto chosen = wide.plan(wide.lps(80, 60, 22), wide.lps(80, 60, 1));
  ASSERT_TRUE(chosen) << chosen.error().message;
  EXPECT_EQ(bone_gaps(wide.levels, *chosen).size(), 1U);
  EXPECT_NEAR(chosen->thickness_mm, 18, 1e-9) << "without the last slice, below the target";

  const auto column = find_entry_column(wide.asset, wide.levels, 2, 100, 3);
  ASSERT_TRUE(column);
  EXPECT_NEAR(column->thickness_mm, 10, 1e-9) << "either piece has 10 mm; the upper one is met";
  EXPECT_EQ(column->first, 0U);
  EXPECT_EQ(column->last, 4U);
}

}  // namespace
}  // namespace trocar::runtime
