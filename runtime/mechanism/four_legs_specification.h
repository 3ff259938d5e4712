// SPDX-License-Identifier: Apache-2.0
// The facts about the four-legged device that force laws and checks of a scene use, computed from its description.
// Tests: tests/runtime/mechanism/four_legs_test.cpp
#pragma once

#include "formats/session/device_description.h"
#include "runtime/device/hand_device.h"

namespace trocar::runtime {

class FourLegsSpecification final : public DeviceSpecification {
 public:
  explicit FourLegsSpecification(const DeviceDescription& description)
      : description_(description) {}

  const DeviceDescription& description() const noexcept { return description_; }
  double mass_kg() const noexcept override { return description_.plate_mass_kg; }
  std::array<double, 3> inertia_kg_m2() const noexcept override {
    return description_.plate_inertia_kg_m2;
  }
  double stiffness_max_N_per_m() const noexcept override {
    return description_.plate_stiffness_max_N_per_m;
  }
  /// Angle of one encoder count; 0: the encoders are exact.
  double resolution() const noexcept override;
  std::optional<Eigen::Matrix<double, 6, 6>> damping(const Pose& T_device_plate) const override;
  double renderable_share(const Pose& T_device_plate, const Wrench& wrench_device) const override;
  std::string describe_demand(std::string_view what, const Pose& T_device_plate,
                              const Wrench& wrench_device) const override;

 private:
  DeviceDescription description_;
};

}  // namespace trocar::runtime
