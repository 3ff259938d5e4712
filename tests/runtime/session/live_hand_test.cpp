// SPDX-License-Identifier: Apache-2.0
// The contract of runtime/session/live_hand.h, and the path that it writes.
#include "runtime/session/live_hand.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "runtime/device/four_legs/four_legs.h"
#include "runtime/session/open_device.h"
#include "runtime/session/pose_session.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

constexpr double kTick_s = 1e-3;
constexpr std::int64_t kTick_ns = 1'000'000;

Scene live_scene() {
  Scene scene = test::descent_scene({0.12}, 0.13, 0.115, 0.1);
  scene.hand.live = true;
  scene.hand.trajectory.resize(1);
  return scene;
}

/// The limits of live_scene(), which take a while to find.
const LiveHandLimits& known_limits() {
  static const LiveHandLimits limits = *live_hand_limits(
      live_scene(), FourLegsSpecification(default_device_description()), SafetyLimits{});
  return limits;
}

/// A live hand with a tip that a test moves, both in a time of their own.
struct Rig {
  explicit Rig(double path_s = 0)
      : limits(known_limits()),
        hand(limits, make_tool(scene.tool), device, safety, TargetPath(path_s)) {}

  /// States a target for the next ticks.
  void state(const Vector3d& tip_m, const Vector3d& rotation_rad = Vector3d::Zero()) {
    ++message.count;
    message.is_held = true;
    message.target = {tip_m.x(),        tip_m.y(),        tip_m.z(),
                      rotation_rad.x(), rotation_rad.y(), rotation_rad.z()};
  }
  void let_go() {
    ++message.count;
    message.is_held = false;
  }
  /// Runs one tick. Returns the target at its end.
  HandTarget tick() {
    change = hand.receive(message, now_ns);
    hand.begin_step(t_s, kTick_s, tip);
    t_s += kTick_s;
    now_ns += kTick_ns;
    return hand.target(t_s);
  }
  /// Runs ticks with the tip at the target. Each states the last target again.
  HandTarget follow(int ticks) {
    HandTarget target;
    for (int i = 0; i < ticks; ++i) {
      if (message.is_held) ++message.count;
      target = tick();
      tip = target.T_device_tool;
    }
    return target;
  }

  Scene scene = live_scene();
  FourLegsSpecification device{default_device_description()};
  SafetyLimits safety;
  LiveHandLimits limits;
  LiveHand hand;
  TelemetryHand message;
  Pose tip{Vector3d(0, 0, 0.13), Eigen::Quaterniond::Identity()};
  std::optional<TelemetryEventKind> change;
  std::int64_t now_ns = 5'000'000'000;
  double t_s = 0;
};

TEST(LiveHandLimits, EveryCornerIsReached) {
  const Rig rig;
  EXPECT_NEAR(rig.limits.min_m.z(), 0.1, 1e-9) << "20 mm below the slice";
  EXPECT_GE((rig.limits.max_m - rig.limits.min_m).minCoeff(), 0.02);
  const Tool tool = make_tool(rig.scene.tool);
  for (int corner = 0; corner < 8; ++corner) {
    Pose T;
    for (int i = 0; i < 3; ++i)
      T.p_m[i] = ((corner >> i) & 1) == 0 ? rig.limits.min_m[i] : rig.limits.max_m[i];
    T.p_m -= tool.tip_plate_m;
    const PoseMargins margins = pose_margins(rig.device, rig.safety, tool, T);
    EXPECT_EQ(pose_fault(rig.safety, margins), Fault::kNone) << T.p_m.transpose();
    EXPECT_GE(margins.box_m, kHandMargin.box_m);
    EXPECT_GE(margins.device.joint_rad, kHandMargin.angle_rad);
  }
}

TEST(LiveHandLimits, RefuseAStartOutside) {
  const SafetyLimits safety;
  for (const std::array<double, 3>& tip_m :
       {std::array{0.0, 0.0, 0.5}, std::array{0.0, 0.0, 0.01}, std::array{0.059, 0.0, 0.13}}) {
    Scene scene = live_scene();
    scene.hand.trajectory[0].tip_m = tip_m;
    const auto limits =
        live_hand_limits(scene, FourLegsSpecification(default_device_description()), safety);
    ASSERT_FALSE(limits);
    EXPECT_EQ(limits.error().code, ExitCode::kRefused);
  }
}

TEST(LiveHand, RestsUntilItIsHeld) {
  Rig rig;
  rig.tip.p_m.z() = 0.125;  // pushed away
  for (int i = 0; i < 1000; ++i) {
    const HandTarget target = rig.tick();
    EXPECT_FALSE(rig.change);
    EXPECT_EQ(target.T_device_tool.p_m, Vector3d(0, 0, 0.13));
    EXPECT_EQ(target.twist_device, Twist::Zero());
  }
}

