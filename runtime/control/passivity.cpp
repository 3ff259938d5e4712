// SPDX-License-Identifier: Apache-2.0
#include "runtime/control/passivity.h"

#include <algorithm>
#include <utility>

namespace trocar::runtime {
namespace {

/// Returns the environment's wrench with a damper added, which can at most cancel its
/// force (item 3).
Wrench damped(const Wrench& environment, PassivityState& state, double damping_N_s_per_m) noexcept {
  const Eigen::Vector3d force_N = environment.head<3>();
  const double along = force_N.dot(Eigen::Vector3d(state.unit_damper.head<3>()));
  const double force2_N2 = force_N.squaredNorm();
  state.damping_N_s_per_m =
      damping_N_s_per_m * along > force2_N2 ? force2_N2 / along : damping_N_s_per_m;
  return environment - state.damping_N_s_per_m * state.unit_damper;
}

}  // namespace

double damping_max(const PassivityOptions& options, double plate_mass_kg, double dt_s) noexcept {
  return std::min(options.damping_max_N_s_per_m, options.damping_share * plate_mass_kg / dt_s);
}

Wrench keep_passive(const PassivityOptions& options, double plate_mass_kg, double pose_interval_s,
                    const PassivityInput& input, PassivityState& state) noexcept {
  const Twist step = state.has_last ? displacement(state.T_device_plate, input.T_device_plate)
                                    : Twist(Twist::Zero());
  const bool gives = state.environment.dot(step) > 0;
  state.balance_J -= state.delivered.dot(step);
  if (input.planned_release) {
    state.balance_J = 0;
  } else {
    state.balance_J -= input.stored_J - state.stored_J;
  }
  state.has_last = true;
  state.T_device_plate = input.T_device_plate;
  state.environment = input.wrench_device;
  state.stored_J = input.stored_J;
  const double acting_N_s_per_m = std::exchange(state.damping_N_s_per_m, 0);
  state.released_max_J = std::max(state.released_max_J, -state.balance_J - input.stored_J);
  if (input.wrench_device.isZero(0)) {
    state.balance_J = 0;  // there is no contact, so the balance is reset
    return input.wrench_device;
  }
  state.balance_J = std::min(state.balance_J, options.credit_max_J);

  if (!(pose_interval_s > 0)) {
    return damped(input.wrench_device, state, input.planned_release ? 0 : acting_N_s_per_m);
  }
  const double deficit_J = -state.balance_J;
  if (!options.on || !gives || !(deficit_J > 0)) return input.wrench_device;
  const bool is_steady = input.previous.ago_s > 0;
  const Twist moved =
      is_steady ? displacement(input.previous.T_device_plate, input.T_device_plate) : step;
  const double moved_s = is_steady ? input.previous.ago_s : pose_interval_s;
  state.unit_damper << moved.head<3>() / moved_s,
      options.length_m * options.length_m * moved.tail<3>() / moved_s;
  const double most = damping_max(options, plate_mass_kg, moved_s);
  // Energy that a damping of 1 N s/m dissipates in a tick like the last.
  const double dissipated_J = state.unit_damper.dot(step);
  if (is_steady && !(dissipated_J > 0)) return input.wrench_device;  // the last step went backwards
  return damped(input.wrench_device, state,
                deficit_J < most * dissipated_J ? deficit_J / dissipated_J : most);
}

}  // namespace trocar::runtime
