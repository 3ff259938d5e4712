// SPDX-License-Identifier: Apache-2.0
#include "formats/session/pose_device_description.h"

#include <nlohmann/json.hpp>
#include <numbers>

#include "formats/base/file_io.h"
#include "formats/base/strict_json.h"
#include "formats/session/assumed_values.h"

namespace trocar {
namespace {

using Json = nlohmann::json;

constexpr std::string_view kPoseSchema = "trocar.pose_device/1";
constexpr std::uint64_t kMaxDescriptionBytes = std::uint64_t{1} << 20;
/// A smaller workspace cannot contain a tool's path.
constexpr double kSmallestWorkspace_m = 0.01;

void read_workspace(StrictObject& root, PoseDeviceDescription& device) {
  root.numbers("workspace_min_m", device.workspace_min_m, -10, 10, true);
  root.numbers("workspace_max_m", device.workspace_max_m, -10, 10, true);
  for (std::size_t i = 0; i < 3; ++i) {
    if (device.workspace_max_m[i] - device.workspace_min_m[i] >= kSmallestWorkspace_m) continue;
    return root.error("workspace_max_m",
                      "must exceed workspace_min_m by at least 0.01 along each axis");
  }
}

}  // namespace

Result<PoseDeviceDescription> parse_pose_device_description(std::string_view json_text,
                                                            const std::string& source) {
  const Result<Json> document = parse_strict_json(json_text, source);
  if (!document) return document.error();
  JsonErrors errors{.file = source, .first = std::nullopt};
  StrictObject root(*document, "", errors);
  PoseDeviceDescription device;
  if (root.string("schema") != kPoseSchema)
    errors.add("/schema", "must be \"" + std::string(kPoseSchema) + "\"");
  device.name = root.string("name");
  device.force_max_N = root.number("force_max_N", 0.01, 1000);
  device.moment_max_Nm = root.number("moment_max_Nm", 0, 1000, 0);
  device.senses_rotation = root.boolean("senses_rotation");
  root.read("stiffness_max_N_per_m", device.stiffness_max_N_per_m, 1, 1e8);
  device.mass_kg = root.number("mass_kg", 1e-3, 1e3);
  root.numbers("inertia_kg_m2", device.inertia_kg_m2, 1e-8, 1e3, device.moment_max_Nm > 0);
  root.read("damping_N_s_per_m", device.damping_N_s_per_m, 0, 1e4);
  root.read("rotation_damping_Nm_s_per_rad", device.rotation_damping_Nm_s_per_rad, 0, 1e3);
  root.read("position_resolution_m", device.position_resolution_m, 0, 0.01);
  root.read("rotation_resolution_rad", device.rotation_resolution_rad, 0, 0.1);
  read_workspace(root, device);
  root.numbers("turn_deg", device.turn_rad, -180, 180, false);
  for (double& angle : device.turn_rad)
    angle *= std::numbers::pi / 180;
  device.buttons = static_cast<int>(root.integer("buttons", 0, 32, 0));
  if (device.moment_max_Nm > 0 && !device.senses_rotation)
    root.error("moment_max_Nm",
               "must be 0 for a device that does not measure the orientation of its handle");
  if (const Json* assumed = root.optional_value("assumed"))
    check_assumed(*assumed, *document, errors);
  root.finish();
  if (errors.first) return *errors.first;
  return device;
}

Result<AnyDeviceDescription> read_any_device_description(const std::string& path) {
  const auto bytes = read_file(path, kMaxDescriptionBytes);
  if (!bytes) return bytes.error();
  const std::string_view text(reinterpret_cast<const char*>(bytes->data()), bytes->size());
  const Result<Json> document = parse_strict_json(text, path);
  if (!document) return document.error();
  const bool is_pose_device = document->is_object() && document->contains("schema") &&
                              document->at("schema") == kPoseSchema;
  const auto any = [](auto device) -> Result<AnyDeviceDescription> {
    if (!device) return device.error();
    return AnyDeviceDescription(std::move(*device));
  };
  return is_pose_device ? any(parse_pose_device_description(text, path))
                        : any(parse_device_description(text, path));
}

}  // namespace trocar
