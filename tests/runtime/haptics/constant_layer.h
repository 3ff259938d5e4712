// SPDX-License-Identifier: Apache-2.0
// A force law for tests, and the example of how to write one: below the topmost slice, tissue pushes the
// tip up with a constant force, in and out alike. One file and one call of add_force_law().
#pragma once

#include <algorithm>
#include <memory>
#include <string>

#include "runtime/haptics/force_law.h"
#include "runtime/session/force_law_table.h"

namespace trocar::runtime {

class ConstantLayerLaw final : public ForceLaw {
 public:
  static constexpr double kForce_N = 2;

  explicit ConstantLayerLaw(const ForceLawSetup& setup)
      : tool_(make_tool(setup.scene.tool)),
        top_z_m_(setup.sheets.front()->z_m),
        scale_(setup.scene.force_law.force_scale) {}

  FaultDetail update(const ForceLawInput& input, ContactOutput& output) noexcept override {
    output = ContactOutput{};
    output.T_device_evaluated = input.T_device_plate;
    output.tip_device_m = input.T_device_plate * tool_.tip_plate_m;
    const double depth_m = top_z_m_ - output.tip_device_m.z();
    if (!(depth_m > 0)) return {};
    output.phase = ContactPhase::kContact;
    output.active_sheet = 0;
    output.penetration_m = depth_m;
    output.force_N = kForce_N;
    output.wrench_device = wrench_at({0, 0, kForce_N}, output.tip_device_m, input.T_device_plate);
    output.wrench_plate = scale_ * output.wrench_device;
    output.stored_J = scale_ * kForce_N * depth_m;  // given back on the way out
    deepest_m_ = std::max(deepest_m_, depth_m);
    return {};
  }
  void reset_motion() noexcept override {}
  double retract_distance_m(std::span<const Sheet* const> /*sheets*/,
                            const Pose& T_device_plate) const noexcept override {
    return std::max(0.0, top_z_m_ - (T_device_plate * tool_.tip_plate_m).z());
  }
  std::string describe() const override { return "force law  constant\n"; }
  SummarySection summary() const override {
    return {"constant", "{\"deepest_m\": " + std::to_string(deepest_m_) + "}"};
  }

 private:
  Tool tool_;
  double top_z_m_, scale_;
  double deepest_m_ = 0;
};

/// Adds the law to the table, once.
inline ForceLawKind add_constant_layer() {
  static const ForceLawKind kind = add_force_law(
      {"constant"}, [](const ForceLawSetup& setup) -> Result<std::unique_ptr<ForceLaw>> {
        return std::unique_ptr<ForceLaw>(std::make_unique<ConstantLayerLaw>(setup));
      });
  return kind;
}

}  // namespace trocar::runtime
