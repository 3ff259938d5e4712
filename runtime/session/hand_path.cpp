// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/hand_path.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "runtime/contact/overlap.h"
#include "runtime/session/text_line.h"

namespace trocar::runtime {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;
constexpr double kStep_m = 5e-4;
constexpr double kStep_rad = 0.5 / kDegrees;
constexpr double kMostSteps = 16000;
constexpr double kReachStep_m = 2e-3;

Pose plate_of(const Pose& T_device_tool, const Tool& tool) noexcept {
  return {T_device_tool.p_m - T_device_tool.q * tool.tip_plate_m, T_device_tool.q};
}

double angle_to_z(const Eigen::Vector3d& axis) noexcept {
  return std::atan2(axis.head<2>().norm(), axis.z());
}

/// Steps of the path from keyframe a to b, of kStep_m or kStep_rad; not rounded.
double steps_between(const HandKeyframe& a, const HandKeyframe& b) noexcept {
  const double turn_rad = rotation_vector(b.T_device_tool.q * a.T_device_tool.q.conjugate()).norm();
  return std::max((b.T_device_tool.p_m - a.T_device_tool.p_m).norm() / kStep_m,
                  turn_rad / kStep_rad);
}

/// Calls see(t_s, target) along the path from `from_s` to `to_s`.
template <typename See>
void walk(const HandTrajectory& path, double from_s, double to_s, See&& see) {
  const auto& keyframes = path.keyframes;
  double steps = 0;
  for (std::size_t i = 1; i < keyframes.size(); ++i)
    steps += steps_between(keyframes[i - 1], keyframes[i]);
  const double share = std::min(1.0, kMostSteps / std::max(steps, 1.0));
  see(from_s, hand_target(path, from_s));
  for (std::size_t i = 1; i < keyframes.size(); ++i) {
    const double begin_s = std::max(keyframes[i - 1].t_s, from_s);
    const double end_s = std::min(keyframes[i].t_s, to_s);
    if (!(end_s > begin_s)) continue;
    const int places = 1 + static_cast<int>(share * steps_between(keyframes[i - 1], keyframes[i]));
    HandTarget target;
    for (int k = 0; k < places; ++k) {
      const double t_s = begin_s + (end_s - begin_s) * (k + 0.5) / places;
      target = hand_target(path, t_s);
      see(t_s, target);
    }
    target.T_device_tool = hand_target(path, end_s).T_device_tool;  // with this segment's velocity
    see(end_s, target);
  }
}

bool is_reachable(const DeviceDescription& device, const SafetyLimits& limits, const Tool& tool,
                  const Eigen::Vector3d& tip_m) noexcept {
  Pose T_device_plate;
  T_device_plate.p_m = tip_m - tool.tip_plate_m;
  return pose_fault(limits, pose_margins(device, limits, tool, T_device_plate)) == Fault::kNone;
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

std::string describe_joint(const DeviceDescription& device, const JointAngles& joints) {
  const KinematicsStatus status = check_joint_limits(device, encoder_angles(joints));
  if (status) return {};
  const auto leg = static_cast<std::size_t>(status.leg - 1);
  const auto joint = static_cast<std::size_t>(status.joint - 1);
  const JointLimit& limit = device.joint_limit[joint];
  const double low_deg = limit.min_rad * kDegrees, high_deg = limit.max_rad * kDegrees;
  const double at_deg = joints.theta_rad[leg][joint] * kDegrees;
  return text_line("theta%d of leg %d is at %s deg; its limits are %.1f to %.1f deg", status.joint,
                   status.leg, apart_from(at_deg, at_deg < low_deg ? low_deg : high_deg, 1).c_str(),
                   low_deg, high_deg);
}

std::string describe_singularity(const DeviceDescription& device, const SafetyLimits& limits,
                                 const Pose& T_device_plate, const JointAngles& joints) {
  const JacobianResult motion = jacobian(device, T_device_plate, joints);
  if (!motion.status) {
    return text_line("theta%d of leg %d is at the end of its reach", motion.status.joint,
                     motion.status.leg);
  }
  const Singularity measured = measure_singularity(device, T_device_plate, joints, motion.G);
  if (measured.nearest_branch_m < limits.branch_distance_min_m) {
    return text_line(
        "theta%d of leg %d is %s mm from the end of its reach; the limit is %.4g mm",
        measured.nearest_joint, measured.nearest_leg,
        apart_from(measured.nearest_branch_m * 1e3, limits.branch_distance_min_m * 1e3, 2).c_str(),
        limits.branch_distance_min_m * 1e3);
  }
  if (measured.inverse_condition >= limits.inverse_condition_min) return {};
  return describe_beyond("the inverse condition is", measured.inverse_condition,
                         limits.inverse_condition_min, "", 3);
}

/// The speeds of the plate's origin on the path.
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
  report.within_reach = report.within_reach && margins.reach;
  if (!margins.reach) return;
  report.inverse_condition_min = std::min(report.inverse_condition_min, margins.inverse_condition);
  if (margins.joint_rad < report.nearest.joint_rad) report.nearest = margins;
}

}  // namespace

