// SPDX-License-Identifier: Apache-2.0
// Compares the path of the scene's hand with the limits of the device and the safety layer: the
// points where the path exceeds a limit, and the points where it crosses a sheet. The tool is assumed to follow the hand exactly. The dry run (dry_run.h) shows how the tool
// moves if forces act on it.
// Tests: tests/runtime/checking/hand_path_test.cpp
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "runtime/contact/sheet.h"
#include "runtime/contact/tool.h"
#include "runtime/control/limits.h"
#include "runtime/device/hand_device.h"
#include "runtime/devices/pose_margins.h"
#include "runtime/simulation/hand.h"

namespace trocar::runtime {

/// Describes how a pose exceeds the limit of a fault, with value and limit. The faults are kWorkspace,
/// kToolTilt, and those of the device's own checks. The text is empty for other faults, and if the
/// limit is not exceeded.
std::string describe_pose_fault(Fault fault, const DeviceSpecification& device,
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
  DeviceMargins device;  ///< is_reachable: every point is; others: smallest of the reachable points
  std::vector<PathBreach> breaches;  ///< the first breach of each fault, in ascending time
};

/// Evaluates the path from `from_s` to `to_s`. On a short path the points are 0.5 mm or 0.5 deg
/// apart; on a long path there are about 20,000 points.
PathReport evaluate_path(const HandTrajectory& path, const DeviceSpecification& device,
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
