// SPDX-License-Identifier: Apache-2.0
// Where the frame of a pose device lies in the scene's frame {B}. The middle of the device's workspace is placed
// at the middle of the path of the scene's hand. The upright handle holds the tool in the orientation that the
// scene's hand begins with.
// Tests: tests/runtime/pose_device/pose_hand_test.cpp
#pragma once

#include "formats/session/pose_device_description.h"
#include "runtime/device/pose.h"
#include "runtime/device/pose_device.h"

namespace trocar::runtime {

class PoseFrame {
 public:
  /// `T_device_plate_middle`: the plate's pose with the handle upright in the middle of its workspace.
  PoseFrame(const PoseDeviceDescription& description, const Pose& T_device_plate_middle);

  /// Returns the plate's pose for a reading, whose quaternion must not be zero.
  Pose plate(const PoseReading& reading) const noexcept;
  /// Returns the position and orientation of the handle at a pose of the plate. This is the inverse of plate().
  PoseReading reading(const Pose& T_device_plate) const noexcept;
  /// Convert a wrench on the plate about its origin from {B} to the device's frame, and back.
  HandleWrench to_device(const Wrench& wrench) const noexcept;
  Wrench from_device(const HandleWrench& wrench) const noexcept;
  /// The smallest box in {B} that contains the device's workspace.
  struct Box {
    Eigen::Vector3d min_m, max_m;
  };
  Box workspace() const noexcept;

 private:
  PoseDeviceDescription description_;
  Pose centre_;               ///< the plate's, with the handle upright in the workspace's middle
  Eigen::Vector3d middle_m_;  ///< middle of the workspace, in the device's frame
  Eigen::Quaterniond q_B_device_;  ///< turns the device's coordinates into {B}'s
};

}  // namespace trocar::runtime
