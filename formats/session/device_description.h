// SPDX-License-Identifier: Apache-2.0
// The description of a haptic device: geometry, motors, joint limits, and the parameters of its
// simulation. The mechanism is the paper's four-legged, eight-motor device (section III);
// runtime/device/README.md explains how the paper's lengths are interpreted. ("The paper" is
// cited in the README.md of the root folder.) File: JSON, schema
// formats/session/device.schema.json.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include "formats/base/result.h"

namespace trocar {

/// Lengths are in metres and angles in radians. The frame {B} has its origin at the centre of the
/// base, and z points up. Leg number k, from 1 to 4, is at the azimuth (k - 1) * 90 degrees; the
/// leg's frame is {B} turned about z by this angle. The symbols are those of the paper. Each leg
/// has two motors. The upper motor turns its link by theta1; this link ends at the elbow E. The
/// lower motor turns its link by theta4; this link ends at F. runtime/device/README.md lists
/// all joints.
struct DeviceGeometry {
  double l1_m = 0;    ///< distance from the motor axis of theta1 to the elbow E
  double l2_m = 0;    ///< distance from the elbow E to the plate's ball joint C
  double l3_m = 0;    ///< distance from the motor axis of theta4 to F, the end of its link
  double l4_m = 0;    ///< distance from F to the ball joint D, which lies on the link EC
  double l5_m = 0;    ///< distance from the elbow E to D, along EC; less than l2
  double R_T_m = 0;   ///< radius of the circle of the ball joints C on the plate
  double R_B1_m = 0;  ///< radius of the circle of the axes of theta1
  double R_B2_m = 0;  ///< radius of the circle of the axes of theta4
  double H_B_m = 0;   ///< vertical distance from the axes of theta1 down to the lower motors' links
  double z_A_m = 0;   ///< height of the axes of theta1 above {B}'s origin
  double d_rad = 0;   ///< azimuth of the axis of theta4 in its leg's frame
  /// At a pose of the plate, theta1 and theta4 can have two values each, because their formulas
  /// contain +acos or -acos (runtime/device/four_legs/kinematics.h). The next two members are these signs,
  /// 1 or -1. They select the values that the real mechanism has.
  int branch_theta1 = 1;
  int branch_theta4 = 1;
  friend bool operator==(const DeviceGeometry&, const DeviceGeometry&) = default;
};

struct JointLimit {
  double min_rad = 0;
  double max_rad = 0;  ///< greater than min_rad, by at most 2 pi
  friend bool operator==(const JointLimit&, const JointLimit&) = default;
};
inline constexpr std::size_t kJointsPerLeg = 6;

/// Longest delay that a description may state.
inline constexpr double kLongestDelay_s = 0.1;

struct DeviceDescription {
  std::string name;
  DeviceGeometry geometry;
  double motor_peak_torque_Nm = 0;            ///< torque at the joint, the same for every motor
  double motor_continuous_torque_Nm = 0;      ///< torque at the joint; not above the peak
  double motor_torque_constant_Nm_per_A = 0;  ///< torque at the rotor per ampere
  double motor_gear_ratio = 0;   ///< revolutions of the rotor for one of the gear's output shaft
  double upper_bevel_ratio = 0;  ///< ratio of theta1's bevel gears; it multiplies motor_gear_ratio
  double motor_peak_current_A = 0;  ///< largest current that the drive supplies
  /// Largest continuous current of the motor or of the drive, whichever is lower. It is not above
  /// the peak current.
  double motor_continuous_current_A = 0;
  double motor_peak_time_s = 0;          ///< longest time at the peak current for a cold motor
  double joint_coulomb_friction_Nm = 0;  ///< friction at each of the eight motor joints
  std::array<JointLimit, kJointsPerLeg> joint_limit;  ///< theta1..theta6, the same in every leg
  double plate_mass_kg = 0;                           ///< mass of plate, sensor and grip together
  /// Principal moments of inertia about the origin and the axes of {T}, the plate's frame.
  std::array<double, 3> plate_inertia_kg_m2{};
  double plate_stiffness_max_N_per_m = 0;  ///< largest stiffness to render; 0: not given
  /// Time from a motion to the force that answers it, without the zero-order hold: of reading,
  /// transport and drive. Nullopt: not given.
  std::optional<double> delay_s;

  // The members below describe the simulated device. The haptic loop also uses the first three: the
  // friction for the device's damping and for the torques that compensate friction, the encoders'
  // counts and noise for the estimator, and gravity for the torques that compensate the weight.
  double joint_viscous_friction_Nms_per_rad = 0;  ///< at each of the eight motor joints
  /// Counts per revolution of a joint; 0: exact encoders.
  int encoder_counts_per_revolution = 0;
  double encoder_noise_rad = 0;  ///< standard deviation of an encoder's reading
  double gravity_m_per_s2 = 0;   ///< gravity along -z; 0: the mechanism is balanced
  int minimum_substeps = 0;      ///< smallest number of integration steps in one simulated tick
  double maximum_substep_s = 0;  ///< largest duration of an integration step

  friend bool operator==(const DeviceDescription&, const DeviceDescription&) = default;
};

/// The device of the paper (formats/session/four_legs.json).
DeviceDescription default_device_description();

/// Reads a description from JSON text. `source` is the text's name in error messages, for example
/// the file name. Errors: kRefused if the text is not JSON, if a key is unknown, repeated or
/// missing, if a type is wrong, if a number is outside the schema's range, or if the section
/// "assumed" names a value that the document does not have.
Result<DeviceDescription> parse_device_description(std::string_view json_text,
                                                   const std::string& source);

/// Like parse_device_description(), but from a file of at most 1 MiB.
Result<DeviceDescription> read_device_description(const std::string& path);

// The description of a haptic device that measures the pose of its handle itself, such as a desktop
// device with an SDK: what the device can render, and in which frame it measures. File: JSON,
// schema formats/session/pose_device.schema.json. docs/add-your-device.md says how to write one.

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
  double coulomb_friction_N = 0;  ///< dry friction of the device at the handle
  /// Smallest step of a reading; 0: exact; nullopt: not given.
  std::optional<double> position_resolution_m, rotation_resolution_rad;
  double position_noise_m = 0, rotation_noise_rad = 0;  ///< standard deviations of a reading
  std::optional<double> delay_s;                        ///< as DeviceDescription::delay_s
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
