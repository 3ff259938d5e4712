// SPDX-License-Identifier: Apache-2.0
// The description of a haptic device that measures the pose of its handle itself, such as a desktop
// device with an SDK: what the device can render, and in which frame it measures. File: JSON,
// schema formats/session/pose_device.schema.json. docs/add-your-device.md says how to write one.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <variant>

#include "formats/base/result.h"
#include "formats/session/device_description.h"

namespace trocar {

/// Lengths are in metres. "The device's frame" is the frame in which the device measures positions
/// and takes forces.
struct PoseDeviceDescription {
  std::string name;
  double force_max_N = 0;            ///< largest force to command
  double moment_max_Nm = 0;          ///< largest moment to command; 0: the device renders no moment
  bool senses_rotation = false;      ///< true: the device measures its handle's orientation
  double stiffness_max_N_per_m = 0;  ///< largest stiffness to render at the tip; 0: not given
  double mass_kg = 0;                ///< mass that the hand feels at the handle
  std::array<double, 3> inertia_kg_m2{1e-4, 1e-4, 1e-4};  ///< moments of inertia of the handle
  double damping_N_s_per_m = 0;  ///< viscous friction of the device at the handle
  double rotation_damping_Nm_s_per_rad = 0;
  double position_resolution_m = 0;    ///< 0: exact positions
  double rotation_resolution_rad = 0;  ///< 0: exact orientations
  /// Box of the positions that the handle can reach, in the device's frame. A second box surrounds
  /// the positions that the handle has at the keyframes of the scene's hand
  /// (SceneHand::trajectory). A session places the device in the scene's frame {B} so that the
  /// middles of the two boxes coincide.
  std::array<double, 3> workspace_min_m{}, workspace_max_m{};
  /// Rotation vector that turns the axes of the scene's frame {B} (z up) into the axes of the
  /// device's frame.
  std::array<double, 3> turn_rad{};
  int buttons = 0;  ///< number of buttons whose state the device sends

  friend bool operator==(const PoseDeviceDescription&, const PoseDeviceDescription&) = default;
};

/// Reads a description from JSON text. `source` is the text's name in error messages, for example
/// the file name. Errors: those of parse_device_description().
Result<PoseDeviceDescription> parse_pose_device_description(std::string_view json_text,
                                                            const std::string& source);

/// The description of a device of either kind.
using AnyDeviceDescription = std::variant<DeviceDescription, PoseDeviceDescription>;

/// Reads the description of a device of either kind from a file of at most 1 MiB. The file's
/// "schema" gives the kind. Errors: those of parse_device_description(); kRefused if the file
/// cannot be read.
Result<AnyDeviceDescription> read_any_device_description(const std::string& path);

}  // namespace trocar
