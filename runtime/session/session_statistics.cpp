// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/session_statistics.h"

namespace trocar::runtime {
namespace {

constexpr double kCharacteristicLength_m = 0.05;

double wrench_norm(const std::array<double, 6>& w) noexcept {
  double sum = 0;
  for (int i = 0; i < 3; ++i)
    sum += w[i] * w[i];
  for (int i = 3; i < 6; ++i)
    sum += w[i] * w[i] / (kCharacteristicLength_m * kCharacteristicLength_m);
  return std::sqrt(sum);
}

template <std::size_t N>
bool same_bits(const std::array<double, N>& a, const std::array<double, N>& b) noexcept {
  using Bits = std::array<std::uint64_t, N>;
  return std::bit_cast<Bits>(a) == std::bit_cast<Bits>(b);
}

}  // namespace

SessionStatistics::SessionStatistics(std::span<const RecordingRow> replay) : replay_(replay) {
  report_.punctures.reserve(kMaxListedPunctures);
  report_.break_throughs.reserve(kMaxListedPunctures);
  report_.faults.reserve(kMaxListedFaults);
}

void SessionStatistics::on_break_through(const BreakThroughEvent& found) noexcept {
  if (report_.break_throughs.size() < kMaxListedPunctures) report_.break_throughs.push_back(found);
}

void SessionStatistics::on_puncture(const PunctureEvent& puncture) noexcept {
  if (report_.punctures.size() < kMaxListedPunctures)
    report_.punctures.push_back(puncture);
  else
    ++report_.punctures_not_listed;
}

void SessionStatistics::on_tick(const TickView& tick) noexcept {
  const RecordingRow& row = tick.result.row;
  count_faults(tick);
  compare_with_replay(tick);
  report_.xray.add(row);
  report_.guard_least = std::min(report_.guard_least, row.guard);
  if (row.guard < 1) ++report_.guarded_ticks;
  for (const double tau : row.tau_Nm)
    report_.torque_max_Nm = std::max(report_.torque_max_Nm, std::abs(tau));
  const std::array<double, 6>& felt = row.wrench_delivered;
  report_.max_force_N = std::max(report_.max_force_N, std::hypot(felt[0], felt[1], felt[2]));
  if (row.authority >= 1) measure_wrench(row);  // otherwise forces are off or ramped up
}

void SessionStatistics::count_faults(const TickView& tick) noexcept {
  const RecordingRow& row = tick.result.row;
  FaultEvent* last = report_.faults.empty() || report_.faults_count > kMaxListedFaults
                         ? nullptr
                         : &report_.faults.back();
  if (tick.result.new_fault != Fault::kNone) {
    last = nullptr;
    if (++report_.faults_count <= kMaxListedFaults) {
      last = &report_.faults.emplace_back(
          FaultEvent{tick.result.new_fault, tick.result.found, row.t_s});
    }
  }
  if (last == nullptr) return;
  if (tick.result.torques_are_zero && last->torques_zero_t_s < 0) last->torques_zero_t_s = row.t_s;
  if (last->recovered_t_s < 0 && row.safety == SafetyState::kRunning) last->recovered_t_s = row.t_s;
}

void SessionStatistics::compare_with_replay(const TickView& tick) noexcept {
  if (replay_.empty() || report_.replay_first_difference >= 0) return;
  const RecordingRow& row = tick.result.row;
  const RecordingRow& old = replay_[tick.state.tick - 1];
  if (!same_bits(old.tau_Nm, row.tau_Nm) ||
      !same_bits(old.pose_device.wrench, row.pose_device.wrench) || old.fault != row.fault ||
      old.cuts_published != row.cuts_published)
    report_.replay_first_difference = static_cast<std::int64_t>(tick.state.tick - 1);
}

void SessionStatistics::measure_wrench(const RecordingRow& row) noexcept {
  if (row.wrench_scale < 1) ++report_.scaled_ticks;
  const double wanted = wrench_norm(row.wrench_wanted);
  if (!(wanted > 0)) return;
  std::array<double, 6> difference;
  for (std::size_t i = 0; i < difference.size(); ++i)
    difference[i] = row.wrench_delivered[i] - row.wrench_wanted[i];
  report_.wrench_error_max = std::max(report_.wrench_error_max, wrench_norm(difference) / wanted);
}

SessionResult SessionStatistics::take(const LoopState& state, bool is_complete) {
  const Safety& safety = state.safety;
  report_.ticks = state.tick;
  report_.fault = safety.fault;
  report_.fault_t_s = safety.fault_t_s;
  report_.energy_released_max_J = state.passivity.released_max_J;
  const bool has_failed = is_failure(safety.fault);
  report_.end = has_failed    ? SessionEnd::kFault
                : is_complete ? SessionEnd::kDone
                              : SessionEnd::kInterrupted;
  return std::move(report_);
}

}  // namespace trocar::runtime
