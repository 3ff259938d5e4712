// SPDX-License-Identifier: Apache-2.0
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
#pragma once

#include "runtime/device/hand_device.h"
#include "runtime/device/pose_device.h"
#include "runtime/pose_device/pose_frame.h"
#include "runtime/pose_device/pose_specification.h"

namespace trocar::runtime {

/// Largest speed and rotation rate of a hand. If two successive readings show a faster motion,
/// find_pose() returns kEncoderJump, the fault for measurements that jump.
inline constexpr double kMaxHandSpeed_m_per_s = 5, kMaxHandRate_rad_per_s = 60;
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
