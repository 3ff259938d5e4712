// SPDX-License-Identifier: Apache-2.0
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
// Contract (tests/runtime/control/passivity_test.cpp):
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
#pragma once

#include "runtime/device/pose.h"

namespace trocar::runtime {

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

}  // namespace trocar::runtime