PoseMargins pose_margins(const DeviceDescription& device, const SafetyLimits& limits,
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
  const InverseResult inverse = inverse_kinematics(device, T_device_plate);
  margins.reach = inverse.status;
  if (!margins.reach) return margins;
  const JacobianResult motion = jacobian(device, T_device_plate, inverse.joints);
  margins.reach = motion.status;
  if (!margins.reach) return margins;
  margins.joint_limit = check_joint_limits(device, encoder_angles(inverse.joints));
  margins.joint_rad = std::numeric_limits<double>::infinity();
  for (std::size_t leg = 0; leg < kLegs; ++leg) {
    for (std::size_t joint = 0; joint < 4; ++joint) {
      const double theta_rad = inverse.joints.theta_rad[leg][joint];
      const JointLimit& limit = device.joint_limit[joint];
      const double room_rad = std::min(theta_rad - limit.min_rad, limit.max_rad - theta_rad);
      if (!(room_rad < margins.joint_rad)) continue;
      margins.joint_rad = room_rad;
      margins.leg = static_cast<std::int8_t>(leg + 1);
      margins.joint = static_cast<std::int8_t>(joint + 1);
    }
  }
  const Singularity singularity =
      measure_singularity(device, T_device_plate, inverse.joints, motion.G);
  margins.inverse_condition = singularity.inverse_condition;
  margins.branch_m = singularity.nearest_branch_m;
  return margins;
}

// In the order of the loop's checks (haptic_loop.cpp).
Fault pose_fault(const SafetyLimits& limits, const PoseMargins& margins) noexcept {
  if (!margins.reach) return Fault::kPoseResidual;
  if (!margins.joint_limit) return Fault::kJointLimit;
  if (!(margins.inverse_condition >= limits.inverse_condition_min &&
        margins.branch_m >= limits.branch_distance_min_m)) {
    return Fault::kSingularity;
  }
  if (!(margins.box_m >= 0 && margins.tilt_rad <= limits.plate_tilt_max_rad)) {
    return Fault::kWorkspace;
  }
  return margins.tool_tilt_rad * kDegrees <= kMaxTilt_deg ? Fault::kNone : Fault::kToolTilt;
}

