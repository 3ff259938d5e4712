// SPDX-License-Identifier: Apache-2.0
// The columns of a recording and the fields of its rows. Writing and reading use the same list, so
// that their order agrees. Internal to formats/session.
#pragma once
#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "formats/session/recording.h"

namespace trocar {

inline constexpr std::array<const char*, 5> kPhaseNames = {"free", "contact", "punctured", "beside",
                                                           "fault"};
inline constexpr std::array<const char*, kSafetyStates> kSafetyNames = {"idle", "ready", "running",
                                                                        "fault", "recovering"};
inline constexpr std::array<const char*, kRecordedDeviceStatuses> kDeviceStatusNames = {
    "ok", "no_data", "link_lost", "emergency_stop", "motor_fault"};
const std::array<const char*, kFaults>& fault_names();

/// Names of the columns, in order.
std::vector<std::string> recording_columns(const RecordingKind& kind);
/// The kind of recording that has this header line, if any.
std::optional<RecordingKind> kind_of_header(std::string_view header);

/// Calls a member of the visitor for each field of a row except the origin, in the order of the
/// columns. number() gets any number; finite() gets a number that must not be infinite or nan;
/// flag() gets 0 or 1; bits() gets an integer and the bits that may be set in it; name() gets an
/// enumerator and the list of names.
template <typename Row, typename Visitor>
void visit_fields(Row& row, const RecordingKind& kind, Visitor& visitor) {
  visitor.finite(row.t_s);
  visitor.finite(row.p_m);
  visitor.finite(row.q);
  visitor.finite(row.tool_m);
  visitor.finite(row.wrench_wanted);
  visitor.finite(row.wrench_delivered);
  if (kind.has_pose_device) {
    for (auto& at_m : row.pose_device.p_m)
      visitor.number(at_m);
    for (auto& component : row.pose_device.q)
      visitor.number(component);
    visitor.number(row.pose_device.buttons);
    visitor.finite(row.pose_device.wrench);
  } else {
    visitor.finite(row.tau_Nm);
    for (auto& angle_rad : row.encoder_rad)
      visitor.number(angle_rad);
  }
  visitor.name(row.phase, kPhaseNames);
  visitor.number(row.active_slice);
  visitor.finite(row.penetration_m);
  visitor.finite(row.wrench_scale);
  visitor.finite(row.pose_residual_m);
  visitor.number(row.cuts_published);
  visitor.number(row.response_sheet);
  visitor.number(row.response_stiffness_N_per_m);
  for (auto& offset_m : row.response_offset_m)
    visitor.number(offset_m);
  visitor.name(row.fault, fault_names());
  visitor.name(row.device_read, kDeviceStatusNames);
  visitor.finite(row.state_t_s);
  visitor.name(row.device_write, kDeviceStatusNames);
  visitor.name(row.outside_fault, fault_names());
  visitor.flag(row.recovery_asked);
  visitor.name(row.safety, kSafetyNames);
  visitor.finite(row.authority);
  visitor.finite(row.passivity_J);
  visitor.finite(row.passivity_N_s_per_m);
  visitor.finite(row.motor_heat_max);
  if (kind.has_xray) visitor.bits(row.xray, kXrayPicture | kXrayBeam);
  if (kind.has_cutting) {
    auto& cutting = row.cutting;
    visitor.finite(cutting.wrench_tissue);
    visitor.finite(cutting.front_z_m);
    visitor.finite(cutting.front_HU);
    visitor.finite(row.tip_N);
    visitor.finite(cutting.embedded_m);
    visitor.finite(cutting.cut_J);
    visitor.finite(cutting.absorbed_J);
    visitor.finite(cutting.stored_J);
    visitor.number(cutting.steps);
  } else {
    visitor.finite(row.tip_N);
  }
  visitor.finite(row.break_through_N);
  visitor.number(row.break_through_at);
}

}  // namespace trocar
