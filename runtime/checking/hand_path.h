// SPDX-License-Identifier: Apache-2.0
// Follows the path of the scene's hand, and finds the points where the path exceeds a limit of the
// device or of the haptic loop, and the points where the path crosses a sheet. The tool is assumed
// to follow the hand exactly. The dry run (dry_run.h) shows how the tool moves if forces act on it.
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

/// If `fault` is raised because a pose exceeds a limit, returns a text with the pose's value and
/// the limit. Returns an empty text if the pose does not exceed the limit, or if `fault` has
/// another cause. Faults with a limit on the pose are kWorkspace, kToolTilt, and those of the
/// device's own checks.
std::string describe_pose_fault(Fault fault, const DeviceSpecification& device,
                                const SafetyLimits& limits, const Tool& tool,
                                const Pose& T_device_plate);

/// The first point of a path at which the haptic loop would raise `fault`.
struct PathBreach {
  Fault fault = Fault::kNone;
  double t_s = 0;
  Eigen::Vector3d tip_m = Eigen::Vector3d::Zero();
  std::string what;  ///< text of describe_pose_fault(), or a similar text for kSpeed
};

struct PathReport {
  double end_s = 0;  ///< time of the last point that was evaluated
  Eigen::Vector3d tip_min_m = Eigen::Vector3d::Zero(), tip_max_m = Eigen::Vector3d::Zero();
  /// box_min_m: smallest distance from the plate's origin to a side of the workspace; negative:
  /// outside. tilt_max_rad: largest angle between the z axes of the plate and of {B}.
  double box_min_m = 0, tilt_max_rad = 0;
  double speed_max_m_per_s = 0;  ///< speed of the plate's origin
  /// Distances of the path from the limits that the device itself checks. `is_reachable`: the
  /// device's geometry allows every point. `joint_rad` (with `joint`) and `inverse_condition`: the
  /// smallest values over the points that the geometry allows. The other members are not set.
  DeviceMargins device;
  std::vector<PathBreach> breaches;  ///< the first breach of each fault, in ascending time
};

/// Evaluates the path from `from_s` to `to_s`, at points that are at most 0.5 mm and 0.5 deg apart.
/// On a path that would need more than 16,000 steps of this size, the points are farther apart.
PathReport evaluate_path(const HandTrajectory& path, const DeviceSpecification& device,
                         const SafetyLimits& limits, const Tool& tool, double from_s, double to_s);

/// A point of the path at which the tip goes from above a sheet to below it.
struct SheetCrossing {
  double t_s = 0;
  Pose T_device_plate;
  Eigen::Vector3d tip_m = Eigen::Vector3d::Zero();
  double coverage = 0;  ///< fraction of the outline's area over material
};
/// Returns all crossings in ascending time, including those after the session's end.
std::vector<SheetCrossing> sheet_crossings(const HandTrajectory& path, const Tool& tool,
                                           const Sheet& sheet);

}  // namespace trocar::runtime
