// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/loop/break_through.h"

namespace trocar::runtime {
namespace {

using Phase = BreakThroughState::Phase;

void note_punctures(const ContactOutput& contact, BreakThroughState& state) noexcept {
  if (contact.layers_punctured != 0) {
    state.layer = static_cast<std::int32_t>(std::bit_width(contact.layers_punctured)) - 1;
    state.sheet = -1;
  }
  std::int32_t lowest = -1;
  for (const CutRequest& cut : contact.cuts())
    if (cut.is_puncture) lowest = std::max(lowest, cut.sheet);
  if (lowest < 0) return;
  state.sheet = lowest;
  state.layer = -1;
}

/// Law 1. Returns the change of d'.
double follow(const BreakThroughInput& input, BreakThroughState& state,
              BreakThroughTick& out) noexcept {
  double step_m = 0;
  if (std::exchange(state.has_last, true)) {
    step_m = (input.tip_m - state.tip_m).dot(input.inward);
    state.h_m += (input.plate_tip_m - state.plate_tip_m).dot(input.inward);
  }
  state.tip_m = input.tip_m;
  state.plate_tip_m = input.plate_tip_m;
  const double change_m = state.tip.move_to(state.tip.at_m + step_m);
  out.advance_m = std::max(0.0, change_m);
  out.comes_back = change_m < 0;
  if (change_m != 0) {
    const double hand_m = std::exchange(state.h_m, 0);
    out.hand_m = change_m > 0 ? hand_m : 0;
  }
  const double part = -std::expm1(-input.interval_s / kBreakFilter_s);
  state.filtered_N += part * (input.contact.force_N - state.filtered_N);
  return state.filtered.move_to(state.filtered.at_m +
                                part * (state.tip.at_m - state.filtered.at_m));
}

/// Law 3, and the end of a fall by law 4. `change_m`: of d', limited as law 3 says.
void follow_reference(double change_m, BreakThroughState& state) noexcept {
  if (change_m < 0) {
    state.phase = Phase::kLoaded;
    state.reference_N = state.mean_loss = state.run_m = state.run_hand_m = 0;
  }
  if (state.phase != Phase::kLoaded) {
    state.least_N = std::min(state.least_N, state.filtered_N);
    state.fallen_for_m += std::max(0.0, change_m);
    const double bears_N = state.phase == Phase::kFallen
                               ? kBreakRise * (state.least_N + kBreakNoise_N)
                               : 0.97 * (state.reference_N + kBreakNoise_N);
    if (state.filtered_N + kBreakNoise_N < bears_N && state.fallen_for_m < kBreakReach_m) return;
    state.phase = Phase::kLoaded;
    state.reference_N = state.mean_loss = 0;
  }
  state.reference_N = std::max(
      state.filtered_N, state.reference_N * std::exp(-std::max(0.0, change_m) / kBreakReach_m));
}

/// Fraction of the coefficient and of the lost force now.
double course(const BreakDamperState& state) noexcept {
  const double left = state.left_s / kBreakDamping_s;
  return left * (2 - left);
}

}  // namespace

double loss_of_resistance(double force_N, double reference_N) noexcept {
  const double left = 2 * (force_N + kBreakNoise_N) / (reference_N + kBreakNoise_N);
  const double square = left * left;
  return 1 / (1 + square * square * square);
}

double BreakDepth::move_to(double to_m) noexcept {
  at_m = to_m;
  const double before_m = depth_m;
  depth_m = std::clamp(depth_m, at_m, at_m + kBreakBack_m);
  return depth_m - before_m;
}

BreakThroughTick find_break_through(const BreakThroughInput& input,
                                    BreakThroughState& state) noexcept {
  const ContactOutput& contact = input.contact;
  BreakThroughTick out;
  out.is_running = true;
  out.force_N = contact.force_N;
  note_punctures(contact, state);
  const double change_m = follow(input, state, out);
  follow_reference(std::min(change_m, kBreakFeed_m_per_s * input.interval_s), state);
  if (contact.is_released) {
    const double before_N = contact.force_before_N > 0 ? contact.force_before_N  //
                                                       : contact.trial_force_N;
    state.reference_N = std::max(before_N, state.filtered_N);
    state.phase = Phase::kLoaded;
    state.mean_loss = 1;
  } else if (change_m > 0) {
    const double loss = loss_of_resistance(state.filtered_N, state.reference_N);
    state.mean_loss -= (loss - state.mean_loss) * std::expm1(-change_m / kBreakRun_m);
  }
  const ResistanceFall fall{state.reference_N, state.run_m, state.run_hand_m,
                            state.sheet < 0 && state.layer < 0 ? contact.active_sheet : state.sheet,
                            state.layer};
  if (state.phase == Phase::kLoaded && state.mean_loss >= kFallBegins) {
    out.begun = fall;
    state.phase = Phase::kFalling;
    state.least_N = state.filtered_N;
    state.fallen_for_m = 0;
  }
  if (state.phase == Phase::kFalling && state.mean_loss >= 0.5) {
    out.found = fall;
    state.phase = Phase::kFallen;
    state.fallen_for_m = 0;
  }
  const double loss = loss_of_resistance(contact.force_N, state.reference_N);
  const double kept = std::exp(-input.interval_s / kBreakMemory_s);
  state.run_m = kept * state.run_m + loss * out.advance_m;
  state.run_hand_m = kept * state.run_hand_m + loss * out.hand_m;
  return out;
}

double damping_max(double plate_mass_kg, double interval_s) noexcept {
  constexpr double kShare = 0.25, kMost_N_s_per_m = 100;
  return std::min(kMost_N_s_per_m, kShare * plate_mass_kg / interval_s);
}

Wrench damp_break(double plate_mass_kg, const Tool& tool, const BreakInput& input,
                  BreakDamperState& state) noexcept {
  state.left_s = std::max(0.0, state.left_s - input.interval_s);
  if (input.lost_force_N > course(state) * state.lost_N) {
    state.lost_N = input.lost_force_N;
    state.left_s = kBreakDamping_s;
  }
  const Pose& plate = input.T_device_plate;
  const Eigen::Vector3d lever_m = plate.q * tool.tip_plate_m, outward = plate.q * tool.axis_plate;
  const Eigen::Vector3d velocity =
      input.twist_device.head<3>() + input.twist_device.tail<3>().cross(lever_m);
  const double most_N = course(state) * state.lost_N;
  const double damping =
      std::min(most_N / kBreakSpeed_m_per_s, damping_max(plate_mass_kg, input.interval_s));
  const double wanted_N = std::min(damping * std::max(0.0, -outward.dot(velocity)), most_N);
  const double step_N = state.lost_N * input.interval_s / kBreakSlew_s;
  state.force_N =
      std::min(std::clamp(wanted_N, state.force_N - step_N, state.force_N + step_N), most_N);
  return wrench_at(state.force_N * outward, plate.p_m + lever_m, plate);
}

}  // namespace trocar::runtime
