// SPDX-License-Identifier: Apache-2.0
// The columns of a recording and the fields of its rows. Writing and reading use the same list, so
// that their order agrees. Internal to formats/session.
// Tests: tests/formats/session/recording_test.cpp
#pragma once
#include <array>
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

/// The columns of one file. Files that older versions wrote lack some columns.
struct RecordingColumns {
  std::vector<std::string> names = {};
  RecordingKind kind = {};
  bool has_state_time = true, has_origin = true;
  bool has_break_through = true;  ///< and, if not kind.has_cutting, tip_N
};
RecordingColumns recording_columns(const RecordingKind& kind);
/// The columns that a header line names. `names` is empty if the line is not a recording's header.
RecordingColumns columns_in_header(std::string_view header);

/// Calls a member of the visitor for each field of a row except the origin, in the order of the
/// columns. number() gets any number; finite() gets a number that must not be infinite or nan;
/// flag() gets 0 or 1; bits() gets an integer and the bits that may be set in it; name() gets an
/// enumerator and the list of names.
template <typename Row, typename Visitor>
void visit_fields(Row& row, const RecordingColumns& columns, Visitor& visitor) {
  visitor.finite(row.t_s);
  visitor.finite(row.p_m);
  visitor.finite(row.q);
  visitor.finite(row.tool_m);
  visitor.finite(row.wrench_wanted);
  visitor.finite(row.wrench_delivered);
  if (columns.kind.has_pose_device) {
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
  if (columns.has_state_time) visitor.finite(row.state_t_s);
  visitor.name(row.device_write, kDeviceStatusNames);
  visitor.name(row.outside_fault, fault_names());
  visitor.flag(row.recovery_asked);
  visitor.name(row.safety, kSafetyNames);
  visitor.finite(row.authority);
  visitor.finite(row.passivity_J);
  visitor.finite(row.passivity_N_s_per_m);
  visitor.finite(row.motor_heat_max);
  if (columns.kind.has_xray) visitor.bits(row.xray, kXrayPicture | kXrayBeam);
  if (columns.kind.has_cutting) {
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
  } else if (columns.has_break_through) {
    visitor.finite(row.tip_N);
  }
  if (columns.has_break_through) {
    visitor.finite(row.break_through_N);
    visitor.number(row.break_through_at);
  }
}

}  // namespace trocar
