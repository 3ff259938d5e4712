// SPDX-License-Identifier: Apache-2.0
// A pose device (a device that measures its own pose) that is simulated in this process. It is a
// rigid handle with the mass and damping of the description. The commanded wrench and a simulated
// hand move the handle. If the device does not sense rotation, the handle keeps its orientation.
// The device is deterministic: the same calls give the same bits.
#pragma once

#include "formats/base/result.h"
#include "runtime/pose_device/pose_frame.h"
#include "runtime/simulation/hand.h"

namespace trocar::runtime {

class SimulatedPoseDevice final : public PoseDevice {
 public:
  /// Makes a device. The tool's tip begins at the hand's first target. `T_plate_tool`: pose of the
  /// tip on the plate; the plate of this device is its handle. Errors: kRefused if check_hand()
  /// refuses the hand.
  static Result<SimulatedPoseDevice> make(const PoseDeviceDescription& description,
                                          const PoseFrame& frame, const HandMotion& motion,
                                          const HandImpedance& impedance, const Pose& T_plate_tool);

  /// Reads the pose, rounded to the description's resolution, and its time, rounded to nanoseconds.
  DeviceStatus read(PoseReading& reading) noexcept override;
  /// Sets the wrench that is held in the following steps. If a value is not finite, the wrench
  /// becomes zero.
  DeviceStatus write(const HandleWrench& wrench) noexcept override;
  /// Advances time by dt_s. The integrator is semi-implicit Euler with substeps of at most 0.1 ms.
  /// If dt_s is above 0.1 s, the handle moves for 0.1 s only. Does not allocate.
  void advance(double dt_s) noexcept override;
  bool is_paced_by_loop() const noexcept override { return true; }

  const Pose& T_device_plate() const noexcept { return T_; }
  const Twist& twist_device() const noexcept { return twist_; }

 private:
  SimulatedPoseDevice(const PoseDeviceDescription& description, const PoseFrame& frame,
                      const HandMotion& motion, const HandImpedance& impedance,
                      const Pose& T_plate_tool)
      : description_(description),
        frame_(frame),
        motion_(motion),
        impedance_(impedance),
        T_plate_tool_(T_plate_tool) {}
  Wrench hand(double t_s) const noexcept;
  void substep(double t_s, double h_s) noexcept;

  PoseDeviceDescription description_;
  PoseFrame frame_;
  HandMotion motion_;
  HandImpedance impedance_;
  Pose T_plate_tool_;
  Pose T_;  ///< pose of the plate
  Twist twist_ = Twist::Zero();
  Wrench command_ = Wrench::Zero();  ///< commanded wrench on the plate, in {B}
  double t_s_ = 0;
};

}  // namespace trocar::runtime
