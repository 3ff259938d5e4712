// SPDX-License-Identifier: Apache-2.0
// A simulated hand presses a simulated device into one synthetic sheet, tick by tick: for tests and
// figures of the loop's effect on the hand.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <vector>

#include "runtime/device/four_legs/four_legs.h"
#include "runtime/device/simulated/simulated_device.h"
#include "runtime/haptics/contact_design.h"
#include "runtime/haptics/loop/haptic_loop.h"
#include "runtime/session/open_device.h"
#include "runtime/session/session.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/sheet_law_fixture.h"

namespace trocar::test {

struct RigOptions {
  double rate_Hz = 1000;
  Tissue tissue{5000, 1e6, 0, {}, {}};
  double hand_stiffness_N_per_m = 200;
  double hand_damping_N_s_per_m = 0;
  double pressed_N = 35;      ///< force of the hand at the end of its way down
  double going_down_s = 0.5;  ///< duration of the way down from the surface, at constant speed
  double lifted_at_s = 0;     ///< time at which the hand begins to move up at that speed; 0: never
  bool is_led = true;         ///< with the estimator and the guard
  double joint_friction_Nms_per_rad = 0.005;
  runtime::CouplingOptions coupling;
};

inline constexpr double kRigSheet_m = 0.15;

/// The sheet is at kRigSheet_m; the tool starts 1 mm above it.
class Rig {
 public:
  explicit Rig(const RigOptions& options) : options_(options) {
    Scene scene = descent_scene({kRigSheet_m}, kRigSheet_m + 1e-3, 0.1, 0.015);
    scene.tissue = options.tissue;
    const double depth_m = options.pressed_N / options.tissue.stiffness_N_per_m +
                           options.pressed_N / options.hand_stiffness_N_per_m;
    scene.hand.stiffness_N_per_m = options.hand_stiffness_N_per_m;
    scene.hand.damping_N_s_per_m = options.hand_damping_N_s_per_m;
    scene.hand.rotation_damping_Nm_s_per_rad = 0.3;
    scene.hand.trajectory = {{0, {0, 0, kRigSheet_m + 1e-3}, {}},
                             {0.05, {0, 0, kRigSheet_m + 1e-3}, {}},
                             {0.05 + options.going_down_s, {0, 0, kRigSheet_m - depth_m}, {}}};
    if (options.lifted_at_s > 0) {
      TipKeyframe held = scene.hand.trajectory.back(), up = scene.hand.trajectory.front();
      held.t_s = options.lifted_at_s;
      up.t_s = held.t_s + options.going_down_s;
      scene.hand.trajectory.push_back(held);
      scene.hand.trajectory.push_back(up);
    }
    description_ = default_device_description();
    description_.joint_viscous_friction_Nms_per_rad = options.joint_friction_Nms_per_rad;
    description_.motor_peak_time_s = 1e6;
    sheets_ = std::move(*runtime::place_slices(scene, square_asset(1), "rig"));
    current_ = {sheets_[0].get()};
    device_ = std::make_unique<runtime::SimulatedDevice>(
        std::move(*runtime::make_simulated_device(scene, description_)));
    runtime::MechanismLimits limits;
    limits.encoder_rate_max_rad_per_s = 1e6;
    limits.torque_rise_time_max_s = 1e6;
    limits.torque_rise_max_Nm_per_s = 1e9;
    four_legs_.emplace(description_, *device_, limits);
    model_.tool = runtime::make_tool(scene.tool);
    model_.rate_Hz = options.rate_Hz;
    model_.guards = options.is_led;
    law_ = hooke_law(model_, options.coupling);
    if (options.is_led) {
      const runtime::FourLegsSpecification specification(description_);
      const runtime::CouplingOptions& coupling = options.coupling;
      const double own = options.tissue.stiffness_N_per_m, spring = coupling.stiffness_N_per_m,
                   K = coupling.on ? own * spring / (own + spring) : own;
      const auto design = runtime::design_contact(
          specification, runtime::plate_axes(specification, device_->truth().T_device_plate),
          {1 / options.rate_Hz, 0},
          {.translation_N_per_m = K,
           .damping_N_s_per_m = coupling.on ? coupling.damping_N_s_per_m : 0});
      model_.estimator = design->estimator;
    }
    // Limits are off: these tests are about the loop's stability.
    model_.limits.speed_max_m_per_s = model_.limits.rotation_rate_max_rad_per_s = 1e6;
    model_.limits.energy_limit_J = 1e9;
  }

  const runtime::TickResult& tick() {
    runtime::TickInputs inputs;
    inputs.sheets = current_;
    runtime::haptic_tick(model_, inputs, *four_legs_, law_, state_, result_);
    device_->step(1 / options_.rate_Hz);
    return result_;
  }
  /// Ticks until `t_s`; the range of the tool's true height meanwhile, in m.
  double run_until(double t_s) {
    double low_m = 1e9, high_m = -1e9;
    while (device_->truth().t_s < t_s - 0.5 / options_.rate_Hz) {
      tick();
      const double z_m = device_->truth().T_device_plate.p_m.z();
      low_m = std::min(low_m, z_m);
      high_m = std::max(high_m, z_m);
      largest_N_ = std::max(largest_N_, result_.contact.force_N);
    }
    return high_m - low_m;
  }
  /// Damping of the device along z at its present pose, by joint friction only, in N s/m.
  double damping() const {
    return description_.joint_viscous_friction_Nms_per_rad *
           four_legs_->motor_jacobian().col(2).squaredNorm();
  }

  runtime::LoopModel model_;
  runtime::SheetLaw law_{runtime::ContactModel{}};
  runtime::LoopState state_;
  runtime::TickResult result_;
  std::unique_ptr<runtime::SimulatedDevice> device_;
  std::optional<runtime::FourLegs> four_legs_;
  double largest_N_ = 0;

 private:
  RigOptions options_;
  DeviceDescription description_;
  std::vector<std::unique_ptr<const runtime::Sheet>> sheets_;
  std::vector<const runtime::Sheet*> current_;
};

}  // namespace trocar::test
