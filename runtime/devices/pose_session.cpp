// SPDX-License-Identifier: Apache-2.0
#include "runtime/devices/pose_session.h"

#include <algorithm>
#include <array>
#include <vector>

#include "embedded/runtime/device/force_dimension.json.h"
#include "embedded/runtime/device/haply_inverse3.json.h"
#include "runtime/devices/simulated_hand.h"
#include "runtime/force_law/force_law_table.h"
#include "runtime/pose_device/pose_specification.h"

namespace trocar::runtime {
namespace {

constexpr const char* kForceScale = "force-scale";
constexpr const char* kForceLimit = "force-limit";
constexpr const char* kDeviceMargin = "device-margin";
constexpr std::string_view kBuiltIn = "built-in/";
/// In a bone volume friction on the shaft adds to the force at the tip. With the shipped scene of a vertebra the largest force is 1.39
/// times the largest at the tip.
constexpr double kShaftHeadroom = 1.5;
/// Damping of the virtual coupling over its stiffness, as in CouplingOptions.
constexpr double kCouplingDamping_s = 5e-4;
constexpr double kMaxCoupling_N_per_m = 1e6;

struct BuiltIn {
  std::string_view name, text;
};
constexpr std::array kBuiltIns = {BuiltIn{"haply_inverse3", kHaplyInverse3},
                                  BuiltIn{"force_dimension", kForceDimension}};

}  // namespace

Result<PoseDeviceDescription> built_in_pose_device(std::string_view name) {
  const bool turns = name.ends_with(kWithRotation);
  const std::string_view base = turns ? name.substr(0, name.size() - kWithRotation.size()) : name;
  for (const BuiltIn& each : kBuiltIns) {
    if (each.name != base) continue;
    auto device = parse_pose_device_description(each.text, "built-in " + std::string(name));
    if (device) device->senses_rotation = turns;
    return device;
  }
  return refused("there is no built-in device " + std::string(name));
}

void set_pose_device_options(const PoseDeviceDescription& description, const Scene& scene,
                             SessionOptions& options) {
  const PoseFrame::Box box = pose_frame(description, scene).workspace();
  SafetyLimits& limits = options.limits;
  for (std::size_t i = 0; i < 3; ++i) {
    limits.workspace_min_m[i] = box.min_m[static_cast<Eigen::Index>(i)];
    limits.workspace_max_m[i] = box.max_m[static_cast<Eigen::Index>(i)];
  }
  limits.timing.ramp_s = 0;
  limits.timing.ramps_at_start = true;
  StiffnessLimits& stiffness = options.stiffness;
  if (description.stiffness_max_N_per_m > 0)
    stiffness.max_N_per_m =
        std::min(stiffness.max_N_per_m, description.stiffness_max_N_per_m / stiffness.margin);
  if (traits_of(scene.force_law.kind).uses_bone_volume) return;
  CouplingOptions& coupling = options.coupling;
  const double force_scale = scene.force_law.force_scale;
  if (coupling.on && force_scale * coupling.stiffness_N_per_m <= stiffness.max_N_per_m) return;
  const bool is_limited = coupling.on || description.stiffness_max_N_per_m > 0;
  const double rendered_N_per_m =
      is_limited ? stiffness.max_N_per_m
                 : std::min(stiffness.max_N_per_m, coupling.stiffness_N_per_m / stiffness.margin);
  coupling.on = true;
  coupling.stiffness_N_per_m = std::min(rendered_N_per_m / force_scale, kMaxCoupling_N_per_m);
  coupling.damping_N_s_per_m = kCouplingDamping_s * coupling.stiffness_N_per_m;
}

Result<double> fitting_force_scale(const PoseDeviceDescription& description, const Scene& scene,
                                   std::span<const std::unique_ptr<const Sheet>> sheets,
                                   double rate_Hz) {
  std::vector<const Sheet*> all;
  for (const auto& sheet : sheets)
    all.push_back(sheet.get());
  const PoseSpecification specification(description, pose_frame(description, scene));
  // The forces do not depend on the coupling. A soft one is passive, whatever the force scale is.
  const StiffnessLimits soft{.max_N_per_m = 1};
  const auto law = make_force_law({scene, specification, all, rate_Hz, {}, soft});
  if (!law) return law.error();
  double max_N = 0;
  for (std::size_t i = 0; i < all.size(); ++i)
    max_N = std::max(max_N, (*law)->tip_force(i, *all[i]).threshold_N);
  if (traits_of(scene.force_law.kind).uses_bone_volume) max_N *= kShaftHeadroom;
  for (const SceneLayer& layer : scene.layers)
    max_N = std::max(max_N, layer.puncture_N);
  if (!(max_N * scene.force_law.force_scale > description.force_max_N))
    return scene.force_law.force_scale;
  return description.force_max_N / max_N;
}

void write_pose_device_origin(const std::string& device, const PoseDeviceDescription& description,
                              const Scene& scene, const SessionOptions& options,
                              RecordingOrigin& origin) {
  for (auto& [key, value] : origin.entries)
    if (key == kOriginDevice) value = device;
  origin.entries.emplace_back(kOriginDeviceKind, kPoseDeviceKind);
  origin.entries.emplace_back(kForceLimit, origin_number(description.force_max_N));
  origin.entries.emplace_back(kForceScale, origin_number(scene.force_law.force_scale));
  origin.entries.emplace_back(kDeviceMargin, origin_number(options.stiffness.margin));
}

std::optional<PoseDeviceOrigin> read_pose_device_origin(const RecordingOrigin& recorded) {
  if (!recording_kind(recorded).has_pose_device) return std::nullopt;
  PoseDeviceOrigin stated;
  const std::string* const device = recorded.find(kOriginDevice);
  if (device != nullptr && device->starts_with(kBuiltIn))
    stated.built_in = device->substr(kBuiltIn.size());
  stated.force_scale = recorded.number(kForceScale).value_or(1);
  stated.force_max_N = recorded.number(kForceLimit).value_or(0);
  stated.stiffness_margin = recorded.number(kDeviceMargin).value_or(1);
  return stated;
}

}  // namespace trocar::runtime
