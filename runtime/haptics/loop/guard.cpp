// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/loop/guard.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace trocar::runtime {
namespace {

constexpr double kHalfCycle_s = 0.5 / kGuardFrom_Hz;

/// Returns true if the axis has oscillated for kGuardHalfCycles half-cycles (law 1).
bool oscillates(double speed, double band, double way, bool touches, double interval_s,
                GuardState::Axis& axis) noexcept {
  axis.since_s += interval_s;
  axis.peak = std::max(axis.peak, std::abs(speed));
  axis.has_touched = axis.has_touched || touches;
  if (!(std::abs(speed) > band)) return false;
  const int sign = speed > 0 ? 1 : -1;
  if (sign == axis.sign) return false;
  const double gone = 2 / std::numbers::pi * axis.peak * axis.since_s;  // of a sine
  const bool counts =
      axis.sign != 0 && axis.has_touched && axis.since_s < kHalfCycle_s && gone > way;
  const auto peak = [&](int i) -> double& {
    return axis.peaks[static_cast<std::size_t>(i % kGuardHalfCycles)];
  };
  const bool is_kicked =
      axis.half_cycles > 0 && axis.peak > kGuardKick * peak(axis.half_cycles - 1);
  if (!counts || is_kicked) axis.half_cycles = 0;
  const int k = axis.half_cycles;
  if (counts) peak(axis.half_cycles++) = axis.peak;
  axis.sign = sign;
  axis.peak = axis.since_s = 0;
  axis.has_touched = touches;
  // The ring's oldest two follow the latest one.
  if (k < kGuardHalfCycles - 1 || peak(k) + peak(k - 1) < kGuardDecay * (peak(k + 1) + peak(k + 2)))
    return false;
  axis.half_cycles = 0;
  return true;
}

/// Returns true if the contact that ends in this tick is the second that has thrown the plate back
/// (law 2).
bool throws_back(const GuardInput& input, GuardState& state) noexcept {
  const Eigen::Vector3d force_N = input.wrench_device.head<3>();
  const Eigen::Vector3d velocity = input.twist_device.head<3>();
  const double size_N = force_N.norm();
  const bool touches = size_N > 0, began = touches && !state.is_in_contact,
             ended = !touches && state.is_in_contact;
  state.is_in_contact = touches;
  if (touches) state.away = force_N / size_N;
  const double outward = velocity.dot(state.away);
  if (began) {
    state.came_m_per_s = std::max(0.0, -outward);
    state.contact_s = 0;
  }
  state.contact_s += input.interval_s;
  constexpr double kLeastTicks = 4;  // less is noise at the surface
  state.thrown_s += input.interval_s;
  const bool is_thrown = ended && state.contact_s < kHalfCycle_s &&
                         state.contact_s > (kLeastTicks + 0.5) * input.interval_s &&
                         outward > kGuardReturn * state.came_m_per_s + 2 * input.band_m_per_s;
  return is_thrown && std::exchange(state.thrown_s, 0) < kGuardAgain_s;
}

}  // namespace

void guard_contact(const GuardInput& input, GuardState& state) noexcept {
  state.quiet_s += input.interval_s;
  const bool touches = !input.wrench_device.isZero(0);
  double take = 1;
  for (int i = 0; i < 6; ++i) {
    const double band = i < 3 ? input.band_m_per_s : input.band_rad_per_s;
    const double way = i < 3 ? input.way_m : input.way_rad;
    if (oscillates(input.twist_device[i], band, way, touches, input.interval_s,
                   state.axes[static_cast<std::size_t>(i)]))
      take = kGuardOscillation;
  }
  if (throws_back(input, state)) take = kGuardThrow;
  if (take < 1) {
    state.wanted = std::max(kGuardLeast, take * state.wanted);
    state.quiet_s = 0;
    ++state.acted;
  }
  if (!touches && state.quiet_s > kGuardPause_s)
    state.wanted = std::min(1.0, state.wanted + kGuardRise_per_s * input.interval_s);
  // Up only by the line above, and down gradually.
  state.factor = std::max(state.wanted, state.factor - kGuardFall_per_s * input.interval_s);
}

}  // namespace trocar::runtime
