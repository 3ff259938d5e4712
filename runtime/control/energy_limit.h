// SPDX-License-Identifier: Apache-2.0
// A limit on the energy that the environment gives to the hand: the fault kEnergy. It does not
// depend on the passivity controller, which reduces that energy but cannot bound it.
//
// W(t): work of the delivered wrench on the plate since `running` began. A wrench held over a tick
// does the work wrench * (next pose - this pose), known one tick later. Compensation torques do not
// count. S(t): what the elastic elements of the environment store: sheet, rims, the springs of dry
// friction, the coupling; as the law says, not scaled by authority or by what the motors can
// render.
//
// Invariant: for any two ticks s <= t at most kEnergyWindow_s apart
//   W(t) - W(s) <= S(s) + SafetyLimits::energy_given_max_J,
// or kEnergy is raised at t.
//
// Contract (tests/runtime/control/energy_limit_test.cpp):
//  1. An environment that does not generate energy (dW <= -dS) never raises it; neither does one
//     whose wrench is rendered at a constant share below 1, since S is the whole energy.
//  2. A puncture or another release gives nothing by itself. The tick of a puncture is not an s:
//  the
//     sheet below may take over energy that the punctured one had stored.
//  3. Without a new pose nothing changes: the work is counted with the next one, with the mean of
//  the
//     wrenches held since the last.
//  4. Authority that rises after a recovery by `a` within the window gives at most a S of the
//     deepest contact, in a push and return in that time: 0.4 S by the default of SafetyTiming.
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
  bool punctured = false;  ///< in this tick
};

/// Memory between ticks. The least W(s) + S(s) of the window is kept by a queue of ascending
/// values: one that is followed by a lower one will never be the least again.
class EnergyAccount {
 public:
  /// kEnergy or none.
  FaultDetail check(const SafetyLimits& limits, double rate_Hz, const EnergyInput& input) noexcept;
  /// The wrench that the motors hold until the next tick.
  void note_delivered(const Wrench& wrench_device) noexcept {
    delivered_ += wrench_device;
    ++delivered_ticks_;
  }
  /// Outside of `running`.
  void reset() noexcept;
  /// W(t) - W(s) - S(s) at its largest, of the last check(), also after reset(); not below 0.
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
  Wrench delivered_ = Wrench::Zero();  ///< sum since the last new pose
  int delivered_ticks_ = 0;
  double work_J_ = 0;
  double excess_J_ = 0;
  std::int64_t tick_ = 0;
  int first_ = 0, count_ = 0;
  std::array<Entry, kEnergyTicks> entries_;
};

}  // namespace trocar::runtime
