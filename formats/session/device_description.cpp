// SPDX-License-Identifier: Apache-2.0
#include "formats/session/device_description.h"

#include <nlohmann/json.hpp>
#include <numbers>

#include "embedded/formats/session/four_legs.json.h"
#include "formats/base/files.h"
#include "formats/base/json.h"

namespace trocar {
namespace {

using Json = nlohmann::json;

constexpr std::string_view kSchema = "trocar.device/1";
constexpr std::string_view kPoseSchema = "trocar.pose_device/1";
constexpr std::uint64_t kMaxFileBytes = std::uint64_t{1} << 20;
/// A smaller workspace cannot contain a tool's path.
constexpr double kSmallestWorkspace_m = 0.01;
constexpr std::array<const char*, kJointsPerLeg> kJointName = {"theta1", "theta2", "theta3",
                                                               "theta4", "theta5", "theta6"};

double from_deg(double deg) {
  return deg * (std::numbers::pi / 180);
}

int read_branch(StrictObject& branches, const char* key) {
  branches.string(key);
  return branches.choice(key, std::array{"plus", "minus"}) == 0 ? 1 : -1;
}

void read_geometry(StrictObject& object, DeviceGeometry& g) {
  constexpr double kShortest_m = 1e-3, kLongest_m = 10;
  const auto length = [&](const char* key) { return object.number(key, kShortest_m, kLongest_m); };
  g.l1_m = length("l1_m");
  g.l2_m = length("l2_m");
  g.l3_m = length("l3_m");
  g.l4_m = length("l4_m");
  g.l5_m = length("l5_m");
  g.R_T_m = length("R_T_m");
  g.R_B1_m = length("R_B1_m");
  g.R_B2_m = length("R_B2_m");
  g.H_B_m = object.number("H_B_m", 0, kLongest_m);
  g.z_A_m = object.number("z_A_m", -kLongest_m, kLongest_m);
  g.d_rad = from_deg(object.number("d_deg", -180, 180));
  if (g.l5_m >= g.l2_m) object.error("l5_m", "must be less than l2_m: D lies between E and C");
}

void read_motors(StrictObject& object, DeviceDescription& device) {
  device.motor_peak_torque_Nm = object.number("peak_torque_Nm", 1e-3, 1e3);
  device.motor_continuous_torque_Nm = object.number("continuous_torque_Nm", 1e-3, 1e3);
  device.motor_torque_constant_Nm_per_A = object.number("torque_constant_Nm_per_A", 1e-4, 100);
  device.motor_gear_ratio = object.number("gear_ratio", 0.1, 1e3);
  device.upper_bevel_ratio = object.number("upper_bevel_ratio", 0.1, 10);
  device.motor_peak_current_A = object.number("peak_current_A", 1e-3, 1e3);
  device.motor_continuous_current_A = object.number("continuous_current_A", 1e-3, 1e3);
  device.motor_peak_time_s = object.number("peak_time_s", 0.1, 60);
  device.joint_coulomb_friction_Nm = object.number("joint_coulomb_friction_Nm", 0, 10);
  if (device.motor_continuous_torque_Nm > device.motor_peak_torque_Nm)
    object.error("continuous_torque_Nm", "must not be above peak_torque_Nm");
  if (device.motor_continuous_current_A > device.motor_peak_current_A)
    object.error("continuous_current_A", "must not be above peak_current_A");
}

void read_joint_limits(StrictObject& object, DeviceDescription& device) {
  for (std::size_t j = 0; j < kJointsPerLeg; ++j) {
    std::array<double, 2> deg{};
    object.numbers(kJointName[j], deg, -720, 720, true);
    if (!(deg[0] < deg[1] && deg[1] - deg[0] <= 360))
      object.error(kJointName[j], "must be [min, max] with min < max <= min + 360");
    device.joint_limit[j] = {from_deg(deg[0]), from_deg(deg[1])};
  }
}

void read_plate(StrictObject& object, DeviceDescription& device) {
  device.plate_mass_kg = object.number("mass_kg", 1e-3, 1e3);
  object.read("stiffness_max_N_per_m", device.plate_stiffness_max_N_per_m, 1.0, 1e8);
  auto& i = device.plate_inertia_kg_m2;
  object.numbers("inertia_kg_m2", i, 1e-8, 1e3, true);
  if (i[0] + i[1] < i[2] || i[1] + i[2] < i[0] || i[2] + i[0] < i[1])
    object.error("inertia_kg_m2", "is impossible: one moment exceeds the sum of the others");
}

void read_simulation(StrictObject& object, DeviceDescription& device) {
  device.joint_viscous_friction_Nms_per_rad =
      object.number("joint_viscous_friction_Nms_per_rad", 0, 10);
  device.encoder_counts_per_revolution =
      static_cast<int>(object.integer("encoder_counts_per_revolution", 0, 1 << 30));
  object.read("encoder_noise_rad", device.encoder_noise_rad, 0, 0.1);
  device.gravity_m_per_s2 = object.number("gravity_m_per_s2", 0, 100);
  device.minimum_substeps = static_cast<int>(object.integer("minimum_substeps", 10, 1000));
  device.maximum_substep_s = object.number("maximum_substep_s", 1e-6, 1e-2);
}

void read_workspace(StrictObject& root, PoseDeviceDescription& device) {
  root.numbers("workspace_min_m", device.workspace_min_m, -10, 10, true);
  root.numbers("workspace_max_m", device.workspace_max_m, -10, 10, true);
  for (std::size_t i = 0; i < 3; ++i) {
    if (device.workspace_max_m[i] - device.workspace_min_m[i] >= kSmallestWorkspace_m) continue;
    return root.error("workspace_max_m",
                      "must exceed workspace_min_m by at least 0.01 along each axis");
  }
}

/// Checks the section `assumed`, which names values of the file that nobody has measured. Adds an error to `errors` for each key that is not a JSON pointer
/// to a value of `document`, and for each value that is not a text (the reason).
void check_assumed(const Json& assumed, const Json& document, JsonErrors& errors) {
  if (!assumed.is_object()) return errors.add("/assumed", "must be an object");
  for (const auto& [pointer, reason] : assumed.items()) {
    const std::string path =
        "/assumed " +
        Json(pointer.substr(0, 64)).dump(-1, ' ', true, Json::error_handler_t::replace);
    if (!reason.is_string()) errors.add(path, "must be a string");
    bool names_a_value = false;
    try {
      names_a_value = document.contains(Json::json_pointer(pointer));
    } catch (const Json::exception&) {  // not a pointer
    }
    if (!names_a_value) errors.add(path, "names no value of this file");
  }
}

/// Reads what both kinds have, and the rest by `read`.
template <typename Description, typename Read>
Result<Description> parse_description(std::string_view json_text, const std::string& source,
                                      std::string_view schema, bool needs_assumed,
                                      const Read& read) {
  const Result<Json> document = parse_strict_json(json_text, source);
  if (!document) return document.error();
  JsonErrors errors{.file = source, .first = std::nullopt};
  StrictObject root(*document, "", errors);
  Description device;
  if (root.string("schema") != schema)
    errors.add("/schema", "must be \"" + std::string(schema) + "\"");
  device.name = root.string("name");
  read(root, device);
  if (const Json* assumed = root.optional_value("assumed"))
    check_assumed(*assumed, *document, errors);
  else if (needs_assumed)
    errors.add("/assumed", "is missing");
  root.finish();
  if (errors.first) return *errors.first;
  return device;
}

}  // namespace

DeviceDescription default_device_description() {
  return *parse_device_description(kFourLegs, "built-in device");
}

Result<DeviceDescription> parse_device_description(std::string_view json_text,
                                                   const std::string& source) {
  const auto read = [](StrictObject& root, DeviceDescription& device) {
    DeviceGeometry& geometry = device.geometry;
    root.required_section("geometry", [&](StrictObject& o) { read_geometry(o, geometry); });
    root.required_section("branches", [&](StrictObject& o) {
      geometry.branch_theta1 = read_branch(o, "theta1");
      geometry.branch_theta4 = read_branch(o, "theta4");
    });
    root.required_section("motors", [&](StrictObject& o) { read_motors(o, device); });
    root.required_section("joint_limits_deg",
                          [&](StrictObject& o) { read_joint_limits(o, device); });
    root.required_section("plate", [&](StrictObject& o) { read_plate(o, device); });
    root.required_section("simulation", [&](StrictObject& o) { read_simulation(o, device); });
    root.read("delay_s", device.delay_s, 0, kLongestDelay_s);
  };
  return parse_description<DeviceDescription>(json_text, source, kSchema, true, read);
}

Result<DeviceDescription> read_device_description(const std::string& path) {
  const auto bytes = read_file(path, kMaxFileBytes);
  if (!bytes) return bytes.error();
  return parse_device_description({reinterpret_cast<const char*>(bytes->data()), bytes->size()},
                                  path);
}

Result<PoseDeviceDescription> parse_pose_device_description(std::string_view json_text,
                                                            const std::string& source) {
  const auto read = [](StrictObject& root, PoseDeviceDescription& device) {
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
    root.read("position_noise_m", device.position_noise_m, 0, 0.01);
    root.read("rotation_noise_rad", device.rotation_noise_rad, 0, 0.1);
    root.read("coulomb_friction_N", device.coulomb_friction_N, 0, 100);
    root.read("delay_s", device.delay_s, 0, kLongestDelay_s);
    read_workspace(root, device);
    root.numbers("turn_deg", device.turn_rad, -180, 180, false);
    for (double& angle : device.turn_rad)
      angle = from_deg(angle);
    device.buttons = static_cast<int>(root.integer("buttons", 0, 32, 0));
    if (device.moment_max_Nm > 0 && !device.senses_rotation)
      root.error("moment_max_Nm",
                 "must be 0 for a device that does not measure the orientation of its handle");
  };
  return parse_description<PoseDeviceDescription>(json_text, source, kPoseSchema, false, read);
}

Result<AnyDeviceDescription> read_any_device_description(const std::string& path) {
  const auto bytes = read_file(path, kMaxFileBytes);
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
