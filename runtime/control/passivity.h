// SPDX-License-Identifier: Apache-2.0
// Time-domain passivity observer and controller (B. Hannaford, J. Ryu, Time-domain passivity
// control of haptic interfaces, IEEE TRA 18(1), 2002) with the sheet's own energy as reference
// (J. Ryu, C. Preusche, B. Hannaford, G. Hirzinger, Time domain passivity control with reference
// energy following, IEEE TCST 13(5), 2005).
//
// A force held over a tick does the work wrench * (next pose - this pose): known exactly one
// tick later, and that is the pairing used here. The balance is what the environment took from the
// hand less what it has stored; sampled and held, a spring K loses K (step)^2 / 2 a tick of it,
// whichever way it moves. Below zero, more would be given back than was taken.
//
// Laws (tests/runtime/control/passivity_test.cpp):
//  1. The balance is the work done, to rounding, whatever the motion.
//  2. Nothing is changed while the balance is not negative, nor while the environment only takes:
//     a push that ends in a puncture is felt as the sheet's law says, to the last bit.
//  3. The damping is at most damping_max(), and against the plate's motion.
//  4. A planned release owes nothing: neither what the sheet lost nor what was missing before is
//     held against what follows, and no damping follows it.
//  5. While the damping that is wanted keeps within its bound, a sheet gives to the hand no more
//     than it took, but for the work of one tick. What is beyond is in `given_max_J`.
//  6. What was truly taken is kept as credit up to credit_max_J only, so that an environment that
//     dissipates (a shaft's friction) does not earn the right to oscillate. Storage that the
//     caller does not tell about must stay below that.
#pragma once

#include "runtime/mechanism/pose.h"

namespace trocar::runtime {

struct PassivityOptions {
  bool on = true;
  double reserve_J = 0;         ///< may be given before anything is done
  double credit_max_J = 2e-3;   ///< law 6
  double damping_share = 0.25;  ///< of plate mass * rate: a sampled damper is stable below 2
  double damping_max_N_s_per_m = 100;
  double length_m = 0.05;  ///< turns an angular velocity into a velocity
};

/// What is told about a tick.
struct PassivityInput {
  Pose T_device_plate;
  Wrench wrench_device = Wrench::Zero();  ///< of the environment, on the plate, in {B}
  double stored_J = 0;                    ///< by the environment now; 0 without contact
  bool planned_release = false;           ///< the environment let go in this tick
};

/// Between ticks.
struct PassivityState {
  bool has_last = false;
  Pose T_device_plate;                  ///< of the last tick
  Wrench environment = Wrench::Zero();  ///< likewise: without damping
  Wrench delivered = Wrench::Zero();    ///< held since then
  double stored_J = 0;
  double balance_J = 0;             ///< since the environment was met
  double damping_N_s_per_m = 0;     ///< of this tick
  Wrench against = Wrench::Zero();  ///< of a damper of 1 N s/m, at the last motion
  double given_max_J = 0;           ///< the largest that was ever given and not taken back
};

/// The bound of law 3.
double damping_max(const PassivityOptions& options, double plate_mass_kg, double dt_s) noexcept;

/// The wrench to be rendered in the place of `input.wrench_device`. Call note_delivered() after.
/// `moved_over_s`: the time since the last new pose; 0: there is none in this tick, and a damper
/// that acts goes on as it was.
Wrench keep_passive(const PassivityOptions& options, double plate_mass_kg, double moved_over_s,
                    const PassivityInput& input, PassivityState& state) noexcept;

/// What the motors now hold until the next tick: the balance is about that.
inline void note_delivered(const Wrench& wrench_device, PassivityState& state) noexcept {
  state.delivered = wrench_device;
}

}  // namespace trocar::runtime
