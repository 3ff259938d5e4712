// SPDX-License-Identifier: Apache-2.0
// The parts that a session with a pose device (runtime/device/pose_device.h) needs besides the
// device itself: built-in descriptions, the limits and the force scale that fit a device and a
// scene, and the entries about the device in a recording.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/result.h"
#include "formats/session/pose_device_description.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/contact/sheet.h"
#include "runtime/device/pose_device.h"
#include "runtime/session/session_options.h"
#include "runtime/simulation/hand.h"

namespace trocar::runtime {

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
