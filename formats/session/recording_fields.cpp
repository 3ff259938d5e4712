// SPDX-License-Identifier: Apache-2.0
#include "formats/session/recording_fields.h"

#include "formats/base/text_line.h"
#include "formats/session/fault_words.h"

namespace trocar {
namespace {

/// Columns of the force law `cutting`.
constexpr std::array<const char*, 14> kCuttingColumns = {
    "fx_tissue_N",  "fy_tissue_N", "fz_tissue_N",     "tx_tissue_Nm", "ty_tissue_Nm",
    "tz_tissue_Nm", "front_z_m",   "front_HU",        "tip_N",        "embedded_m",
    "cut_J",        "absorbed_J",  "tissue_stored_J", "steps"};

/// Appends the columns of a wrench, such as fx_wanted_N.
void add_wrench(const std::string& which, std::vector<std::string>& columns) {
  for (const char* axis : {"fx", "fy", "fz"})
    columns.push_back(std::string(axis) + "_" + which + "_N");
  for (const char* axis : {"tx", "ty", "tz"})
    columns.push_back(std::string(axis) + "_" + which + "_Nm");
}

/// Appends the columns of the four-legged device's motors and encoders.
void add_joints(std::vector<std::string>& columns) {
  for (int leg = 1; leg <= 4; ++leg) {
    for (const int joint : {1, 4}) {
      columns.push_back("tau_" + std::to_string(leg) + "_" + std::to_string(joint) + "_Nm");
    }
  }
  for (int leg = 1; leg <= 4; ++leg) {
    for (int joint = 1; joint <= 4; ++joint) {
      columns.push_back("th_" + std::to_string(leg) + "_" + std::to_string(joint) + "_rad");
    }
  }
}

}  // namespace

const std::array<const char*, kFaults>& fault_names() {
  static const auto names = [] {
    std::array<const char*, kFaults> made{};
    for (std::size_t i = 0; i < made.size(); ++i)
      made[i] = words_of(static_cast<Fault>(i)).name;
    return made;
  }();
  return names;
}

std::vector<std::string> recording_columns(const RecordingKind& kind) {
  std::vector<std::string> columns = {"t_s", "x_m", "y_m",      "z_m",      "qw",      "qx",
                                      "qy",  "qz",  "tool_x_m", "tool_y_m", "tool_z_m"};
  for (const char* which : {"wanted", "delivered"})
    add_wrench(which, columns);
  if (kind.has_pose_device) {
    for (const char* name : {"device_x_m", "device_y_m", "device_z_m", "device_qw", "device_qx",
                             "device_qy", "device_qz", "buttons"}) {
      columns.emplace_back(name);
    }
    add_wrench("device", columns);
  } else {
    add_joints(columns);
  }
  for (const char* name :
       {"state",           "active_slice",   "penetration_m",  "wrench_scale",
        "pose_residual_m", "cuts_published", "response_sheet", "response_stiffness_N_per_m",
        "response_x_m",    "response_y_m",   "fault",          "device_read",
        "state_t_s",       "device_write",   "outside_fault",  "recovery_asked",
        "safety",          "authority",      "passivity_J",    "passivity_N_s_per_m",
        "motor_heat_max"}) {
    columns.emplace_back(name);
  }
  if (kind.has_xray) columns.emplace_back("xray");
  if (kind.has_cutting)
    columns.insert(columns.end(), kCuttingColumns.begin(), kCuttingColumns.end());
  else
    columns.emplace_back("tip_N");
  // The last is text, in the first row only.
  for (const char* name : {"break_through_N", "break_through_at", "origin"})
    columns.emplace_back(name);
  return columns;
}

std::optional<RecordingKind> kind_of_header(std::string_view header) {
  for (unsigned bits = 0; bits < 8; ++bits) {
    const RecordingKind kind{(bits & 1) != 0, (bits & 2) != 0, (bits & 4) != 0};
    if (header == recording_header(kind)) return kind;
  }
  return std::nullopt;
}

RecordingKind recording_kind(const RecordingOrigin& origin) {
  const std::string *const law = origin.find("force-law"), *const device =
                                                               origin.find(kOriginDeviceKind);
  return {.has_cutting = law != nullptr && *law == "cutting",
          .has_pose_device = device != nullptr && *device == kPoseDeviceKind,
          .has_xray = origin.find(kOriginXray) != nullptr};
}

const char* to_string(ContactPhase phase) {
  return kPhaseNames.at(static_cast<std::size_t>(phase));
}
const char* to_string(Fault fault) {
  return words_of(fault).name;
}
const char* to_string(SafetyState state) {
  return kSafetyNames.at(static_cast<std::size_t>(state));
}
const char* to_string(DeviceStatus status) {
  return kDeviceStatusNames.at(static_cast<std::size_t>(status));
}

std::string describe_break_through(std::int32_t at, double t_s, double resistance_N) {
  const std::string what = at >= 0 ? text_line("slice %d", at)
                           : at <= kBreakThroughLayer
                               ? text_line("soft layer %d", kBreakThroughLayer - at + 1)
                               : std::string("the tissue");
  return text_line("broke through %s at %.3f s: %.2f N at the tip before", what.c_str(), t_s,
                   resistance_N);
}

std::string recording_header(const RecordingKind& kind) {
  std::string line;
  for (const std::string& name : recording_columns(kind))
    line.append(line.empty() ? "" : ",").append(name);
  return line;
}

}  // namespace trocar
