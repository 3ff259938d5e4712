// SPDX-License-Identifier: Apache-2.0
// A pose device as a HandDevice: frames, specification, adapter.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <utility>

#include "formats/session/device_description.h"
#include "runtime/device/device.h"
#include "runtime/device/hand_device.h"
#include "runtime/device/pose_device.h"

namespace trocar::runtime {

// Converts between the frame of a pose device (runtime/device/pose_device.h) and {B}, the frame of
// the scene (metres, z up). A session places the middle of the device's workspace at the middle of
// the path of the scene's hand. If the handle is upright (its measured orientation is the
// identity), the tool has the orientation with which the scene's hand begins.

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

// The DeviceSpecification of a pose device (runtime/device/pose_device.h), a device that measures
// the pose of its handle itself. The values are taken from the device's description. Force laws
// and the checks of a scene use them.

/// Returns the fraction of the wrench that a device of this description can render, at most 1. The
/// moment is ignored if the device renders no moments.
double renderable_fraction(const PoseDeviceDescription& description, const Wrench& wrench) noexcept;

class PoseSpecification final : public DeviceSpecification {
 public:
  PoseSpecification(PoseDeviceDescription description, const PoseFrame& frame)
      : description_(std::move(description)), frame_(frame) {}

  std::string_view name() const noexcept override { return description_.name; }
  std::string describe_strength() const override;
  bool senses_rotation() const noexcept override { return description_.senses_rotation; }
  std::optional<WorkspaceBox> workspace() const noexcept override;
  double mass_kg() const noexcept override { return description_.mass_kg; }
  std::array<double, 3> inertia_kg_m2() const noexcept override {
    return description_.inertia_kg_m2;
  }
  double stiffness_max_N_per_m() const noexcept override {
    return description_.stiffness_max_N_per_m;
  }
  DeviceReadings readings() const noexcept override;
  std::optional<Eigen::Matrix<double, 6, 6>> damping(const Pose& T_device_plate) const override;
  double renderable_fraction(const Pose& T_device_plate,
                             const Wrench& wrench_device) const override;
  std::string describe_demand(std::string_view what, const Pose& T_device_plate,
                              const Wrench& wrench_device) const override;

  DeviceMargins margins(const Pose& T_device_plate) const noexcept override;
  std::string describe_fault(Fault fault, const Pose& T_device_plate) const override;
  std::optional<Pose> pose_of(const RecordingRow& row) const override;

  const PoseDeviceDescription& description() const noexcept { return description_; }
  const PoseFrame& frame() const noexcept { return frame_; }

 private:
  bool renders_moment() const noexcept { return description_.moment_max_Nm > 0; }

  PoseDeviceDescription description_;
  PoseFrame frame_;
};

// Turns a device that measures its own pose (PoseDevice) into a HandDevice, the interface that the
// haptic loop uses. This class checks the readings and limits the commands.
//
// Contract, in addition to that of hand_device.h:
//  1. A reading raises kRefusedState if a number is not finite, a coordinate is beyond kFarthest_m,
//     or the length of the quaternion is not 1. It raises kEncoderJump if the motion since the last
//     reading is faster than a hand can move. The reading then gives no pose. The quaternion is checked only if the device senses rotation. A reading
//     outside the box of the description gives a pose, but check_own_workspace() returns a fault.
//  2. Every command is finite. Its force and its moment do not exceed the maxima that the
//     description states. If the wanted wrench exceeds them, its force and moment are scaled down
//     by the same factor. If the device renders no moment, commands and delivered() contain none.
//  3. A quaternion and its negative are the same rotation. measured() has the sign with which the
//     quaternion is nearer to the previously measured one, so that a mere change of the sign does
//     not count as a motion.

/// No handle is farther from its device's origin. The unit of a larger coordinate is plainly another,
/// such as mm. If the description states a larger workspace, twice its largest coordinate counts.
inline constexpr double kFarthest_m = 2;

class PoseHand final : public HandDevice {
 public:
  /// `device` must outlive this object.
  PoseHand(const PoseDeviceDescription& description, const PoseFrame& frame, PoseDevice& device);

  const DeviceSpecification& specification() const noexcept override { return specification_; }
  Result<void> start() override { return device_.start(); }

  DeviceStatus read(double& t_s) noexcept override;
  void use_last_reading() noexcept override { reading_ = last_; }
  FaultDetail find_pose(const ReadingInterval& interval, PlatePose& pose) noexcept override;
  FaultDetail check_own_workspace() const noexcept override;
  const Measurement& measured() const noexcept override { return measured_; }
  bool keep_reading() noexcept override;
  FaultDetail render(const RenderInput& input, double& scale) noexcept override;
  void stop() noexcept override { at_stop_ = written_; }
  void fade(double share) noexcept override;
  DeviceStatus write() noexcept override;
  void write_zero() noexcept override { device_.write(HandleWrench{}); }
  Wrench delivered() const noexcept override { return frame().from_device(written_); }
  FaultDetail fault_of(DeviceStatus status) const noexcept override;
  FaultDetail refused_contents() const noexcept override { return device_.refused_contents(); }
  void restore() noexcept override { device_.restore(); }
  void describe(RecordingRow& row, DeviceReadout& readout) const noexcept override;
  void advance(double dt_s) override { device_.advance(dt_s); }
  void close() override { device_.close(); }
  bool is_paced_by_loop() const override { return device_.is_paced_by_loop(); }
  std::optional<LinkReport> link_report() const override { return device_.link_report(); }

 private:
  FaultDetail check(const ReadingInterval& interval) const noexcept;
  bool is_finite() const noexcept;
  const PoseDeviceDescription& description() const noexcept { return specification_.description(); }
  const PoseFrame& frame() const noexcept { return specification_.frame(); }

  PoseDevice& device_;
  PoseSpecification specification_;
  PoseReading reading_, last_;
  Measurement measured_;
  HandleWrench next_{}, written_{}, at_stop_{};
};

}  // namespace trocar::runtime
