// SPDX-License-Identifier: Apache-2.0
// Converts between the frame of a pose device (runtime/device/pose_device.h) and {B}, the frame of
// the scene (metres, z up). A session places the middle of the device's workspace at the middle of
// the path of the scene's hand. If the handle is upright (its measured orientation is the
// identity), the tool has the orientation with which the scene's hand begins.
#pragma once

#include "formats/session/pose_device_description.h"
#include "runtime/device/pose.h"
#include "runtime/device/pose_device.h"

namespace trocar::runtime {

class PoseFrame {
 public:
  /// `T_device_plate_middle`: the plate's pose in {B} while the handle is upright in the middle of
  /// the device's workspace.
  PoseFrame(const PoseDeviceDescription& description, const Pose& T_device_plate_middle);

  /// Returns the plate's pose for a reading. Precondition: the reading's quaternion is not zero.
  Pose plate(const PoseReading& reading) const noexcept;
  /// The inverse of plate(): returns the handle's position and orientation for a pose of the plate.
  PoseReading reading(const Pose& T_device_plate) const noexcept;
  /// to_device() converts a wrench on the plate, about the plate's origin, from {B} to the device's
  /// frame. from_device() converts it back.
  HandleWrench to_device(const Wrench& wrench) const noexcept;
  Wrench from_device(const HandleWrench& wrench) const noexcept;
  /// The smallest box in {B} that contains the device's workspace.
  struct Box {
    Eigen::Vector3d min_m, max_m;
  };
  Box workspace() const noexcept;

 private:
  PoseDeviceDescription description_;
  Pose centre_;                    ///< T_device_plate_middle of the constructor
  Eigen::Vector3d middle_m_;       ///< middle of the workspace, in the device's frame
  Eigen::Quaterniond q_B_device_;  ///< rotates coordinates of the device's frame into {B}
};

}  // namespace trocar::runtime
