// SPDX-License-Identifier: Apache-2.0
// A hand that a person moves while the session runs. Another process states where the tool's tip is to be (formats/session/telemetry.h,
// TelemetryHand). The target to which the springs of the simulated hand pull the tip follows this position.
//
// Contract (tests/runtime/devices/live_hand_test.cpp), whatever the messages say:
//  1. While the hand is held, the target approaches the stated pose with a time constant of 12 ms, at no more than 0.15 m/s and 1 rad/s.
//     The springs' far end moves at the target's velocity.
//  2. The target never leaves the box of LiveHandLimits or exceeds its largest rotation. It never goes to a pose of the plate within
//     kHandMargin of a limit at which the loop would raise a fault. (A tip that a force has pushed there may come back.)
//  3. A message that is not finite or far outside the limits is ignored.
//  4. When the hand lets go, or 250 ms after the last new message, the target follows the tip at no more than 0.3 m/s and 1 rad/s, so that
//     nobody pushes any more. This speed is higher than that of item 1, so that 300 ms after the last message even a force on a soft tissue
//     is below a tenth. Before anybody has held the hand, the target rests at the start.
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
#include "runtime/contact/tool.h"
#include "runtime/control/limits.h"
#include "runtime/device/hand_device.h"
#include "runtime/session/hand_receiver.h"
#include "runtime/simulation/hand.h"
#include "runtime/telemetry/session_facts.h"

namespace trocar::runtime {

struct LiveHandLimits {
  Pose T_device_tool_start;
  /// Box of tip positions that the device reaches with the rotation of the start, reduced by 5 mm on each side. If the device can reach it,
  /// the box goes down to 20 mm below the lowest slice.
  Eigen::Vector3d min_m = Eigen::Vector3d::Zero(), max_m = Eigen::Vector3d::Zero();
  double turn_max_rad = 0;  ///< largest rotation away from that of the start
  double speed_max_m_per_s = 0.15, rotation_rate_max_rad_per_s = 1;
};

/// Returns the limits of a scene with a live hand, whose slices are placed (place_body()). Errors: (refused) the start is not in the box,
/// or there is no box.
Result<LiveHandLimits> live_hand_limits(const Scene& scene, const DeviceSpecification& device,
                                        const SafetyLimits& limits);

/// Returns the description of a live hand with these limits that a session publishes.
PublishedHand published_hand(const SceneHand& hand, const LiveHandLimits& limits);

/// The path of the targets, kept in memory that is allocated once.
class TargetPath {
 public:
  /// Keeps one target in each `interval_s` of the first `duration_s`. At most 2^18 targets are kept, so the interval is longer in a long
  /// session. With a duration of 0 nothing is kept.
  explicit TargetPath(double duration_s, double interval_s = 0.004);
  /// Times must ascend. No allocation.
  void add(double t_s, const Pose& T_device_tool) noexcept;
  /// Returns a path with at most kMaxKeyframes keyframes, the first at time 0. The path is within 5 um and 0.05 mrad of every target kept.
  /// If that needs more keyframes, both tolerances are doubled until their number suffices.
  HandTrajectory keyframes() const;

 private:
  double interval_s_;
  std::vector<HandKeyframe> targets_;
};

class LiveHand final : public UnscriptedHand, public HandReceiver {
 public:
  /// `device` must outlive the hand.
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
  SafetyLimits margins_;  ///< the loop's limits, less kHandMargin
  TargetPath path_;
  bool is_held_ = false, was_held_ = false, restarts_ = false;
  std::uint64_t count_ = 0;  ///< TelemetryHand::count of the last message
  std::int64_t heard_ns_ = 0;
  Pose wanted_;      ///< the stated pose, within the limits
  Pose T_from_, T_;  ///< target at the beginning and at the end of the present step
  Twist twist_ = Twist::Zero();
  double from_s_ = 0;
};

/// Distance that the target keeps from the limits at which the loop raises a fault.
struct HandMargin {
  double box_m = 1e-3, angle_rad = 0.0175;  ///< angle: of a joint, or of the tilt
};
inline constexpr HandMargin kHandMargin;

}  // namespace trocar::runtime
