// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/pose_session.h"

#include "embedded/runtime/device/force_dimension.json.h"
#include "embedded/runtime/device/haply_inverse3.json.h"
#include "runtime/device/pose/pose_hand.h"
#include "runtime/haptics/contact_design.h"
#include "runtime/session/force_law_table.h"
#include "runtime/session/open_device.h"

namespace trocar::runtime {
namespace {

double angle_to_z(const Eigen::Vector3d& axis) noexcept {
  return std::atan2(axis.head<2>().norm(), axis.z());
}

constexpr double kStep_m = 2e-3;

bool is_reachable(const DeviceSpecification& device, const SafetyLimits& limits, const Tool& tool,
                  const Eigen::Quaterniond& q, const Eigen::Vector3d& tip_m) noexcept {
  const Pose T_device_plate{tip_m - q * tool.tip_plate_m, q};
  return pose_fault(limits, pose_margins(device, limits, tool, T_device_plate)) == Fault::kNone;
}

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

PoseMargins pose_margins(const DeviceSpecification& device, const SafetyLimits& limits,
                         const Tool& tool, const Pose& T_device_plate) noexcept {
  PoseMargins margins;
  margins.box_m = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < 3; ++i) {
    const double at_m = T_device_plate.p_m[static_cast<Eigen::Index>(i)];
    margins.box_m = std::min(
        {margins.box_m, at_m - limits.workspace_min_m[i], limits.workspace_max_m[i] - at_m});
  }
  margins.tilt_rad = angle_to_z(T_device_plate.q * Eigen::Vector3d::UnitZ());
  margins.tool_tilt_rad = angle_to_z(T_device_plate.q * tool.axis_plate);
  margins.device = device.margins(T_device_plate);
  margins.box_m = std::min(margins.box_m, margins.device.box_m);
  return margins;
}

// The order is that of the loop's checks (haptic_loop.cpp).
Fault pose_fault(const SafetyLimits& limits, const PoseMargins& margins) noexcept {
  if (margins.device.fault != Fault::kNone) return margins.device.fault;
  if (!(margins.box_m >= 0 && margins.tilt_rad <= limits.plate_tilt_max_rad))
    return Fault::kWorkspace;
  return margins.tool_tilt_rad * kDegreesPerRadian <= kMaxTilt_deg ? Fault::kNone
                                                                   : Fault::kToolTilt;
}

std::optional<WorkspaceHeights> workspace_heights(const DeviceSpecification& device,
                                                  const SafetyLimits& limits, const Tool& tool,
                                                  const Eigen::Quaterniond& q) {
  std::optional<WorkspaceHeights> tallest;
  WorkspaceHeights now;
  bool within = false;
  const int steps = static_cast<int>(
      std::floor((limits.workspace_max_m[2] - limits.workspace_min_m[2]) / kStep_m + 1e-9));
  for (int i = 0; i <= steps; ++i) {
    Eigen::Vector3d tip_m = q * tool.tip_plate_m;
    tip_m.z() += limits.workspace_min_m[2] + i * kStep_m;
    const bool good = is_reachable(device, limits, tool, q, tip_m);
    if (good && !within) now.min_m = tip_m.z();
    within = good;
    if (!good) continue;
    now.max_m = tip_m.z();
    if (!tallest || now.max_m - now.min_m >= tallest->max_m - tallest->min_m) tallest = now;
  }
  return tallest;
}

std::optional<WorkspaceRectangle> workspace_rectangle(const DeviceSpecification& device,
                                                      const SafetyLimits& limits, const Tool& tool,
                                                      double tip_z_m, const Eigen::Quaterniond& q) {
  const Eigen::Vector2d middle_m = (q * tool.tip_plate_m).head<2>();
  const auto is_good = [&](double x_m, double y_m) {
    return is_reachable(device, limits, tool, q, {middle_m.x() + x_m, middle_m.y() + y_m, tip_z_m});
  };
  if (!is_good(0, 0)) return std::nullopt;
  // Positions of the sides in whole steps from the middle: low x, low y, high x, high y.
  std::array<int, 4> side{0, 0, 0, 0};
  const auto row_is_good = [&](std::size_t which, int at) {
    const std::size_t other = (which + 1) % 2;
    for (int k = side[other]; k <= side[other + 2]; ++k) {
      const double along_m = k * kStep_m, across_m = at * kStep_m;
      if (!(which % 2 == 0 ? is_good(across_m, along_m) : is_good(along_m, across_m))) return false;
    }
    return true;
  };
  const auto is_square = [&](int half) {
    const std::array<int, 4> before = side;
    side = {-half, -half, half, half};
    const bool good = row_is_good(0, -half) && row_is_good(1, -half) && row_is_good(2, half) &&
                      row_is_good(3, half);
    if (!good) side = before;
    return good;
  };
  int half = 1;
  while (is_square(half))
    ++half;
  for (std::size_t which = 0; which < side.size(); ++which) {
    const int outwards = which < 2 ? -1 : 1;
    while (row_is_good(which, side[which] + outwards))
      side[which] += outwards;
  }
  WorkspaceRectangle rectangle;
  rectangle.min_m = middle_m + Eigen::Vector2d(side[0], side[1]) * kStep_m;
  rectangle.max_m = middle_m + Eigen::Vector2d(side[2], side[3]) * kStep_m;
  return rectangle;
}

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
  const Pose centre = pose_frame(description, scene).plate({});
  const PoseSpecification specification(description, pose_frame(description, scene));
  const double stable_N_per_m =
      stable_stiffness({1 / options.rate_Hz, specification.readings().delay_s},
                       plate_axes(specification, centre).translation, stiffness.margin);
  coupling.on = true;
  // If none is stable, the law refuses.
  coupling.stiffness_N_per_m = std::min(
      (stable_N_per_m > 0 ? std::min(rendered_N_per_m, stable_N_per_m) : rendered_N_per_m) /
          force_scale,
      kMaxCoupling_N_per_m);
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
  const CouplingOptions coupling{.on = true, .stiffness_N_per_m = 1, .damping_N_s_per_m = 0};
  const auto law = make_force_law({scene, specification, all, rate_Hz, coupling, soft});
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