TEST(LiveHand, FollowsWithATimeConstant) {
  Rig rig;
  const Vector3d to_m(0, 0, 0.129);  // near enough for the speed to stay below the limit
  rig.state(to_m);
  EXPECT_NEAR(rig.follow(12).T_device_tool.p_m.z(), 0.129 + 1e-3 / std::exp(1.0), 2e-6);
  EXPECT_LT((rig.follow(200).T_device_tool.p_m - to_m).norm(), 1e-9);
}

// A person begins anywhere, and messages may jump.
TEST(LiveHand, IsNeverFasterThanItsLimits) {
  Rig rig;
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(-1, 1), turn(-7, 7);
  Pose before = rig.tip;
  for (int i = 0; i < 20'000; ++i) {
    if (i % 8 == 0)
      rig.state({place(random), place(random), place(random)},
                {turn(random), turn(random), turn(random)});
    if (i % 5000 == 2500) rig.let_go();
    const HandTarget target = rig.follow(1);
    const Twist step = displacement(before, target.T_device_tool);
    ASSERT_LE(step.head<3>().norm(), (rig.message.is_held ? 0.15 : 0.3) * kTick_s * (1 + 1e-9));
    ASSERT_LE(step.tail<3>().norm(), 1 * kTick_s * (1 + 1e-9));
    ASSERT_LT((step / kTick_s - target.twist_device).norm(), 1e-6) << "the damper's velocity";
    before = target.T_device_tool;
  }
}

TEST(LiveHand, StaysWithinTheBoxAndThePosesOfTheDevice) {
  Rig rig;
  const Tool tool = make_tool(rig.scene.tool);
  std::mt19937 random(8);
  std::uniform_real_distribution<double> place(-1, 1), turn(-7, 7);
  double farthest_rad = 0;
  for (int k = 0; k < 200; ++k) {
    rig.state({place(random), place(random), place(random)},
              {turn(random), turn(random), turn(random)});
    for (int i = 0; i < 300; ++i) {
      const Pose T = rig.follow(1).T_device_tool;
      ASSERT_TRUE(((T.p_m - rig.limits.min_m).array() >= -1e-12).all());
      ASSERT_TRUE(((rig.limits.max_m - T.p_m).array() >= -1e-12).all());
      const Pose plate{T.p_m - T.q * tool.tip_plate_m, T.q};
      ASSERT_EQ(pose_fault(rig.safety, pose_margins(rig.device, rig.safety, tool, plate)),
                Fault::kNone);
      farthest_rad = std::max(farthest_rad, rotation_vector(T.q).norm());
    }
  }
  EXPECT_GT(farthest_rad, 0.4) << "the hand can turn the tool";
}

TEST(LiveHand, ReachesEveryCornerAndTurnsThere) {
  Rig rig;
  for (int corner = 0; corner < 8; ++corner) {
    Vector3d to_m;
    for (int i = 0; i < 3; ++i)
      to_m[i] = ((corner >> i) & 1) == 0 ? rig.limits.min_m[i] : rig.limits.max_m[i];
    rig.state(to_m);
    EXPECT_LT((rig.follow(2000).T_device_tool.p_m - to_m).norm(), 1e-6);
  }
  rig.state({0, 0, 0.13}, {0.3, 0, 0});
  const Pose T = rig.follow(2000).T_device_tool;
  EXPECT_LT((rotation_vector(T.q) - Vector3d(0.3, 0, 0)).norm(), 1e-6);
}

TEST(LiveHand, IgnoresImpossibleNumbers) {
  Rig rig;
  rig.state({0, 0, 0.128});
  rig.follow(100);
  const double nan = std::numeric_limits<double>::quiet_NaN(),
               inf = std::numeric_limits<double>::infinity();
  for (const double wrong : {nan, inf, -inf, 1e300, -8.0}) {
    for (std::size_t i = 0; i < 6; ++i) {
      rig.state({0, 0, 0.12});
      rig.message.target.at(i) = wrong;
      EXPECT_NEAR(rig.tick().T_device_tool.p_m.z(), 0.128, 1e-6);
    }
  }
  // They do not count as messages either.
  for (int i = 0; i < 260; ++i) {
    ++rig.message.count;
    rig.tick();
    if (rig.change) break;
  }
  EXPECT_EQ(rig.change, TelemetryEventKind::kHandLost);
}

