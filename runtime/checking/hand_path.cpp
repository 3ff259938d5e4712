// SPDX-License-Identifier: Apache-2.0
#include "runtime/checking/hand_path.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "formats/base/text_line.h"
#include "runtime/contact/overlap.h"

namespace trocar::runtime {
namespace {

constexpr double kStep_m = 5e-4;
constexpr double kStep_rad = 0.5 / kDegreesPerRadian;
constexpr double kMaxSteps = 16000;

Pose plate_of(const Pose& T_device_tool, const Tool& tool) noexcept {
  return {T_device_tool.p_m - T_device_tool.q * tool.tip_plate_m, T_device_tool.q};
}

/// Returns the number of steps of kStep_m or kStep_rad from keyframe a to b, not rounded.
double steps_between(const HandKeyframe& a, const HandKeyframe& b) noexcept {
  const double turn_rad = rotation_vector(b.T_device_tool.q * a.T_device_tool.q.conjugate()).norm();
  return std::max((b.T_device_tool.p_m - a.T_device_tool.p_m).norm() / kStep_m,
                  turn_rad / kStep_rad);
}

/// Calls visit(t_s, target) along the path from `from_s` to `to_s`.
template <typename Visit>
void walk(const HandTrajectory& path, double from_s, double to_s, Visit&& visit) {
  const auto& keyframes = path.keyframes;
  double steps = 0;
  for (std::size_t i = 1; i < keyframes.size(); ++i)
    steps += steps_between(keyframes[i - 1], keyframes[i]);
  const double density = std::min(1.0, kMaxSteps / std::max(steps, 1.0));
  visit(from_s, hand_target(path, from_s));
  for (std::size_t i = 1; i < keyframes.size(); ++i) {
    const double begin_s = std::max(keyframes[i - 1].t_s, from_s);
    const double end_s = std::min(keyframes[i].t_s, to_s);
    if (!(end_s > begin_s)) continue;
    const int points =
        1 + static_cast<int>(density * steps_between(keyframes[i - 1], keyframes[i]));
    HandTarget target;
    for (int k = 0; k < points; ++k) {
      const double t_s = begin_s + (end_s - begin_s) * (k + 0.5) / points;
      target = hand_target(path, t_s);
      visit(t_s, target);
    }
    target.T_device_tool = hand_target(path, end_s).T_device_tool;  // keeps the segment's velocity
    visit(end_s, target);
  }
}

std::string describe_box(const SafetyLimits& limits, const Pose& T_device_plate) {
  constexpr std::array<const char*, 3> kAxes{"x", "y", "z"};
  for (std::size_t i = 0; i < 3; ++i) {
    const double at_m = T_device_plate.p_m[static_cast<Eigen::Index>(i)];
    if (at_m >= limits.workspace_min_m[i] && at_m <= limits.workspace_max_m[i]) continue;
    const double low_m = limits.workspace_min_m[i], high_m = limits.workspace_max_m[i];
    return text_line("the plate is at %s %s m; its workspace is %.4f to %.4f m", kAxes[i],
                     apart_from(at_m, at_m < low_m ? low_m : high_m, 4).c_str(), low_m, high_m);
  }
  return {};
}

/// Speed of the plate's origin, and its rotation rate.
struct PlateSpeed {
  double m_per_s = 0, rad_per_s = 0;
};
PlateSpeed plate_speed(const HandTarget& target, const Pose& T_device_plate) noexcept {
  const Eigen::Vector3d omega = target.twist_device.tail<3>();
  const Eigen::Vector3d lever_m = T_device_plate.p_m - target.T_device_tool.p_m;
  return {(target.twist_device.head<3>() + omega.cross(lever_m)).norm(), omega.norm()};
}

std::string describe_speed(const SafetyLimits& limits, const PlateSpeed& speed) {
  if (speed.m_per_s > limits.speed_max_m_per_s) {
    return describe_beyond("the plate moves at", speed.m_per_s, limits.speed_max_m_per_s, " m/s",
                           2);
  }
  if (!(speed.rad_per_s > limits.rotation_rate_max_rad_per_s)) return {};
  return describe_beyond("the plate turns at", speed.rad_per_s, limits.rotation_rate_max_rad_per_s,
                         " rad/s", 1);
}

void note_margins(const PoseMargins& margins, PathReport& report) noexcept {
  report.box_min_m = std::min(report.box_min_m, margins.box_m);
  report.tilt_max_rad = std::max(report.tilt_max_rad, margins.tilt_rad);
  DeviceMargins& device = report.device;
  device.is_reachable = device.is_reachable && margins.device.is_reachable;
  if (!margins.device.is_reachable) return;
  device.inverse_condition = std::min(device.inverse_condition, margins.device.inverse_condition);
  if (!(margins.device.joint_rad < device.joint_rad)) return;
  device.joint_rad = margins.device.joint_rad;
  device.joint = margins.device.joint;
}

}  // namespace

std::string describe_pose_fault(Fault fault, const DeviceSpecification& device,
                                const SafetyLimits& limits, const Tool& tool,
                                const Pose& T_device_plate) {
  const PoseMargins margins = pose_margins(device, limits, tool, T_device_plate);
  switch (fault) {
    case Fault::kWorkspace:
      if (margins.box_m < 0) {
        std::string beyond = describe_box(limits, T_device_plate);
        return beyond.empty() ? device.describe_fault(fault, T_device_plate) : beyond;
      }
      if (margins.tilt_rad <= limits.plate_tilt_max_rad) return {};
      return describe_beyond("the plate is tilted by", margins.tilt_rad * kDegreesPerRadian,
                             limits.plate_tilt_max_rad * kDegreesPerRadian, " deg", 1);
    case Fault::kToolTilt:
      if (margins.tool_tilt_rad * kDegreesPerRadian <= kMaxTilt_deg) return {};
      return describe_beyond("the tool is tilted by", margins.tool_tilt_rad * kDegreesPerRadian,
                             kMaxTilt_deg, " deg", 1);
    default:
      return device.describe_fault(fault, T_device_plate);
  }
}

PathReport evaluate_path(const HandTrajectory& path, const DeviceSpecification& device,
                         const SafetyLimits& limits, const Tool& tool, double from_s, double to_s) {
  constexpr double kEndless = std::numeric_limits<double>::infinity();
  PathReport report;
  report.tip_min_m.setConstant(kEndless);
  report.tip_max_m.setConstant(-kEndless);
  report.box_min_m = kEndless;
  const auto is_new = [&](Fault fault) {
    return fault != Fault::kNone &&
           std::none_of(report.breaches.begin(), report.breaches.end(),
                        [&](const PathBreach& known) { return known.fault == fault; });
  };
  walk(path, from_s, to_s, [&](double t_s, const HandTarget& target) {
    const Pose T_device_plate = plate_of(target.T_device_tool, tool);
    const Eigen::Vector3d& tip_m = target.T_device_tool.p_m;
    report.end_s = t_s;
    report.tip_min_m = report.tip_min_m.cwiseMin(tip_m);
    report.tip_max_m = report.tip_max_m.cwiseMax(tip_m);
    const PoseMargins margins = pose_margins(device, limits, tool, T_device_plate);
    note_margins(margins, report);
    const PlateSpeed speed = plate_speed(target, T_device_plate);
    report.speed_max_m_per_s = std::max(report.speed_max_m_per_s, speed.m_per_s);
    if (const Fault fault = pose_fault(limits, margins); is_new(fault)) {
      report.breaches.push_back(
          {fault, t_s, tip_m, describe_pose_fault(fault, device, limits, tool, T_device_plate)});
    }
    if (std::string fast = describe_speed(limits, speed); !fast.empty() && is_new(Fault::kSpeed)) {
      report.breaches.push_back({Fault::kSpeed, t_s, tip_m, std::move(fast)});
    }
  });
  return report;
}

std::vector<SheetCrossing> sheet_crossings(const HandTrajectory& path, const Tool& tool,
                                           const Sheet& sheet) {
  std::vector<SheetCrossing> crossings;
  for (std::size_t i = 1; i < path.keyframes.size(); ++i) {
    const HandKeyframe& a = path.keyframes[i - 1];
    const HandKeyframe& b = path.keyframes[i];
    const double above_m = a.T_device_tool.p_m.z() - sheet.z_m;
    const double below_m = sheet.z_m - b.T_device_tool.p_m.z();
    if (!(above_m >= 0 && below_m > 0)) continue;
    SheetCrossing crossing;
    crossing.t_s = a.t_s + (b.t_s - a.t_s) * above_m / (above_m + below_m);
    const HandTarget target = hand_target(path, crossing.t_s);
    crossing.tip_m = target.T_device_tool.p_m;
    crossing.T_device_plate = plate_of(target.T_device_tool, tool);
    crossing.coverage =
        overlap(sheet, tool,
                outline_on_lattice(tool, crossing.T_device_plate, sheet.transform, sheet.z_m), {})
            .coverage;
    crossings.push_back(crossing);
  }
  return crossings;
}

}  // namespace trocar::runtime
