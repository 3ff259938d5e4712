// SPDX-License-Identifier: Apache-2.0
#include "runtime/control/break_damper.h"

#include <algorithm>

#include "runtime/contact/puncture.h"

namespace trocar::runtime {
namespace {

/// Returns the coefficient now.
double coefficient(const BreakDamperState& state) noexcept {
  const double left = state.left_s / kBreakDamping_s;
  return state.start_N_s_per_m * left * (2 - left);
}

}  // namespace

Wrench damp_break(const PassivityOptions& options, double plate_mass_kg, const Tool& tool,
                  const BreakInput& input, BreakDamperState& state) noexcept {
  const Pose& plate = input.T_device_plate;
  const Eigen::Vector3d tip_m = plate * tool.tip_plate_m;
  const Eigen::Vector3d outward = plate.q * tool.axis_plate;
  state.left_s = std::max(0.0, state.left_s - input.pose_interval_s);
  if (const double after_N_s_per_m = input.lost_force_N / kBreakSpeed_m_per_s;
      after_N_s_per_m > coefficient(state)) {
    state.start_N_s_per_m = after_N_s_per_m;
    state.left_s = kBreakDamping_s;
  }
  if (input.pose_interval_s > 0) {
    const bool is_steady = input.previous.ago_s > 0;
    const Pose& start = is_steady ? input.previous.T_device_plate : state.T_device_plate;
    const double moved_s = is_steady ? input.previous.ago_s : input.pose_interval_s;
    const double inward_m =
        state.has_last ? std::max(0.0, outward.dot(start * tool.tip_plate_m - tip_m)) : 0;
    state.target_N = std::min(coefficient(state), damping_max(options, plate_mass_kg, moved_s)) *
                     std::min(inward_m / moved_s, kBreakSpeed_m_per_s);
    state.has_last = true;
    state.T_device_plate = plate;
  }
  const double lost_N = kBreakSpeed_m_per_s * state.start_N_s_per_m, step_N = kBreakStep * lost_N;
  state.force_N =
      std::clamp(state.target_N, std::max(0.0, state.force_N - step_N), state.force_N + step_N);
  return wrench_at(state.force_N * outward, tip_m, plate);
}

}  // namespace trocar::runtime
