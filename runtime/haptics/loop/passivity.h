// SPDX-License-Identifier: Apache-2.0
// The energy that the loop releases: what is observed, and its limit.
#pragma once

#include <array>

#include "formats/session/scene.h"
#include "runtime/device/device.h"
#include "runtime/device/hand_device.h"
#include "runtime/haptics/loop/safety.h"

namespace trocar::runtime {

// Time-domain passivity observer. It compares the work that the environment (tissue and coupling)
// has absorbed with the energy that the environment stores.
//
// The work of a wrench that is held over a tick is wrench * displacement(this pose, next pose), so
// it is known exactly one tick later. The energy balance is the work that the environment absorbed
// from the hand minus the energy that the environment stores. A negative balance means that the
// environment has generated energy. Example: if the force of a spring of stiffness K is computed
// once per tick, and the plate moves by x in a tick, the balance falls by K x^2 / 2, in either
// direction of motion; the estimator's lead (estimator.h) takes that back.
//
// Source: B. Hannaford, J. Ryu, Time-domain passivity control of haptic interfaces, IEEE TRA 18(1),
// 2002. Their controller is not used: it takes the noise of readings for energy.
//
// Contract:
//  1. The balance equals the absorbed work minus the stored energy, up to rounding, for any motion.
//  2. A planned release (a puncture) and the end of a contact set the balance to zero.

/// Inputs of a tick.
struct PassivityInput {
  Pose T_device_plate;
  Wrench wrench_device = Wrench::Zero();  ///< the environment's wrench on the plate, in {B}
  double stored_J = 0;                    ///< energy in the environment now; 0 without contact
  bool planned_release = false;           ///< the force law releases energy on purpose (puncture)
};

/// State kept between ticks.
struct PassivityState {
  bool has_last = false;
  Pose T_device_plate;                ///< pose of the last tick
  Wrench delivered = Wrench::Zero();  ///< wrench held since the last tick; the caller stores it
  double stored_J = 0;
  double balance_J = 0;       ///< energy balance since the contact began
  double released_max_J = 0;  ///< largest net energy that a contact released to the hand
};

void observe_passivity(const PassivityInput& input, PassivityState& state) noexcept;

// Limits the energy that the environment (tissue and coupling) releases to the hand. If the
// environment releases more than the limit, the fault kEnergyLimit is raised. The limit acts
// independently of the estimator, which reduces the released energy but cannot bound it.
//
// W(t) is the work that the delivered wrench has done on the plate since the state `running`
// (safety.h) was entered. If the plate moves by the displacement d in a tick, a wrench that is held
// over this tick does the work wrench * d, which is known one tick later. Compensation torques do
// not count. S(t) is the energy stored in the elastic elements of the environment: the sheet, the
// rims (boundaries of holes), the springs of dry friction, and the coupling. S is not multiplied by
// Safety::authority (the factor on the force after a recovery), and S is not reduced when the
// motors cannot render the whole wrench.
//
// Invariant: let s <= t be two ticks at most kEnergyWindow_s apart, with the state
// `running` from s to t. If the force law intends no release of stored energy in the tick s
// (contract 2), then either
//   W(t) - W(s) <= S(s) + SafetyLimits::energy_limit_J,
// or kEnergyLimit is raised at t.
//
// Contract:
//  1. An environment that does not generate energy never raises the fault: from tick to tick, its
//     work on the plate is at most the fall of its stored energy. If the wrench is rendered with a
//     constant factor below 1, the fault is not raised either, because S is the unscaled energy.
//  2. A puncture, or another release of stored energy that the force law intends, does no work on
//     the hand by itself. The tick of such a release may be t, but is never taken as s, because S
//     of this tick is too small: S no longer contains the energy of the punctured sheet, and does
//     not yet contain the energy of the sheet below, which is loaded immediately afterwards.
//  3. In a tick without a new pose, W does not change. The next new pose adds the work of the mean
//     of the wrenches that were held since the last new pose.
//  4. If Safety::authority rises by A within the window, a hand that pushes in and comes back
//     within the window receives at most A * S more energy than it gave, where S is the stored
//     energy at the deepest contact. With the default SafetyTiming, A is 0.4.
//  5. A limit that is nan or negative always raises the fault, and so does an energy that is not
//     finite.

inline constexpr double kEnergyWindow_s = 0.1;
/// Size of the queue of EnergyAccount: the number of ticks in the window at kMaxRate_Hz, plus one.
inline constexpr int kEnergyTicks = static_cast<int>(kEnergyWindow_s * kMaxRate_Hz) + 1;

/// Inputs of a tick.
struct EnergyInput {
  Pose T_device_plate;
  bool new_pose = true;      ///< false if the pose is that of an earlier tick
  double stored_J = 0;       ///< S of this tick
  bool is_released = false;  ///< the force law intends a release in this tick
};

/// The energy account, kept between ticks. To find the smallest W(s) + S(s) of the window, it keeps
/// a monotonic queue: an entry followed by a lower entry can never be the minimum again, so the
/// higher entry is removed.
class EnergyAccount {
 public:
  /// Takes the inputs of a tick. Returns kEnergyLimit if the inequality of the invariant does not
  /// hold for a tick s of the window; otherwise returns no fault.
  FaultDetail check(const SafetyLimits& limits, double rate_Hz, const EnergyInput& input) noexcept;
  /// Adds the wrench that the motors hold until the next tick. Call this once in each tick.
  void note_delivered(const Wrench& wrench_device) noexcept {
    delivered_ += wrench_device;
    ++delivered_ticks_;
  }
  /// Sets the account to zero. The loop calls this in each tick whose state is not `running`.
  void reset() noexcept;
  /// Largest W(t) - W(s) - S(s) over the window of the last check(), at least 0. reset() does not
  /// change this value.
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
