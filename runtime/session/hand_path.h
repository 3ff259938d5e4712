// SPDX-License-Identifier: Apache-2.0
// The path that the scene's hand pulls the tool along, against the limits of device and safety
// layer: how much room a pose leaves, where the path goes beyond a limit, where it goes through the
// sheets, and which volume the tip can reach. The path is that of a tool that follows the hand
// exactly; what the tool does under force is the trial session's (trial.h).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "formats/session/device_description.h"
#include "runtime/contact/sheet.h"
#include "runtime/contact/tool.h"
#include "runtime/control/limits.h"
#include "runtime/simulation/hand.h"

namespace trocar::runtime {

/// How far a pose is from each limit; a negative distance is beyond it.
struct PoseMargins {
  KinematicsStatus reach;  ///< of the inverse kinematics and the Jacobian
  double box_m = 0;        ///< of the plate's origin from the nearest side of the workspace's box
  double tilt_rad = 0;     ///< of the plate's z axis against {B}'s
  double tool_tilt_rad = 0;
  // Only if `reach` holds:
  KinematicsStatus joint_limit;  ///< of th1..th4
  double joint_rad = 0;          ///< the smallest distance of th1..th4 from their limits
  std::int8_t leg = 0, joint = 0;
  double inverse_condition = 0;
  double branch_m = 0;  ///< Singularity::nearest_branch_m
};
PoseMargins pose_margins(const DeviceDescription& device, const SafetyLimits& limits,
                         const Tool& tool, const Pose& T_device_plate) noexcept;

/// The fault with which the loop stops at this pose, or none.
Fault pose_fault(const SafetyLimits& limits, const PoseMargins& margins) noexcept;

/// What is beyond the limit at a pose, with its value and the limit. Of kJointLimit, kSingularity,
/// kPoseResidual (out of reach), kWorkspace and kToolTilt; for others, and if this limit is kept,
/// empty.
std::string describe_pose_fault(Fault fault, const DeviceDescription& device,
                                const SafetyLimits& limits, const Tool& tool,
                                const Pose& T_device_plate);

/// The first place of a path that is beyond the limit of a fault.
struct PathBreach {
  Fault fault = Fault::kNone;
  double t_s = 0;
  Eigen::Vector3d tip_m = Eigen::Vector3d::Zero();
  std::string what;  ///< as describe_pose_fault; also of kSpeed
};

struct PathReport {
  double end_s = 0;  ///< of the part that was judged
  Eigen::Vector3d tip_min_m = Eigen::Vector3d::Zero(), tip_max_m = Eigen::Vector3d::Zero();
  double box_min_m = 0, tilt_max_rad = 0;
  double speed_max_m_per_s = 0;  ///< of the plate's origin
  double rotation_rate_max_rad_per_s = 0;
  bool within_reach = true;  ///< every sampled place
  PoseMargins nearest;       ///< the sampled place within reach that is nearest a joint limit
  double inverse_condition_min = 0;  ///< of the places within reach
  std::vector<PathBreach> breaches;  ///< one for each fault, in ascending time
};

/// From `from_s` to `to_s`, at most some 20,000 places, 0.5 mm or 0.5 deg apart on a short path.
PathReport judge_path(const HandTrajectory& path, const DeviceDescription& device,
                      const SafetyLimits& limits, const Tool& tool, double from_s, double to_s);

/// Where the tip goes from above to below a sheet on the path.
struct SheetCrossing {
  double t_s = 0;
  Pose T_device_plate;
  Eigen::Vector3d tip_m = Eigen::Vector3d::Zero();
  double overlap = 0;  ///< share of the tool's outline over material
};
/// All, in ascending time, also after the session's end.
std::vector<SheetCrossing> sheet_crossings(const HandTrajectory& path, const Tool& tool,
                                           const Sheet& sheet);

/// Heights of the tip, in m, that the upright plate reaches above the device's middle; none: none.
struct ReachHeights {
  double min_m = 0, max_m = 0;
};
std::optional<ReachHeights> reach_heights(const DeviceDescription& device,
                                          const SafetyLimits& limits, const Tool& tool);

/// A rectangle of tip positions at one height, every one of which the upright plate reaches: the
/// largest square around the device's middle, each side then moved out as far as it goes. To 2 mm,
/// and seen at places 2 mm apart.
struct ReachRectangle {
  Eigen::Vector2d min_m = Eigen::Vector2d::Zero(), max_m = Eigen::Vector2d::Zero();
};
std::optional<ReachRectangle> reach_rectangle(const DeviceDescription& device,
                                              const SafetyLimits& limits, const Tool& tool,
                                              double tip_z_m);

}  // namespace trocar::runtime
