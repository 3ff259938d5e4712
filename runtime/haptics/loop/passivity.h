// SPDX-License-Identifier: Apache-2.0
// Velocities of the loop, and the limits on the energy that it releases.
#pragma once

#include <array>

#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/device/device.h"
#include "runtime/device/hand_device.h"
#include "runtime/haptics/loop/safety.h"

namespace trocar::runtime {

// Chooses the interval over which velocities are computed, and corrects the velocity if a device
// state came late.
//
// If encoders have a coarse resolution and are read at a high rate, an angle changes by only a few
// counts per sample, so the velocity is noisy. (A count is one step of the resolution.) If the
// velocity is computed over a longer interval, the noise is smaller, but the velocity lags behind
// that of an accelerating tool. The interval, called the window, is therefore extended only while
// the motion is steady: the window is the longest interval in which all readings of each encoder
// are within one count of the straight line from the first to the last reading. Each reading is
// within half a count of the true angle, so a motion of constant velocity never ends a window.
//
// Source: F. Janabi-Sharifi, V. Hayward, C. Chen, Discrete-time adaptive windowing for velocity
// estimation, IEEE TCST 8(6), 2000.
//
// Contract:
//  1. With exact encoders and device states on time, velocities are computed from the
//     last two states.
//  2. In a steady motion the window grows to kVelocitySamples intervals. The error of an encoder's
//     velocity is then at most one count divided by the duration of the window.
//  3. The window goes back only as far as the readings of every encoder stay within a count of
//     the straight line.
//  4. A device state is late if it came more than a period after the previous state. If the newest
//     state is late and the motion is not steady, the velocity is extrapolated to the time half a
//     period before the newest state. For this, the mean velocity of each of the last two intervals
//     is taken to hold in the middle of the interval, and the velocity is assumed to change
//     linearly. (If states are on time, the mean velocity of the last interval is the velocity half
//     a period before the newest state.) Exceptions: if the interval before the last one is shorter
//     than half a period, item 4 does not apply, because an error of the time stamps would be amplified.
//     Unless the encoders are exact, item 4 does not apply either if the last interval is more than
//     twice as long as the one before, because the noise of the encoders would be amplified.

inline constexpr int kVelocitySamples = 32;

/// The latest device states that passed the checks, with ascending times, in a ring of fixed size.
/// Nothing is allocated.
class VelocityWindow {
 public:
  /// Adds the newest device state and its pose. Precondition: times ascend.
  void add(const Measurement& measured, const Pose& T_device_plate) noexcept;
  void clear() noexcept { count_ = 0; }
  /// Returns the pose and age of the first state of the window that ends at the newest state. In
  /// the case of item 4, no stored pose gives the right velocity. The function then returns a
  /// computed earlier pose, chosen so that the displacement from it to the newest pose, divided by
  /// the age, is the velocity of item 4. An age of 0 means that no pose was chosen; the caller then
  /// uses the pose of the previous state. `resolution`:
  /// DeviceSpecification::resolution(), the resolution of the measured values. `period_s`:
  /// period of the loop.
  PreviousPose begin(double resolution, double period_s) const noexcept;

