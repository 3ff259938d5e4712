// SPDX-License-Identifier: Apache-2.0
#include "runtime/telemetry/session_facts.h"

#include <unistd.h>

#include <ctime>
#include <nlohmann/json.hpp>
#include <utility>

#include "formats/base/json_text.h"
#include "formats/base/utc_time.h"
#include "formats/session/telemetry.h"
#include "runtime/contact/tool.h"
#include "runtime/telemetry/snapshot.h"
#include "runtime/telemetry/telemetry_histogram.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

json describe_tool(const SceneTool& scene_tool) {
  // The corners are given about the axis, in the plate's x and y as if the tool were not tilted.
  SceneTool upright = scene_tool;
  upright.tilt_deg = 0;
  upright.tip_in_plate_m = {0, 0, 0};
  const Tool tool = make_tool(upright);
  json outline = json::array();
  for (int i = 0; i < tool.sides; ++i)
    outline.push_back({tool.corner_plate_m.at(i).x(), tool.corner_plate_m.at(i).y()});
  const Eigen::Vector3d axis = -make_tool(scene_tool).axis_plate;
  return {{"kind", scene_tool.kind.empty() ? "flat" : scene_tool.kind},
          {"half_angle_deg", scene_tool.half_angle_deg},
          {"radius_m", scene_tool.radius_m},
          {"outline_m", std::move(outline)},
          {"tip_in_plate_m", scene_tool.tip_in_plate_m},
          {"axis_in_plate", {axis.x(), axis.y(), axis.z()}}};
}

json describe_sheets(const Remesher& remesher, const TelemetryOptions& options) {
  json sheets = json::array();
  for (std::size_t i = 0; i < remesher.size(); ++i) {
    const Sheet& sheet = remesher.first_version(i);
    const bool has_name = i < options.tissue_of_sheet.size() && !options.tissue_of_sheet[i].empty();
    sheets.push_back({{"slice", sheet.slice_index},
                      {"z_m", sheet.z_m},
                      {"tissue", has_name ? json(options.tissue_of_sheet[i]) : json(nullptr)},
                      {"threshold_N", sheet.tissue.threshold_N}});
  }
  return sheets;
}

json describe_device(const DeviceSpecification& device, const SafetyLimits& limits) {
  const MotorsAndJoints parts = device.motors_and_joints();
  const auto number = [](const std::optional<double>& value) {
    return value ? json(*value) : json(nullptr);
  };
  return {{"motor_peak_torque_Nm", number(parts.motor_peak_torque_Nm)},
          {"motor_continuous_torque_Nm", number(parts.motor_continuous_torque_Nm)},
          {"joint_limits_rad", parts.joint_limits_rad},
          {"workspace",
           {{"min_m", limits.workspace_min_m},
            {"max_m", limits.workspace_max_m},
            {"tilt_max_rad", limits.plate_tilt_max_rad}}}};
}

json describe_hand(const std::optional<PublishedHand>& hand) {
  if (!hand) return nullptr;
  return {{"live", true},
          {"box", {{"min_m", hand->min_m}, {"max_m", hand->max_m}}},
          {"start", {{"tip_m", hand->start_tip_m}, {"rotation_rad", hand->start_rotation_rad}}},
          {"stiffness_N_per_m", hand->stiffness_N_per_m},
          {"rotation_stiffness_Nm_per_rad", hand->rotation_stiffness_Nm_per_rad},
          {"speed_max_m_per_s", hand->speed_max_m_per_s},
          {"rotation_rate_max_rad_per_s", hand->rotation_rate_max_rad_per_s},
          {"turn_max_rad", hand->turn_max_rad}};
}

}  // namespace

std::string session_facts(const Scene& scene, const DeviceSpecification& device,
                          const Remesher& remesher, const TelemetryOptions& options,
                          const PublishedSession& session) {
  json about = {
      {"schema", kTelemetrySchema},
      {"program", "trocar-run " TROCAR_VERSION},
      {"pid", ::getpid()},
      {"started_at", utc_text(std::time(nullptr))},
      {"scene", {{"file", options.scene_file}, {"name", scene.name}}},
      {"asset", scene.asset.string()},
      {"device", options.device},
      {"force_law", to_string(scene.force_law.kind)},
      {"rate_Hz", session.rate_Hz},
      {"duration_s", session.duration_s},
      {"clock", session.clock},
      {"recovery", options.recovery},
      {"record", session.record ? json(session.record->string()) : json(nullptr)},
      {"xray", session.counts_xray},
      {"tool", describe_tool(scene.tool)},
      {"hand", describe_hand(options.hand)},
      {"sheets", describe_sheets(remesher, options)},
      {"layers", json::array()},
      {"columns", json::array()},
      {"phases", names_of<ContactPhase>(static_cast<int>(ContactPhase::kFault) + 1)},
      {"faults", names_of<Fault>(kFaults)},
      {"safety_states", names_of<SafetyState>(kSafetyStates)},
  };
  about.update(describe_device(device, session.limits));
  for (const SceneLayer& layer : scene.layers) {
    about["layers"].push_back({{"name", layer.name},
                               {"top_z_m", layer.top_z_m},
                               {"thickness_m", layer.thickness_m},
                               {"puncture_N", layer.puncture_N}});
  }
  for (const auto& [name, count] : snapshot_columns())
    about["columns"].push_back({{"name", name}, {"count", count}});
  json edges = json::array();
  for (std::size_t i = 0; i <= TelemetryHistogram::kBins; ++i)
    edges.push_back(TelemetryHistogram::lower_us(i));
  about["histogram_edges_us"] = std::move(edges);
  return json_text(about);
}

}  // namespace trocar::runtime
