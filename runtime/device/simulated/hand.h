// SPDX-License-Identifier: Apache-2.0
// A simulated hand. It holds the tool's tip by springs and dampers, in translation and rotation.
// The other end of the springs, the target, moves along a trajectory or, for a live hand, as a
// person decides while the session runs. The haptic thread evaluates the hand.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <variant>
#include <vector>

#include "formats/base/result.h"
#include "runtime/device/device.h"

namespace trocar::runtime {

enum class HandInterpolation : std::uint8_t {
  kLinear,  ///< constant velocity between keyframes
  /// At rest in every keyframe. Between two keyframes the progress is 10 s^3 - 15 s^4 + 6 s^5,
  /// where s is the fraction of the time between them that has passed.
  kMinimumJerk,
};

struct HandKeyframe {
  double t_s = 0;
  Pose T_device_tool;  ///< target pose of the tool's tip
};

/// Before the time of the first keyframe, the target rests at the first keyframe. After the time of
/// the last keyframe, the target rests at the last keyframe. If there are no keyframes, there is no
/// hand and no force.
struct HandTrajectory {
  std::vector<HandKeyframe> keyframes;  ///< t_s must increase strictly
  HandInterpolation interpolation = HandInterpolation::kLinear;
};

/// The impedance of a hand. The defaults are a firm grip. Let K be the stiffness of a rendered
/// wall, and T the duration of a tick. If the hand's damping exceeds K T / 2, the hand does not
/// chatter at the wall. Example: for 5 kN/m at 500 Hz, K T / 2 is 5 N s/m.
struct HandImpedance {
  double stiffness_N_per_m = 4000;
  double damping_Ns_per_m = 100;
  double rotational_stiffness_Nm_per_rad = 20;
  double rotational_damping_Nms_per_rad = 0.3;
  /// Mass rigidly attached to the tool's tip. It has no weight, because the arm carries the hand.
  double mass_kg = 0;
  /// Time at which the hand releases the tool; from then on the hand exerts no force and its mass
  /// is gone. An UnscriptedHand ignores this time.
  double let_go_t_s = std::numeric_limits<double>::infinity();
};

/// Two further grips. Their values are assumptions within the ranges that the literature gives for
/// fingers and for a tensed arm.
inline constexpr HandImpedance kLightGrip{300, 3, 2, 0.02, 0.05};
inline constexpr HandImpedance kStiffGrip{20000, 300, 60, 0.6, 0.5};

struct HandTarget {
  Pose T_device_tool;
  Twist twist_device = Twist::Zero();  ///< twist [v; omega] of the target tip, in {B}
};

/// A hand whose targets become known only while the session runs. The thread that advances the
/// simulated device calls begin_step() and target().
class UnscriptedHand {
 public:
  virtual ~UnscriptedHand() = default;
  /// Returns the target before the first step.
  virtual Pose start() const noexcept = 0;
  /// Decides the targets of the device's next step, which lasts from `t_s` to t_s + dt_s.
  /// `T_device_tool` is the pose of the tool's tip at the beginning of the step.
  virtual void begin_step(double t_s, double dt_s, const Pose& T_device_tool) noexcept = 0;
  /// Returns the target at a time within the step that begin_step() began.
  virtual HandTarget target(double t_s) const noexcept = 0;
};

/// The motion of the hand's target: a trajectory or an UnscriptedHand. The UnscriptedHand must
/// outlive every simulated device that uses it.
using HandMotion = std::variant<HandTrajectory, std::reference_wrapper<UnscriptedHand>>;

/// Returns the target at a time. If there is no keyframe, the target is the identity pose, at rest.
/// O(log keyframes), no allocation.
HandTarget hand_target(const HandTrajectory& trajectory, double t_s) noexcept;
/// The same for any motion. For an UnscriptedHand, the time must lie within the step that it began.
HandTarget hand_target(const HandMotion& motion, double t_s) noexcept;

/// Returns the target before the first step, or nothing if there is no keyframe.
std::optional<Pose> hand_start(const HandMotion& motion) noexcept;

/// Returns true while the hand holds the tool. A hand without keyframes never holds the tool, and an
/// UnscriptedHand never lets go.
bool hand_holds(const HandMotion& motion, const HandImpedance& impedance, double t_s) noexcept;

/// Returns the hand's wrench [f; n] on the tool about the tip, in {B}.
Wrench hand_wrench(const HandImpedance& impedance, const HandTarget& target,
                   const Pose& T_device_tool, const Twist& twist_tool) noexcept;

/// Checks a hand. Errors: kRefused if times of keyframes do not increase, if a value other than the
/// release time is not finite, if a quaternion is not of unit length, if a stiffness, a damping or
/// the mass is negative, or if the release time is not a number.
Result<void> check_hand(const HandMotion& motion, const HandImpedance& impedance);

}  // namespace trocar::runtime