 private:
  PreviousPose late_begin(double period_s, double min_before) const noexcept;
  PreviousPose steady_begin(double resolution) const noexcept;
  struct Sample {
    Measurement state;
    Pose T_device_plate;
  };
  const Sample& ago(int samples) const noexcept {
    return ring_[static_cast<std::size_t>((next_ + kVelocitySamples - samples) %
                                          (kVelocitySamples + 1))];
  }
  std::array<Sample, kVelocitySamples + 1> ring_;
  int next_ = 0, count_ = 0;
};

// Time-domain passivity observer and controller. The observer compares the work that the
// environment (tissue and coupling) has absorbed with the energy that the environment stores. The
// controller adds damping if the environment has generated energy.
//
// The work of a wrench that is held over a tick is wrench * displacement(this pose, next pose), so
// it is known exactly one tick later. The energy balance is the work that the environment absorbed
// from the hand minus the energy that the environment stores. A negative balance means that the
// environment has generated energy. Example: if the force of a spring of stiffness K is computed
// once per tick, and the plate moves by x in a tick, the balance falls by K x^2 / 2, in either
// direction of motion.
//
// Sources: B. Hannaford, J. Ryu, Time-domain passivity control of haptic interfaces, IEEE TRA
// 18(1), 2002; J. Ryu, C. Preusche, B. Hannaford, G. Hirzinger, Time domain passivity control with
// reference energy following, IEEE TCST 13(5), 2005.
//
// Contract:
//  1. The balance equals the absorbed work minus the stored energy, up to rounding, for any motion.
//  2. While the balance is not negative, the wrench is unchanged to the last bit. The wrench is
//     also unchanged if the environment's wrench opposed the last motion of the plate. A push that
//     ends in a puncture therefore feels exactly the wrench of the force law.
//  3. The damping is at most damping_max() and opposes the plate's motion. Along the direction of
//     the environment's force, the damping can at most cancel this force, so the damping never
//     pulls the hand into a sheet. If part of a negative balance remains, later ticks of the
//     contact remove this part.
//  4. A planned release (a puncture) sets the balance to zero. After a puncture, neither the energy
//     that the sheet lost nor an earlier negative balance causes damping.
//  5. While the required damping is within its bound, a sheet returns to the hand at most the
//     energy that the sheet absorbed plus the work of one tick. Energy that a sheet, a rim or the
//     springs of friction still store does not count as returned. PassivityState::released_max_J
//     records the largest excess of the returned over the absorbed energy.
//  6. A positive balance is capped at credit_max_J. Without the cap, a dissipative environment,
//     such as friction on the shaft, could accumulate a balance that later feeds oscillations.
//     Precondition: the energy that the environment stores exceeds PassivityInput::stored_J by less
//     than credit_max_J.

struct PassivityOptions {
  bool on = true;              ///< if false, the loop adds no damping, not even after a break
  double credit_max_J = 2e-3;  ///< cap of the balance (item 6)
  /// Bound on damping * interval / plate mass, where the damper's velocity is computed over the
  /// interval. A sampled damper is stable while this value is below 2.
  double damping_share = 0.25;
  double damping_max_N_s_per_m = 100;  ///< second bound on the damping
  double length_m = 0.05;              ///< the rotational damping is damping * length_m^2
};

/// Inputs of a tick.
struct PassivityInput {
  Pose T_device_plate;
  Wrench wrench_device = Wrench::Zero();  ///< the environment's wrench on the plate, in {B}
  double stored_J = 0;                    ///< energy in the environment now; 0 without contact
  PreviousPose previous;                  ///< start of the interval for the damper's velocity
  bool planned_release = false;           ///< the force law releases energy on purpose (puncture)
};

/// State kept between ticks.
struct PassivityState {
  bool has_last = false;
  Pose T_device_plate;                  ///< pose of the last tick
  Wrench environment = Wrench::Zero();  ///< wrench of the last tick, without damping
  Wrench delivered = Wrench::Zero();    ///< wrench held since the last tick
  double stored_J = 0;
  double balance_J = 0;          ///< energy balance since the contact began
  double damping_N_s_per_m = 0;  ///< damping of this tick
  /// The wrench with which the last motion would act on a damper of 1 N s/m. (The damper's wrench
  /// on the plate has the opposite sign.)
  Wrench unit_damper = Wrench::Zero();
  double released_max_J = 0;  ///< largest net energy that a contact released to the hand
};

/// Returns the bound of item 3. `dt_s`: interval over which the damper's velocity is computed.
double damping_max(const PassivityOptions& options, double plate_mass_kg, double dt_s) noexcept;

/// Returns the wrench that the caller must render instead of `input.wrench_device`. After that the
/// caller must store the wrench that the motors hold until the next tick in `state.delivered`; the
/// next call accounts for the work of that wrench in the balance. `pose_interval_s`: time between
/// the previous new pose and this pose, on the device's clock. If the pose is not new,
/// `pose_interval_s` is 0, and the damper of the last tick stays unchanged, except that a planned
/// release ends it (item 4). If the hand has turned back since the last new pose, the damper's
/// force, like the force of the environment, may then do work on the hand. The balance cannot
/// prevent this work, because the plate's motion is not known in such a tick. The next new pose
/// shows the whole displacement since the previous new pose. The work of the wrench held last over
/// this displacement, whatever its sign, then enters the balance. If the balance is then negative,
/// damping takes the energy back.
Wrench keep_passive(const PassivityOptions& options, double plate_mass_kg, double pose_interval_s,
                    const PassivityInput& input, PassivityState& state) noexcept;

// Limits the energy that the environment (tissue and coupling) releases to the hand. If the
// environment releases more than the limit, the fault kEnergyLimit is raised. The limit acts
// independently of the passivity controller, which reduces the released energy but cannot bound it.
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
