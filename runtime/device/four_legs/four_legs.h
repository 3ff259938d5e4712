// SPDX-License-Identifier: Apache-2.0
// The four-legged device: its specification, and the device as a HandDevice.
#pragma once

#include "formats/session/device_description.h"
#include "runtime/device/device.h"
#include "runtime/device/four_legs/mechanism_limits.h"
#include "runtime/device/hand_device.h"

namespace trocar::runtime {

// The DeviceSpecification of the four-legged device: its mass, damping, largest wrenches and the
// margins of a pose, computed from the device's description. The force laws and the checks of a
// scene use it.

class FourLegsSpecification final : public DeviceSpecification {
 public:
  /// `limits`: the limits for margins() and describe_fault(). The device (FourLegs) checks the same
  /// limits in every tick. The programs use the defaults.
  explicit FourLegsSpecification(const DeviceDescription& description,
                                 const MechanismLimits& limits = {})
      : description_(description), limits_(limits) {}

  const DeviceDescription& description() const noexcept { return description_; }
  std::string_view name() const noexcept override { return description_.name; }
  std::string describe_strength() const override;
  bool senses_rotation() const noexcept override { return true; }
  MotorsAndJoints motors_and_joints() const override;
  double mass_kg() const noexcept override { return description_.plate_mass_kg; }
  std::array<double, 3> inertia_kg_m2() const noexcept override {
    return description_.plate_inertia_kg_m2;
  }
  double stiffness_max_N_per_m() const noexcept override {
    return description_.plate_stiffness_max_N_per_m;
  }
  /// Of an encoder at the length of the upper motor's link, and about the plate's radius.
  DeviceReadings readings() const noexcept override;
  double encoder_count_rad() const noexcept;  ///< 0: the encoders are exact
  std::optional<Eigen::Matrix<double, 6, 6>> damping(const Pose& T_device_plate) const override;
  double renderable_fraction(const Pose& T_device_plate,
                             const Wrench& wrench_device) const override;
  std::string describe_demand(std::string_view what, const Pose& T_device_plate,
                              const Wrench& wrench_device) const override;
  DeviceMargins margins(const Pose& T_device_plate) const noexcept override;
  std::string describe_margins(const DeviceMargins& smallest) const override;
  /// `fault` is kJointLimit, kSingularity or kPoseResidual. margins() returns kPoseResidual for a
  /// pose that the device cannot reach.
  std::string describe_fault(Fault fault, const Pose& T_device_plate) const override;
  std::optional<Pose> pose_of(const RecordingRow& row) const override;

 private:
  DeviceDescription description_;
  MechanismLimits limits_;
};

// The four-legged device as a HandDevice: the pose is computed from sixteen encoders, and eight
// motor torques render a wrench. A Device (device.h) gives access to encoders and motors. The
// encoders and motors can be simulated, connected by a link, or replayed from a recording.
//
// Contract, in addition to the contracts of hand_device.h and mechanism_limits.h:
//  1. Every torque written is finite and within what its motor's thermal state allows.
//  2. The pose is fitted to the joint angles theta1, theta2 and theta3 of each leg (kinematics.h).
//     The encoder of theta4 serves as a check: find_pose() computes theta4 from the pose and
//     compares it with the measured theta4.
//  3. Compensation torques cancel the device's own friction and weight. They rise from zero at the
//     start and after stop() and fade(), so that they do not jump. The motors' limits apply to the
//     sum of compensation and rendered torques. delivered() returns the wrench of the rendered
//     torques without the compensation.

class FourLegs final : public HandDevice {
 public:
  /// `device` must outlive this object.
  FourLegs(const DeviceDescription& description, Device& device, const MechanismLimits& limits = {})
      : device_(device), specification_(description, limits), limits_(limits) {
    change(description, limits);
  }

  const DeviceSpecification& specification() const noexcept override { return specification_; }
  Result<void> start() override { return device_.start(); }

  DeviceStatus read(double& t_s) noexcept override;
  void use_last_reading() noexcept override { reading_ = last_; }
  /// Checks the encoders (values, steps and limits) and the pose (residuals and distance from
  /// singularities).
  FaultDetail find_pose(const ReadingInterval& interval, PlatePose& pose) noexcept override;
  const Measurement& measured() const noexcept override { return reading_; }
  bool keep_reading() noexcept override;
  FaultDetail account_held_time(double held_s) noexcept override;
  /// Returns kMotorOverload while a motor has used more than half of its i2t capacity.
  FaultDetail check_rested() const noexcept override;
  FaultDetail render(const RenderInput& input, double& scale) noexcept override;
  void stop() noexcept override { at_stop_Nm_ = written_Nm_; }
  void fade(double share) noexcept override;
  DeviceStatus write() noexcept override;
  void write_zero() noexcept override { device_.write(DeviceCommand{}); }
  Wrench delivered() const noexcept override {
    return G_.transpose() * (written_Nm_ - compensation_Nm_);
  }
  FaultDetail fault_of(DeviceStatus status) const noexcept override;
  FaultDetail refused_contents() const noexcept override { return device_.refused_contents(); }
  void restore() noexcept override { device_.restore(); }
  void describe(RecordingRow& row, DeviceReadout& readout) const noexcept override;
  void advance(double dt_s) override { device_.advance(dt_s); }
  void close() override { device_.close(); }
  bool is_paced_by_loop() const override { return device_.is_paced_by_loop(); }
  std::optional<LinkReport> link_report() const override { return device_.link_report(); }

  // Tests call these functions between two ticks.

  /// Replaces description and limits. The state of the device, such as the motors' heat, is kept.
  void change(const DeviceDescription& description, const MechanismLimits& limits) {
    specification_ = FourLegsSpecification(description, limits);
    limits_ = limits;
    motor_ = make_motor_model(description);
  }
  /// Jacobian at the last pose for which find_pose() raised no fault.
  const Jacobian& motor_jacobian() const noexcept { return G_; }
  const MotorVector& torques_at_stop_Nm() const noexcept { return at_stop_Nm_; }
  const MotorVector& compensation_Nm() const noexcept { return compensation_Nm_; }
  MotorState& motors() noexcept { return motors_; }

 private:
  FaultDetail check_encoders(const ReadingInterval& interval) const noexcept;
  MotorVector compensation(const RenderInput& input) noexcept;

  const DeviceDescription& description() const noexcept { return specification_.description(); }

  Device& device_;
  FourLegsSpecification specification_;
  MechanismLimits limits_;
  MotorModel motor_;
  MotorState motors_;
  Measurement reading_{0, kEncoders, {}}, last_{0, kEncoders, {}};
  Jacobian G_ = Jacobian::Zero();
  MotorVector next_Nm_ = MotorVector::Zero();          ///< torques that write() will send
  MotorVector written_Nm_ = MotorVector::Zero();       ///< torques last written
  MotorVector at_stop_Nm_ = MotorVector::Zero();       ///< torques when stop() was called
  MotorVector compensation_Nm_ = MotorVector::Zero();  ///< compensation contained in next_Nm_
  double compensation_authority_ = 0;                  ///< factor on the compensation
};

}  // namespace trocar::runtime
