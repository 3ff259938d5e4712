// SPDX-License-Identifier: Apache-2.0
#include "runtime/control/limits.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace trocar::runtime {

namespace {

/// Returns the tilt of an axis whose upright component is `cosine`; nan if that is nan.
double tilt_rad(double cosine) noexcept {
  return std::acos(std::clamp(cosine, -1.0, 1.0));
}

}  // namespace

// Comparisons are negated so that a value of nan is beyond the limit, and a limit of
// nan always trips.

FaultDetail check_workspace(const SafetyLimits& limits, const Pose& T_device_plate) noexcept {
  for (int i = 0; i < 3; ++i) {
    const double at_m = T_device_plate.p_m[i];
    const auto k = static_cast<std::size_t>(i);
    const bool above = at_m >= limits.workspace_min_m[k];
    if (!(above && at_m <= limits.workspace_max_m[k])) {
      return {Fault::kWorkspace, FaultQuantity::kPlatePosition, i, at_m,
              above ? limits.workspace_max_m[k] : limits.workspace_min_m[k]};
    }
  }
  const double upright = (T_device_plate.q * Eigen::Vector3d::UnitZ()).z();
  const bool good =
      limits.plate_tilt_max_rad >= std::numbers::pi  // no tilt is larger
          ? std::isfinite(upright)
          // A negative limit must be tested separately, because the cosine loses its sign.
          : limits.plate_tilt_max_rad >= 0 && upright >= std::cos(limits.plate_tilt_max_rad);
  if (good) return {};
  return {Fault::kWorkspace, FaultQuantity::kPlateTilt, -1, tilt_rad(upright),
          limits.plate_tilt_max_rad};
}

FaultDetail check_speed(const SafetyLimits& limits, const Pose& T_device_plate, double dt_s,
                        SpeedState& state) noexcept {
  Twist now = Twist::Zero();
  if (state.has_pose) {
    now << (T_device_plate.p_m - state.T_device_plate.p_m) / dt_s,
        rotation_vector(T_device_plate.q * state.T_device_plate.q.conjugate()) / dt_s;
  } else {
    state.twist_device.setZero();
  }
  state.has_pose = true;
  state.T_device_plate = T_device_plate;
  state.twist_device += dt_s / (limits.speed_window_s + dt_s) * (now - state.twist_device);
  const double speed_m_per_s = state.twist_device.head<3>().norm();
  const double rotation_rad_per_s = state.twist_device.tail<3>().norm();
  if (!state.twist_device.allFinite()) state.has_pose = false;
  if (!(limits.speed_window_s >= 0 && speed_m_per_s <= limits.speed_max_m_per_s)) {
    return {Fault::kSpeed, FaultQuantity::kPlateSpeed, -1, speed_m_per_s, limits.speed_max_m_per_s};
  }
  if (!(rotation_rad_per_s <= limits.rotation_rate_max_rad_per_s)) {
    return {Fault::kSpeed, FaultQuantity::kPlateRotation, -1, rotation_rad_per_s,
            limits.rotation_rate_max_rad_per_s};
  }
  return {};
}

}  // namespace trocar::runtime
