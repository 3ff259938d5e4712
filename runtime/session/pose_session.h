// SPDX-License-Identifier: Apache-2.0
// Sessions with a pose device, and the tip positions that a device reaches.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/result.h"
#include "formats/session/device_description.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/device/hand_device.h"
#include "runtime/device/pose_device.h"
#include "runtime/device/simulated/hand.h"
#include "runtime/haptics/loop/safety.h"
#include "runtime/haptics/sheet.h"
#include "runtime/haptics/tool.h"
#include "runtime/session/session_options.h"

namespace trocar::runtime {

// The distances of a plate pose from the limits of the device and of the loop (safety.h).

/// Distances of a pose from the limits. `tilt_rad` and `tool_tilt_rad`, however, are the tilts
/// themselves, not their distances from the limits.
struct PoseMargins {
  DeviceMargins device;
  /// Smallest distance of the plate's origin from the sides of two workspaces: that of the loop's
  /// limits, and the one that the device itself states. Negative if the origin is outside at least
  /// one of the two.
  double box_m = 0;
  double tilt_rad = 0;       ///< angle between the z axes of the plate and of {B}
  double tool_tilt_rad = 0;  ///< angle between the tool's axis and the z axis of {B}
};
PoseMargins pose_margins(const DeviceSpecification& device, const SafetyLimits& limits,
                         const Tool& tool, const Pose& T_device_plate) noexcept;

/// Returns the fault that the loop raises at this pose, or none.
Fault pose_fault(const SafetyLimits& limits, const PoseMargins& margins) noexcept;

// Finds tip positions that a device reaches without turning the plate. A position counts as reached
// if pose_fault() finds no fault there.

/// A range of heights of the tip in {B}, for a plate whose origin is on the z axis of {B}.
struct WorkspaceHeights {
  double min_m = 0, max_m = 0;
};
/// Returns the longest range of heights that the tip reaches with the plate's rotation `q`, which
/// is upright by default. The function tests heights 2 mm apart. Returns nullopt if the tip reaches
/// none of these heights.
std::optional<WorkspaceHeights> workspace_heights(
    const DeviceSpecification& device, const SafetyLimits& limits, const Tool& tool,
    const Eigen::Quaterniond& q = Eigen::Quaterniond::Identity());

/// A rectangle of tip positions at one height in {B}. The tip reaches every position in the
/// rectangle with the same rotation of the plate.
struct WorkspaceRectangle {
  Eigen::Vector2d min_m = Eigen::Vector2d::Zero(), max_m = Eigen::Vector2d::Zero();
};
/// Returns a rectangle for the height `tip_z_m` and the plate's rotation `q`. The search begins at
/// the position that the tip has if the plate's origin is on the z axis of {B}. The function first
/// finds the largest square that has this position at its centre, and then moves one side after the
/// other outwards as far as the tip reaches. The function tests positions 2 mm apart. Returns
/// nullopt if the tip does not reach the position at which the search begins.
std::optional<WorkspaceRectangle> workspace_rectangle(
    const DeviceSpecification& device, const SafetyLimits& limits, const Tool& tool, double tip_z_m,
    const Eigen::Quaterniond& q = Eigen::Quaterniond::Identity());

// The parts that a session with a pose device (runtime/device/pose_device.h) needs besides the
// device itself: built-in descriptions, the limits and the force scale that fit a device and a
// scene, and the entries about the device in a recording.

/// Suffix of a built-in description's name, if the device measures the orientation of its handle.
inline constexpr std::string_view kWithRotation = "+rotation";

/// Returns the built-in description with this name, such as "haply_inverse3"
/// (runtime/device/NAME.json). If the name ends with kWithRotation, the description's
/// senses_rotation is true, otherwise false. Errors: kRefused if there is no such description.
Result<PoseDeviceDescription> built_in_pose_device(std::string_view name);

/// Sets the options that depend on the pose device:
///  - The smallest box in {B} around the device's workspace becomes the workspace limit. (The
///    device itself checks its workspace, a box in the device's own frame. If this frame is turned
///    relative to {B}, the box in {B} can be larger than the workspace.)
///  - After a fault there is no ramp: the force goes to zero in the tick that finds the fault.
///  - When a session begins, the force rises from zero.
///  - The rendered stiffness is at most StiffnessLimits::max_N_per_m. If the description states a
///    largest stiffness, this stiffness divided by StiffnessLimits::margin is a second limit.
///  - If the force law treats slices as separate sheets, the virtual coupling is switched on. If
///    the description states a largest stiffness, the coupling's spring is as stiff as the two
///    limits allow. If it states none, the stiffness that the spring renders (with the force scale)
///    is the stiffness in CouplingOptions divided by the margin, but at most
///    StiffnessLimits::max_N_per_m. If the coupling is on already (the operator chose its
///    stiffness), the spring is changed only if it is too stiff for the limits.
void set_pose_device_options(const PoseDeviceDescription& description, const Scene& scene,
                             SessionOptions& options);

/// Returns the largest force scale (factor on all forces of a scene) with which the device can
/// render the forces at which the scene's slices and soft layers break. With the force law
/// `cutting`, the forces of the slices are first multiplied by 1.5, because friction on the shaft
/// adds to them; those of the soft layers are not. The result is at most the force scale that the
/// scene states. Errors: those of make_force_law().
Result<double> fitting_force_scale(const PoseDeviceDescription& description, const Scene& scene,
                                   std::span<const std::unique_ptr<const Sheet>> sheets,
                                   double rate_Hz);

/// Writes the entries about the pose device into the origin of a recording, which says how the
/// recording was made. `device`: the digest of the device's description, or "built-in/NAME" for a
/// built-in description.
void write_pose_device_origin(const std::string& device, const PoseDeviceDescription& description,
                              const Scene& scene, const SessionOptions& options,
                              RecordingOrigin& origin);

/// The entries about a pose device in a recording's origin.
struct PoseDeviceOrigin {
  std::optional<std::string> built_in;  ///< name of a built-in description; nullopt: not built in
  double force_scale = 1, force_max_N = 0, stiffness_margin = 1;
};
/// Reads the entries that write_pose_device_origin() wrote. Returns nullopt if the recording was
/// not made with a pose device.
std::optional<PoseDeviceOrigin> read_pose_device_origin(const RecordingOrigin& recorded);

}  // namespace trocar::runtime
