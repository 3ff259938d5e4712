// SPDX-License-Identifier: Apache-2.0
// A simulated hand that a person moves while the session runs. The springs of the simulated hand
// with the pose that the person wants (TelemetryHand in formats/session/telemetry.h), and the
// target follows the wanted pose.
//
// Contract, for any messages:
//  1. While the person holds the hand, the target approaches the wanted pose with a time
//     constant of 12 ms, at no more than 0.15 m/s and 1 rad/s. HandTarget::twist_device is
//     the target's velocity.
//  2. While the person holds the hand, the target stays in the box of LiveHandLimits and within
//     LiveHandLimits::turn_max_rad of the rotation at the start. The target also keeps the distance
//     kHandMargin from poses of the plate at which the loop would raise a fault. Exception: after
//     the person has let go, the target follows the tip (contract 4), and after a pause the target
//     starts at the tip. A force may then have pushed the tip, and with it the target, outside
//     these bounds. When the person holds the hand again, the target moves back within the bounds.
//  3. A message that says that the person holds the hand is ignored if a number of its pose is not
//     finite, or if the number's magnitude exceeds 1 m or 7 rad.
//  4. When the person lets go, or 250 ms after the last new message, the target follows the tip
//     at no more than 0.3 m/s and 1 rad/s, so that the hand no longer pushes. Therefore the force
//     of the tissue falls below a tenth of its value within 300 ms after the last message, even if
//     the tissue is soft and the tip has a long way back. Until the person holds the hand for the
//     first time, the target rests at the start.
//  5. The same calls give the same targets.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/scene.h"
#include "formats/session/telemetry.h"
#include "runtime/device/hand_device.h"
#include "runtime/device/simulated/hand.h"
#include "runtime/haptics/loop/safety.h"
#include "runtime/haptics/tool.h"
#include "runtime/session/session_options.h"
#include "runtime/session/session_publisher.h"

namespace trocar::runtime {

/// Returns the limits for a scene with a live hand. Precondition: place_body() has placed the
/// slices of the scene. Errors: kRefused if the device can reach no box that is at least 20 mm wide
/// at the height of the start, or if the start is not in the box.
Result<LiveHandLimits> live_hand_limits(const Scene& scene, const DeviceSpecification& device,
                                        const SafetyLimits& limits);

/// Records the targets of a live hand over time, so that the session can write the path as
/// keyframes for a scene. The haptic thread may call add(), because add() does not allocate.
class TargetPath {
 public:
  /// Keeps one target in each interval of `interval_s` during the first `duration_s` of the
  /// session. At most 2^18 targets are kept. If the duration is too long for this number, the
  /// interval is longer than `interval_s`. If the duration is 0, no target is kept.
  explicit TargetPath(double duration_s, double interval_s = 0.004);
  /// Adds the target at the time `t_s`. Precondition: times ascend from call to call.
  void add(double t_s, const Pose& T_device_tool) noexcept;
  /// Returns a path with at most kMaxKeyframes keyframes, the first at the time of the first
  /// target. The path is within 5 um and 0.05 mrad of every target kept. If these tolerances need
  /// more than kMaxKeyframes keyframes, both are doubled until kMaxKeyframes suffice. Allocates.
  HandTrajectory keyframes() const;

 private:
  double interval_s_;
  std::vector<HandKeyframe> targets_;
};

class LiveHand final : public UnscriptedHand, public HandReceiver {
 public:
  /// `hand_limits`: from live_hand_limits(). `limits`: limits of the loop. `device` must
  /// outlive the LiveHand.
  LiveHand(const LiveHandLimits& hand_limits, const Tool& tool, const DeviceSpecification& device,
           const SafetyLimits& limits, TargetPath path);

  // The haptic thread calls these functions.

  std::optional<TelemetryEventKind> receive(const TelemetryHand& latest,
                                            std::int64_t now_ns) noexcept override;
  void restart_at_tip() noexcept override { restarts_ = true; }

  Pose start() const noexcept override { return hand_limits_.T_device_tool_start; }
  void begin_step(double t_s, double dt_s, const Pose& T_device_tool) noexcept override;
  HandTarget target(double t_s) const noexcept override;

  const LiveHandLimits& limits() const noexcept { return hand_limits_; }
  const TargetPath& path() const noexcept { return path_; }

 private:
  bool is_allowed(const Pose& T_device_tool) const noexcept;
  Pose nearest_allowed(const std::array<double, 6>& stated) const noexcept;
  Twist allowed_part(const Twist& step) const noexcept;

  LiveHandLimits hand_limits_;
  Tool tool_;
  const DeviceSpecification& device_;
  SafetyLimits margins_;  ///< the loop's limits, tightened by kHandMargin
  TargetPath path_;
  bool is_held_ = false, was_held_ = false, restarts_ = false;
  std::uint64_t count_ = 0;  ///< TelemetryHand::count of the last message
  std::int64_t heard_ns_ = 0;
  Pose wanted_;      ///< the wanted pose, moved to within the limits
  Pose T_from_, T_;  ///< target at the beginning and at the end of the present step
  Twist twist_ = Twist::Zero();
  double from_s_ = 0;
};

/// Distances that the target keeps from the limits at which the loop raises a fault.
struct HandMargin {
  /// `box_m`: distance from the sides of the workspace. `angle_rad`: distance from the limits of
  /// the joint angles and of the tilts of plate and tool.
  double box_m = 1e-3, angle_rad = 0.0175;
};
inline constexpr HandMargin kHandMargin;

}  // namespace trocar::runtime
