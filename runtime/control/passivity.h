// SPDX-License-Identifier: Apache-2.0
// Time-domain passivity observer and controller (B. Hannaford,
// J. Ryu, Time-domain passivity control of haptic interfaces, IEEE TRA 18(1), 2002). The observer
// compares the work that the environment (tissue and coupling) has absorbed with the energy that
// the environment stores (J. Ryu, C. Preusche, B. Hannaford, G. Hirzinger, Time domain passivity
// control with reference energy following, IEEE TCST 13(5), 2005).
//
// A wrench held over a tick does the work wrench * (next pose - this pose), which is known exactly
// one tick later. The energy balance is the work that the environment absorbed from the hand minus
// the energy that it stores. If a spring of stiffness K is sampled and held, and the plate moves by
// x in a tick, the balance falls by K x^2 / 2 in this tick, in either direction of motion. A
// negative balance means that the environment generates energy.
//
// Contract (tests/runtime/control/passivity_test.cpp):
//  1. The balance equals the absorbed work minus the stored energy, up to rounding, for any motion.
//  2. As long as the balance is not negative, or the environment only absorbs energy, the wrench is
//     unchanged to the last bit. So a push that ends in a puncture follows the force law exactly.
//  3. The damping is at most damping_max() and opposes the plate's motion. Along the direction of
//     the environment's force, the damping can at most cancel this force, so that the damping
//     never pulls the hand into a sheet. An energy deficit that remains is removed in later ticks
//     of the contact.
//  4. A planned release (a puncture) sets the balance to zero. So neither the energy that the sheet
//     lost nor an earlier deficit causes damping afterwards.
//  5. While the required damping is within its bound, a sheet returns to the hand at most the energy
//     that it absorbed plus the work of one tick. `released_max_J` records any excess. Energy that a
//     sheet, a rim or the springs of friction still store does not count as released.
//  6. A positive balance is capped at credit_max_J. Otherwise a dissipative environment (friction on
//     the shaft) could accumulate energy that later feeds oscillations. Stored energy that the
//     caller does not report must be less than credit_max_J.
#pragma once

#include "runtime/device/pose.h"

namespace trocar::runtime {

struct PassivityOptions {
  bool on = true;
  double reserve_J = 0;        ///< deficit that is tolerated before damping acts
  double credit_max_J = 2e-3;  ///< cap of item 6
  double damping_share =
      0.25;  ///< bound on damping / (plate mass * rate); a sampled damper is stable below 2
  double damping_max_N_s_per_m = 100;
  double length_m = 0.05;  ///< lever that converts an angular velocity to a velocity
};

/// Inputs of a tick.
struct PassivityInput {
  Pose T_device_plate;
  Wrench wrench_device = Wrench::Zero();  ///< the environment's wrench on the plate, in {B}
  double stored_J = 0;                    ///< energy in the environment now; 0 without contact
  PreviousPose previous;                  ///< start of the interval for the damper's velocity
  bool planned_release = false;           ///< the environment is released in this tick (puncture)
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
  Wrench unit_damper =
      Wrench::Zero();         ///< minus the wrench of a damper of 1 N s/m in the last motion
  double released_max_J = 0;  ///< largest net energy that a contact released to the hand
};

/// Returns the bound of item 3.
double damping_max(const PassivityOptions& options, double plate_mass_kg, double dt_s) noexcept;

/// Returns the wrench to render instead of `input.wrench_device`. The caller must call
/// note_delivered() afterwards. `pose_interval_s`: time between the previous new pose and this one,
/// on the device's clock; 0: the pose is not new, and an active damper keeps its force.
Wrench keep_passive(const PassivityOptions& options, double plate_mass_kg, double pose_interval_s,
                    const PassivityInput& input, PassivityState& state) noexcept;

/// Stores the wrench that the motors hold until the next tick; the balance uses its work.
inline void note_delivered(const Wrench& wrench_device, PassivityState& state) noexcept {
  state.delivered = wrench_device;
}

}  // namespace trocar::runtime
