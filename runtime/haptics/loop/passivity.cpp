// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/loop/passivity.h"

namespace trocar::runtime {
void observe_passivity(const PassivityInput& input, PassivityState& state) noexcept {
  if (state.has_last)
    state.balance_J -=
        state.delivered.dot(displacement(state.T_device_plate, input.T_device_plate));
  if (input.planned_release)
    state.balance_J = 0;
  else
    state.balance_J -= input.stored_J - state.stored_J;
  state.has_last = true;
  state.T_device_plate = input.T_device_plate;
  state.stored_J = input.stored_J;
  state.released_max_J = std::max(state.released_max_J, -state.balance_J - input.stored_J);
  if (input.wrench_device.isZero(0)) state.balance_J = 0;
}

FaultDetail EnergyAccount::check(const SafetyLimits& limits, double rate_Hz,
                                 const EnergyInput& input) noexcept {
  if (input.new_pose) {
    if (has_last_ && delivered_ticks_ > 0) {
      work_J_ +=
          delivered_.dot(displacement(T_device_plate_, input.T_device_plate)) / delivered_ticks_;
    }
    T_device_plate_ = input.T_device_plate;
    has_last_ = true;
    delivered_.setZero();
    delivered_ticks_ = 0;
  }
  ++tick_;

  const double ticks = std::floor(kEnergyWindow_s * rate_Hz + 1e-9);
  const auto window = static_cast<std::int64_t>(std::clamp(ticks, 1.0, kEnergyTicks - 1.0));
  while (count_ > 0 && entry(0).tick < tick_ - window) {
    first_ = (first_ + 1) % kEnergyTicks;
    --count_;
  }
  // Comparisons with nan are false, so the queue would hide finite excesses behind such an entry.
  if (!std::isfinite(work_J_) || !std::isfinite(input.stored_J))
    return {Fault::kEnergyLimit, FaultQuantity::kReleasedEnergy, -1,
            std::numeric_limits<double>::quiet_NaN(), limits.energy_limit_J};
  if (!input.is_released) {
    const double energy_J = work_J_ + input.stored_J;
    while (count_ > 0 && entry(count_ - 1).energy_J >= energy_J)
      --count_;
    entry(count_++) = {tick_, energy_J};
  }
  excess_J_ = count_ > 0 ? std::max(0.0, work_J_ - entry(0).energy_J) : 0;
  // Negated so that a limit of nan always trips.
  if (excess_J_ <= limits.energy_limit_J) return {};
  return {Fault::kEnergyLimit, FaultQuantity::kReleasedEnergy, -1, excess_J_,
          limits.energy_limit_J};
}

void EnergyAccount::reset() noexcept {
  has_last_ = false;
  delivered_.setZero();
  delivered_ticks_ = 0;
  work_J_ = 0;
  first_ = count_ = 0;
}

}  // namespace trocar::runtime