std::string describe_pose_fault(Fault fault, const DeviceDescription& device,
                                const SafetyLimits& limits, const Tool& tool,
                                const Pose& T_device_plate) {
  const PoseMargins margins = pose_margins(device, limits, tool, T_device_plate);
  const InverseResult inverse = inverse_kinematics(device, T_device_plate);
  switch (fault) {
    case Fault::kPoseResidual:
      if (margins.reach) return {};
      return text_line("theta%d of leg %d is %s", margins.reach.joint, margins.reach.leg,
                       to_string(margins.reach.failure));
    case Fault::kJointLimit:
      return inverse.status ? describe_joint(device, inverse.joints) : std::string{};
    case Fault::kSingularity:
      return inverse.status ? describe_singularity(device, limits, T_device_plate, inverse.joints)
                            : std::string{};
    case Fault::kWorkspace:
      if (margins.box_m < 0) return describe_box(limits, T_device_plate);
      if (margins.tilt_rad <= limits.plate_tilt_max_rad) return {};
      return describe_beyond("the plate is tilted by", margins.tilt_rad * kDegrees,
                             limits.plate_tilt_max_rad * kDegrees, " deg", 1);
    case Fault::kToolTilt:
      if (margins.tool_tilt_rad * kDegrees <= kMaxTilt_deg) return {};
      return describe_beyond("the tool is tilted by", margins.tool_tilt_rad * kDegrees,
                             kMaxTilt_deg, " deg", 1);
    default:
      return {};
  }
}

PathReport judge_path(const HandTrajectory& path, const DeviceDescription& device,
                      const SafetyLimits& limits, const Tool& tool, double from_s, double to_s) {
  constexpr double kEndless = std::numeric_limits<double>::infinity();
  PathReport report;
  report.tip_min_m.setConstant(kEndless);
  report.tip_max_m.setConstant(-kEndless);
  report.box_min_m = report.nearest.joint_rad = report.inverse_condition_min = kEndless;
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
    report.rotation_rate_max_rad_per_s =
        std::max(report.rotation_rate_max_rad_per_s, speed.rad_per_s);
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
    crossing.overlap =
        overlap(sheet, tool,
                outline_on_lattice(tool, crossing.T_device_plate, sheet.transform, sheet.z_m), {})
            .fraction;
    crossings.push_back(crossing);
  }
  return crossings;
}

std::optional<ReachHeights> reach_heights(const DeviceDescription& device,
                                          const SafetyLimits& limits, const Tool& tool) {
  std::optional<ReachHeights> longest;
  ReachHeights now;
  bool within = false;
  const int steps = static_cast<int>(
      std::floor((limits.workspace_max_m[2] - limits.workspace_min_m[2]) / kReachStep_m + 1e-9));
  for (int i = 0; i <= steps; ++i) {
    Eigen::Vector3d tip_m = tool.tip_plate_m;
    tip_m.z() += limits.workspace_min_m[2] + i * kReachStep_m;
    const bool good = is_reachable(device, limits, tool, tip_m);
    if (good && !within) now.min_m = tip_m.z();
    within = good;
    if (!good) continue;
    now.max_m = tip_m.z();
    if (!longest || now.max_m - now.min_m >= longest->max_m - longest->min_m) longest = now;
  }
  return longest;
}

std::optional<ReachRectangle> reach_rectangle(const DeviceDescription& device,
                                              const SafetyLimits& limits, const Tool& tool,
                                              double tip_z_m) {
  const Eigen::Vector2d middle_m = tool.tip_plate_m.head<2>();
  const auto is_good = [&](double x_m, double y_m) {
    return is_reachable(device, limits, tool, {middle_m.x() + x_m, middle_m.y() + y_m, tip_z_m});
  };
  if (!is_good(0, 0)) return std::nullopt;
  // Whole steps from the middle: low x, low y, high x, high y.
  std::array<int, 4> side{0, 0, 0, 0};
  const auto row_is_good = [&](std::size_t which, int at) {
    const std::size_t other = (which + 1) % 2;
    for (int k = side[other]; k <= side[other + 2]; ++k) {
      const double along_m = k * kReachStep_m, across_m = at * kReachStep_m;
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
  ReachRectangle rectangle;
  rectangle.min_m = middle_m + Eigen::Vector2d(side[0], side[1]) * kReachStep_m;
  rectangle.max_m = middle_m + Eigen::Vector2d(side[2], side[3]) * kReachStep_m;
  return rectangle;
}

}  // namespace trocar::runtime
