// SPDX-License-Identifier: Apache-2.0
// The DeviceSpecification of the four-legged device: its mass, damping, largest wrenches and the
// margins of a pose, computed from the device's description. The force laws and the checks of a
// scene use it.
#pragma once

#include "formats/session/device_description.h"
#include "runtime/device/hand_device.h"
#include "runtime/mechanism/mechanism_limits.h"

namespace trocar::runtime {

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
  /// Angle of one encoder count in rad; 0 if the encoders are exact.
  double resolution() const noexcept override;
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

}  // namespace trocar::runtime