TEST(LiveHand, TellsWhoHoldsIt) {
  Rig rig;
  rig.state({0, 0, 0.128});
  rig.tick();
  EXPECT_EQ(rig.change, TelemetryEventKind::kHand);
  // The same message for 250 ms, and not longer.
  for (int i = 1; i < 250; ++i) {
    rig.tick();
    ASSERT_FALSE(rig.change) << i;
  }
  rig.tick();
  EXPECT_EQ(rig.change, TelemetryEventKind::kHandLost);
  rig.tick();
  EXPECT_FALSE(rig.change);
  rig.state({0, 0, 0.127});
  rig.tick();
  EXPECT_EQ(rig.change, TelemetryEventKind::kHand);
  rig.let_go();
  rig.tick();
  EXPECT_EQ(rig.change, TelemetryEventKind::kHandLetGo);
  rig.let_go();
  rig.tick();
  EXPECT_FALSE(rig.change);
}

// The tip is held back 10 mm above the target; the hand lets go, or is silent.
TEST(LiveHand, StopsPushingWhenNobodyHoldsIt) {
  for (const bool is_silent : {false, true}) {
    Rig rig;
    rig.state({0, 0, 0.12});
    for (int i = 0; i < 500; ++i) {
      ++rig.message.count;
      rig.tick();
    }
    const auto push_m = [&] {
      return rig.tip.p_m.z() - rig.hand.target(rig.t_s).T_device_tool.p_m.z();
    };
    EXPECT_NEAR(push_m(), 0.01, 1e-6);
    if (!is_silent) rig.let_go();
    int ticks = 0;
    while (push_m() > 0.001 && ticks < 1000) {
      rig.tick();
      ++ticks;
    }
    EXPECT_LE(ticks, is_silent ? 249 + 45 : 45);
    // It follows a tip that is pushed up.
    rig.tip.p_m.z() += 0.01;
    for (int i = 0; i < 300; ++i)
      rig.tick();
    EXPECT_NEAR(push_m(), 0, 1e-6);
  }
}

TEST(LiveHand, BeginsAtTheTipAfterAPause) {
  Rig rig;
  rig.state({0, 0, 0.12});
  for (int i = 0; i < 200; ++i) {
    ++rig.message.count;
    rig.tick();
  }
  rig.hand.restart_at_tip();
  ++rig.message.count;
  EXPECT_NEAR(rig.tick().T_device_tool.p_m.z(), 0.13 - 0.15 * kTick_s, 1e-9);
}

TEST(LiveHand, ReturnsFromWhereAForceHasPushedTheTip) {
  Rig rig;
  rig.state({0, 0, 0.13});
  rig.tick();
  rig.let_go();
  rig.tip.p_m.x() = rig.limits.max_m.x() + 0.012;
  for (int i = 0; i < 1000; ++i)
    rig.tick();
  rig.state({0, 0, 0.13});
  EXPECT_LT((rig.follow(2000).T_device_tool.p_m - Vector3d(0, 0, 0.13)).norm(), 1e-6);
}

TEST(TargetPath, RepeatsTheTargets) {
  Rig rig(10);
  std::mt19937 random(10);
  std::uniform_real_distribution<double> sideways(-0.03, 0.03), turn(-0.3, 0.3);
  std::vector<HandKeyframe> all;
  for (int i = 0; i < 10'000; ++i) {
    if (i % 500 == 0)
      rig.state({sideways(random), sideways(random), 0.13 + sideways(random) / 2},
                {turn(random), turn(random), turn(random)});
    all.push_back({rig.t_s + kTick_s, rig.follow(1).T_device_tool});
  }
  const HandTrajectory path = rig.hand.path().keyframes();
  EXPECT_EQ(path.keyframes.front().t_s, 0);
  EXPECT_LT(path.keyframes.size(), 2500U);
  EXPECT_TRUE(check_hand(path, {}));
  for (const HandKeyframe& each : all) {
    const Twist off = displacement(hand_target(path, each.t_s).T_device_tool, each.T_device_tool);
    ASSERT_LT(off.head<3>().norm(), 3e-5) << each.t_s;
    ASSERT_LT(off.tail<3>().norm(), 3e-4) << each.t_s;
  }
}

TEST(TargetPath, IsBounded) {
  TargetPath path(86400);  // 86,400,000 ticks would be given in a session of a day
  std::mt19937 random(11);
  std::uniform_real_distribution<double> place(-0.05, 0.05);
  for (int i = 0; i < 300'000; ++i)
    path.add(i * 0.33,
             {{place(random), place(random), place(random)}, Eigen::Quaterniond::Identity()});
  EXPECT_LE(path.keyframes().keyframes.size(), kMaxKeyframes);
  TargetPath none(0);
  none.add(0, {});
  EXPECT_TRUE(none.keyframes().keyframes.empty());
}

}  // namespace
}  // namespace trocar::runtime
