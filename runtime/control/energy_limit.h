// SPDX-License-Identifier: Apache-2.0
// The limit on the energy that the environment releases to the hand: the fault kEnergyLimit. It does not depend
// on the passivity controller, which reduces that energy but cannot bound it.
//
// W(t): work of the delivered wrench on the plate since `running` began. A wrench held over a tick does the
// work wrench * (next pose - this pose), and this work is known one tick later. Compensation torques do not count.
// S(t): energy stored in the elastic elements of the environment: sheet, rims, the springs of dry friction, the
// coupling. S is taken from the force law as it is, not scaled by Safety::authority or by what the motors can render.
//
// Invariant: for any two ticks s <= t at most kEnergyWindow_s apart
//   W(t) - W(s) <= S(s) + SafetyLimits::energy_limit_J,
// or kEnergyLimit is raised at t.
//
// Contract (tests/runtime/control/energy_limit_test.cpp):
//  1. An environment that does not generate energy (dW <= -dS) never raises the fault. Neither does one
//     whose wrench is rendered at a constant factor below 1, since S is the whole energy.
//  2. A puncture or another release does no work on the hand by itself. The tick of a puncture is never taken as the
//     start s of the window, because the sheet below may take over stored energy.
//  3. Without a new pose nothing changes: the work is counted with the next pose, with the mean of the
//     wrenches held since the last one.
//  4. Safety::authority is the factor on the force after a recovery. If it rises by A within the window,
//     pushing in and returning in that time releases at most A times S at the deepest contact: 0.4 S
//     with the default SafetyTiming.
//  5. A limit that is nan or negative always trips. Outside of `running` the account starts again.
#pragma once

#include <array>

#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/control/limits.h"
#include "runtime/mechanism/pose.h"

namespace trocar::runtime {

inline constexpr double kEnergyWindow_s = 0.1;
/// Ticks of the window at the highest rate; at a higher one the window is shorter.
inline constexpr int kEnergyTicks = static_cast<int>(kEnergyWindow_s * kMaxRate_Hz) + 1;

/// Inputs of a tick.
struct EnergyInput {
  Pose T_device_plate;
  bool new_pose = true;
  double stored_J = 0;     ///< S
  bool punctured = false;  ///< a planned release happens in this tick
};

/// Memory between ticks. A queue holds the smallest W(s) + S(s) of the window. This is a monotonic queue: an
/// entry followed by a lower one can never be the minimum again.
class EnergyAccount {
 public:
  /// Returns kEnergyLimit or none.
  FaultDetail check(const SafetyLimits& limits, double rate_Hz, const EnergyInput& input) noexcept;
  /// Reports the wrench that the motors hold until the next tick.
  void note_delivered(const Wrench& wrench_device) noexcept {
    delivered_ += wrench_device;
    ++delivered_ticks_;
  }
  /// Starts again; called outside of `running`.
  void reset() noexcept;
  /// Largest W(t) - W(s) - S(s) of the last check(), at least 0; reset() keeps it.
  double excess_J() const noexcept { return excess_J_; }

 private:
  struct Entry {
    std::int64_t tick = 0;
    double energy_J = 0;  ///< W + S
  };
  Entry& entry(int i) noexcept {
    return entries_[static_cast<std::size_t>((first_ + i) % kEnergyTicks)];
  }

  bool has_last_ = false;
  Pose T_device_plate_;
  Wrench delivered_ = Wrench::Zero();  ///< sum of wrenches since the last new pose
  int delivered_ticks_ = 0;
  double work_J_ = 0;
  double excess_J_ = 0;
  std::int64_t tick_ = 0;
  int first_ = 0, count_ = 0;
  std::array<Entry, kEnergyTicks> entries_;
};

}  // namespace trocar::runtime
