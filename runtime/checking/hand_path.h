// SPDX-License-Identifier: Apache-2.0
// Compares the path of the scene's hand with the limits of the device and the safety layer: the
// margins of a pose, the points where the path exceeds a limit, and the points where it crosses a
// sheet. The tool is assumed to follow the hand exactly. The dry run (dry_run.h) shows how the tool
// moves if forces act on it.
// Tests: tests/runtime/checking/hand_path_test.cpp
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "formats/session/device_description.h"
#include "runtime/contact/sheet.h"
#include "runtime/contact/tool.h"
#include "runtime/control/limits.h"
#include "runtime/simulation/hand.h"

namespace trocar::runtime {

inline constexpr double kDegreesPerRadian = 180 / std::numbers::pi;

/// Distances of a pose from the limits; a negative distance is beyond the limit.
struct PoseMargins {
  KinematicsStatus pose;  ///< status of the inverse kinematics and of the Jacobian
  double box_m = 0;       ///< distance of the plate's origin from the nearest workspace side
  double tilt_rad = 0;    ///< angle between the z axes of the plate and of {B}
  double tool_tilt_rad = 0;
  // The following members are valid only if `pose` is kOk.
  KinematicsStatus joint_limit;  ///< status of the limits of th1..th4
  double joint_rad = 0;          ///< smallest distance of th1..th4 from their limits
  std::int8_t leg = 0, joint = 0;
  double inverse_condition = 0;
  double branch_m = 0;  ///< Singularity::nearest_branch_m
};
PoseMargins pose_margins(const DeviceDescription& device, const SafetyLimits& limits,
                         const Tool& tool, const Pose& T_device_plate) noexcept;

/// Returns the fault with which the loop stops at this pose, or none.
Fault pose_fault(const SafetyLimits& limits, const PoseMargins& margins) noexcept;

/// Describes how a pose exceeds the limit of a fault, with value and limit. The faults are
/// kJointLimit, kSingularity, kPoseResidual (unreachable), kWorkspace and kToolTilt. The text is
/// empty for other faults, and if the limit is not exceeded.
std::string describe_pose_fault(Fault fault, const DeviceDescription& device,
                                const SafetyLimits& limits, const Tool& tool,
                                const Pose& T_device_plate);

/// The first point of a path that exceeds the limit of a fault.
struct PathBreach {
  Fault fault = Fault::kNone;
  double t_s = 0;
  Eigen::Vector3d tip_m = Eigen::Vector3d::Zero();
  std::string what;  ///< text of describe_pose_fault(), or a similar text for kSpeed
};

struct PathReport {
  double end_s = 0;  ///< end of the part that was evaluated
  Eigen::Vector3d tip_min_m = Eigen::Vector3d::Zero(), tip_max_m = Eigen::Vector3d::Zero();
  double box_min_m = 0, tilt_max_rad = 0;
  double speed_max_m_per_s = 0;  ///< speed of the plate's origin
  double rotation_rate_max_rad_per_s = 0;
  bool is_reachable = true;          ///< every sampled point is reachable
  PoseMargins nearest;               ///< margins of the reachable point nearest to a joint limit
  double inverse_condition_min = 0;  ///< smallest value among the reachable points
  std::vector<PathBreach> breaches;  ///< the first breach of each fault, in ascending time
};

/// Evaluates the path from `from_s` to `to_s`. On a short path the points are 0.5 mm or 0.5 deg
/// apart; on a long path there are about 20,000 points.
PathReport evaluate_path(const HandTrajectory& path, const DeviceDescription& device,
                         const SafetyLimits& limits, const Tool& tool, double from_s, double to_s);

/// A point of the path where the tip goes from above to below a sheet.
struct SheetCrossing {
  double t_s = 0;
  Pose T_device_plate;
  Eigen::Vector3d tip_m = Eigen::Vector3d::Zero();
  double coverage = 0;  ///< fraction of the tool's outline over material
};
/// Returns all crossings in ascending time, including those after the session's end.
std::vector<SheetCrossing> sheet_crossings(const HandTrajectory& path, const Tool& tool,
                                           const Sheet& sheet);

}  // namespace trocar::runtime
