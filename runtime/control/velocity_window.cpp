// SPDX-License-Identifier: Apache-2.0
#include "runtime/control/velocity_window.h"

#include <algorithm>
#include <limits>

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

}  // namespace trocar::runtime
