// SPDX-License-Identifier: Apache-2.0
// The loop's limits by their names in the stress cases of the device. The seeds of fuzz_device
// refer to them by index, so the order must not change.
#pragma once

#include <utility>
#include <vector>

#include "runtime/device/four_legs/mechanism_limits.h"
#include "runtime/haptics/loop/safety.h"

namespace trocar::test {

inline std::vector<std::pair<const char*, double*>> limits_by_name(runtime::SafetyLimits& l,
                                                                   runtime::MechanismLimits& m) {
  return {{"encoder_rate_max_rad_per_s", &m.encoder_rate_max_rad_per_s},
          {"pose_residual_max_m", &m.pose_residual_max_m},
          {"theta4_residual_max_rad", &m.theta4_residual_max_rad},
          {"inverse_condition_min", &m.inverse_condition_min},
          {"branch_distance_min_m", &m.branch_distance_min_m},
          {"workspace_min_x_m", &l.workspace_min_m[0]},
          {"workspace_max_z_m", &l.workspace_max_m[2]},
          {"plate_tilt_max_rad", &l.plate_tilt_max_rad},
          {"speed_max_m_per_s", &l.speed_max_m_per_s},
          {"rotation_rate_max_rad_per_s", &l.rotation_rate_max_rad_per_s},
          {"speed_window_s", &l.speed_window_s},
          {"torque_max_Nm", &m.torque_max_Nm},
          {"torque_rise_max_Nm_per_s", &m.torque_rise_max_Nm_per_s},
          {"torque_rise_time_max_s", &m.torque_rise_time_max_s},
          {"overload_scale_min", &m.overload_scale_min},
          {"overload_time_max_s", &m.overload_time_max_s},
          {"no_data_max_s", &l.no_data_max_s},
          {"gap_max_s", &l.gap_max_s},
          {"ramp_s", &l.timing.ramp_s},
          {"workspace_min_y_m", &l.workspace_min_m[1]},
          {"workspace_min_z_m", &l.workspace_min_m[2]},
          {"workspace_max_x_m", &l.workspace_max_m[0]},
          {"workspace_max_y_m", &l.workspace_max_m[1]},
          {"quiet_s", &l.timing.quiet_s},
          {"ramp_up_s", &l.timing.ramp_up_s},
          {"energy_limit_J", &l.energy_limit_J}};
}

}  // namespace trocar::test
