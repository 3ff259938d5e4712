// SPDX-License-Identifier: Apache-2.0
// The guard against a contact that oscillates by itself, because the device is slower, noisier or
// lighter than its description says.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "runtime/device/device.h"

namespace trocar::runtime {

// The guard multiplies the law's wrench by a factor, which is 1 unless it has acted. It only takes
// force away, and a contact of which the description is true never makes it act. It is no fault.
//
// Laws, for the estimated twist of the plate (estimator.h):
//  1. A half-cycle of an axis lasts from a change of sign of its speed to the next; speeds within
//     the noise band and ways of a few steps of the readings do not count. The factor goes to
//     kGuardOscillation times itself after kGuardHalfCycles in a row, each shorter than half a
//     period of kGuardFrom_Hz and with force in it, of which the last two have peaks of at least
//     kGuardDecay times the first two. A peak of more than kGuardKick times the one before is a
//     kick, from which on they are counted anew.
//  2. A throw is a contact of more than four ticks but shorter than half a period of kGuardFrom_Hz
//     after which the plate leaves along the force more than kGuardReturn times faster than it came
//     and twice the noise band. A hand that jerks back does so too, so it takes a second one within
//     kGuardAgain_s: the factor goes to kGuardThrow times itself.
//  3. The factor falls by at most kGuardFall_per_s, and not below kGuardLeast. It rises, by at most
//     kGuardRise_per_s, only without contact, and kGuardPause_s after the guard last acted: more
//     stiffness in contact would give energy.
inline constexpr int kGuardHalfCycles = 8;
inline constexpr double kGuardFrom_Hz = 12, kGuardDecay = 0.95, kGuardReturn = 1.1,
                        kGuardKick = 1.5, kGuardAgain_s = 0.5;
inline constexpr double kGuardOscillation = 0.7, kGuardThrow = 0.5, kGuardLeast = 0.02;
inline constexpr double kGuardFall_per_s = 6, kGuardRise_per_s = 2, kGuardPause_s = 1;

struct GuardInput {
  double interval_s = 1e-3;
  Twist twist_device = Twist::Zero();
  Wrench wrench_device = Wrench::Zero();  ///< of the law
  /// Speeds up to which an axis counts as at rest: translation, and rotation.
  double band_m_per_s = 5e-3, band_rad_per_s = 0.1;
  /// Ways, from turn to turn, up to which a half-cycle is that of rounded readings.
  double way_m = 0, way_rad = 0;
};

struct GuardState {
  struct Axis {
    int sign = 0, half_cycles = 0;
    double since_s = 0, peak = 0;
    std::array<double, kGuardHalfCycles> peaks{};  ///< of the last half-cycles, a ring
    bool has_touched = false;
  };
  std::array<Axis, 6> axes;
  bool is_in_contact = false;
  Eigen::Vector3d away = Eigen::Vector3d::Zero();          ///< direction of the last force
  double contact_s = 0, came_m_per_s = 0, thrown_s = 1e9;  ///< thrown_s: since the last throw
  double quiet_s = 1e9;                                    ///< since the guard last acted
  double wanted = 1, factor = 1;
  std::uint32_t acted = 0;  ///< how often
};

/// Takes a tick in `running`; the factor is then in `state`. Realtime-safe.
void guard_contact(const GuardInput& input, GuardState& state) noexcept;

}  // namespace trocar::runtime
