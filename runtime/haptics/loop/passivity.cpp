// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/loop/passivity.h"

namespace trocar::runtime {
namespace {

/// A state is on time if it comes at most this many periods after the one before.
constexpr double kOnTime = 1.01;
/// Shortest interval before the last one that is extrapolated, in periods. If the time stamp between
/// the two is off by half a period, the extrapolation still has the sign of the motion.
constexpr double kLeastBefore = 0.5;
/// Smallest ratio of the interval before the last one to the last interval, for encoders that are
/// not exact. A smaller ratio would amplify their noise.
constexpr double kMinBefore = 0.5;

/// Range of the slopes of lines through an encoder's newest reading that are within a count of all
/// readings so far.
struct Slopes {
  double min_per_s = -std::numeric_limits<double>::infinity();
  double max_per_s = std::numeric_limits<double>::infinity();
};

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

void VelocityWindow::add(const Measurement& measured, const Pose& T_device_plate) noexcept {
  ring_[static_cast<std::size_t>(next_)] = {measured, T_device_plate};
  next_ = (next_ + 1) % static_cast<int>(ring_.size());
  count_ = std::min(count_ + 1, static_cast<int>(ring_.size()));
}

PreviousPose VelocityWindow::begin(double resolution, double period_s) const noexcept {
  if (!(resolution > 0)) return late_begin(period_s, 0);
  const PreviousPose begin = steady_begin(resolution);
  return begin.ago_s > 0 ? begin : late_begin(period_s, kMinBefore);
}

/// Applies item 4, unless the interval before the last one is shorter than kLeastBefore periods, or
/// than `min_before` times the last one.
PreviousPose VelocityWindow::late_begin(double period_s, double min_before) const noexcept {
  PreviousPose begin;
  if (count_ < 3) return begin;
  const Sample &now = ago(0), &last = ago(1), &before = ago(2);
  const double last_s = now.state.t_s - last.state.t_s;
  const double before_s = last.state.t_s - before.state.t_s;
  const double least_before_s = std::max(kLeastBefore * period_s, min_before * last_s);
  if (!(last_s > period_s * kOnTime && before_s >= least_before_s)) return begin;
  const Twist step = displacement(last.T_device_plate, now.T_device_plate);
  const Twist step_before = displacement(before.T_device_plate, last.T_device_plate);
  const Twist moved =
      step + (last_s - period_s) / (last_s + before_s) * (step - last_s / before_s * step_before);
  begin.ago_s = last_s;
  begin.T_device_plate.p_m = now.T_device_plate.p_m - moved.head<3>();
  begin.T_device_plate.q =
      (from_rotation_vector(-moved.tail<3>()) * now.T_device_plate.q).normalized();
  return begin;
}

/// Applies items 2 and 3.
PreviousPose VelocityWindow::steady_begin(double resolution) const noexcept {
  PreviousPose begin;
  const double within = resolution * (1 + 1e-9);  // allows for rounding
  const Measurement& now = ago(0).state;
  std::array<Slopes, kMaxMeasured> slopes;
  for (int n = 1; n < count_; ++n) {
    const Sample& then = ago(n);
    const double ago_s = now.t_s - then.state.t_s;
    for (std::size_t i = 0; i < static_cast<std::size_t>(now.count); ++i) {
      const double moved = now.value[i] - then.state.value[i];
      const double slope = moved / ago_s;
      // Negated so that nan ends the window.
      if (!(slope >= slopes[i].min_per_s && slope <= slopes[i].max_per_s)) return begin;
      slopes[i].min_per_s = std::max(slopes[i].min_per_s, (moved - within) / ago_s);
      slopes[i].max_per_s = std::min(slopes[i].max_per_s, (moved + within) / ago_s);
    }
    if (n > 1) begin = {then.T_device_plate, ago_s};
  }
  return begin;
}

double damping_max(const PassivityOptions& options, double plate_mass_kg, double dt_s) noexcept {
  return std::min(options.damping_max_N_s_per_m, options.damping_share * plate_mass_kg / dt_s);
}

Wrench keep_passive(const PassivityOptions& options, double plate_mass_kg, double pose_interval_s,
                    const PassivityInput& input, PassivityState& state) noexcept {
  const Twist step = state.has_last ? displacement(state.T_device_plate, input.T_device_plate)
                                    : Twist(Twist::Zero());
  const bool gives = state.environment.dot(step) > 0;
  state.balance_J -= state.delivered.dot(step);
  if (input.planned_release)
    state.balance_J = 0;
  else
    state.balance_J -= input.stored_J - state.stored_J;
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

  if (!(pose_interval_s > 0))
    return damped(input.wrench_device, state, input.planned_release ? 0 : acting_N_s_per_m);
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
