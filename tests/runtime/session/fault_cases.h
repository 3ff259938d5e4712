// SPDX-License-Identifier: Apache-2.0
// The faults that fault_injection_test.cpp injects, and those that it does not inject.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <ostream>
#include <random>
#include <utility>
#include <vector>

#include "runtime/device/device.h"
#include "runtime/device/four_legs/kinematics.h"
#include "runtime/device/four_legs/mechanism_limits.h"
#include "runtime/haptics/membrane/sheet_law.h"
#include "runtime/session/force_law_table.h"
#include "runtime/session/session_options.h"
#include "tests/support/uniform.h"

namespace trocar::runtime::testing_support {

/// Kinds of injected faults.
struct Injection {
  DeviceStatus on_read = DeviceStatus::kOk, on_write = DeviceStatus::kOk;
  std::function<void(DeviceState& state, const DeviceState& at_begin)> corrupt;
  int late_ms = 0;  ///< that reading takes
};

struct FaultCase {
  const char* name;
  Fault fault;
  /// Makes the fault of the device, or sets limits that the motion of the hand will exceed.
  std::function<Injection(std::mt19937_64& random, SessionOptions& options,
                          MechanismLimits& mechanism)>
      make;
  double lasts_s = 0.03;
  bool at_once = true;                                  ///< found in the tick in which it begins
  bool loaded = true;                                   ///< found while the tool is in the sheet
  std::function<void(Scene& scene)> prepare = nullptr;  ///< changes the scene of the session
};

inline std::ostream& operator<<(std::ostream& stream, const FaultCase& test) {
  return stream << test.name;
}

/// Faults of the device and of what the hand does.
inline std::vector<FaultCase> cases() {
  using Generator = std::mt19937_64;
  using Options = SessionOptions;
  using trocar::test::uniform;
  const auto status = [](DeviceStatus on_read, DeviceStatus on_write) {
    return [=](Generator&, Options&, MechanismLimits&) {
      return Injection{on_read, on_write, {}, 0};
    };
  };
  const auto any_encoder = [](auto change) {
    return [change](Generator& random, Options&, MechanismLimits&) {
      const auto i = static_cast<std::size_t>(random() % kEncoders);
      Injection made;
      made.corrupt = [change, i](DeviceState& state, const DeviceState& begin) {
        change(state.encoder_rad[i], begin.encoder_rad[i]);
      };
      return made;
    };
  };
  const auto limits = [](auto change) {
    return [change](Generator& random, Options& options, MechanismLimits&) {
      change(options.limits, uniform(random));
      return Injection{};
    };
  };
  const auto mechanism = [](auto change) {
    return [change](Generator& random, Options&, MechanismLimits& changed) {
      change(changed, uniform(random));
      return Injection{};
    };
  };
  constexpr auto kOk = DeviceStatus::kOk;
  return {
      {"link_lost", Fault::kLinkLost, status(DeviceStatus::kLinkLost, kOk)},
      {"link_lost_in_writing", Fault::kLinkLost, status(kOk, DeviceStatus::kLinkLost)},
      {"write_failed", Fault::kWriteFailed, status(kOk, DeviceStatus::kNoData)},
      {"emergency_stop", Fault::kEmergencyStop, status(DeviceStatus::kEmergencyStop, kOk)},
      {"motor_fault", Fault::kMotorFault, status(DeviceStatus::kMotorFault, kOk)},
      {"several_ticks_without_data", Fault::kNoData, status(DeviceStatus::kNoData, kOk), 0.03,
       false},
      {"encoder_nan", Fault::kEncoderNotFinite,
       any_encoder([](double& angle, double) { angle = NAN; })},
      {"encoder_jump", Fault::kEncoderJump,
       any_encoder([](double& angle, double) { angle += 0.3; })},
      {"encoder_jump_for_one_tick", Fault::kEncoderJump,
       any_encoder([](double& angle, double) { angle -= 0.3; }), 0.0005},
      // The encoder is stuck: found once the others have moved.
      {"encoder_stuck", Fault::kPoseResidual,
       [](Generator& random, Options&, MechanismLimits&) {
         Injection made;
         const std::size_t i = 4 * (random() % kLegs);  // theta1
         made.corrupt = [i](DeviceState& state, const DeviceState& begin) {
           state.encoder_rad[i] = begin.encoder_rad[i];
         };
         return made;
       },
       0.5, false, false},
      {"workspace", Fault::kWorkspace,
       limits([](SafetyLimits& l, double u) { l.workspace_min_m[2] = 0.1165 + 0.002 * u; }), 0,
       false},
      {"speed", Fault::kSpeed,
       limits([](SafetyLimits& l, double u) { l.speed_max_m_per_s = 0.062 + 0.01 * u; }), 0, false,
       false},
      {"torque_limit", Fault::kTorqueLimit,
       mechanism([](MechanismLimits& l, double u) { l.torque_max_Nm = 0.2 + 0.2 * u; }), 0, false},
      {"torque_rate", Fault::kTorqueRate, mechanism([](MechanismLimits& l, double u) {
         l.torque_rise_max_Nm_per_s = 3 + 2 * u;
         l.torque_rise_time_max_s = 0.015;
       }),
       0, false},
      // The sampled sheet gives back more than it took, by up to 2 mJ a press.
      {"energy_limit", Fault::kEnergyLimit,
       [](Generator& random, Options& options, MechanismLimits&) {
         options.limits.energy_limit_J = 2e-5 * (1 + uniform(random));
         options.guards = false;
         return Injection{};
       },
       0, false, false},
      {"motor_overload", Fault::kMotorOverload,
       mechanism([](MechanismLimits& l, double u) { l.overload_time_max_s = 0.01 + 0.03 * u; }), 0,
       false},
  };
}

using EncoderAngles = std::array<double, kEncoders>;

/// The device's encoders jump to these angles, which no limit on speed prevents.
inline Injection jump_to(const EncoderAngles& encoder_rad, SessionOptions& options,
                         MechanismLimits& mechanism) {
  mechanism.encoder_rate_max_rad_per_s = 1e6;
  options.limits.speed_max_m_per_s = options.limits.rotation_rate_max_rad_per_s = 1e6;
  Injection made;
  made.corrupt = [encoder_rad](DeviceState& state, const DeviceState&) {
    state.encoder_rad = encoder_rad;
  };
  return made;
}

/// Returns the angles of the worst conditioned of some poses of the workspace, and sets the limit
/// half-way between this pose and those on the hand's way.
inline EncoderAngles nearly_singular(MechanismLimits& mechanism) {
  const DeviceDescription device = default_device_description();
  double worst = 1, on_the_way = 1;
  EncoderAngles found{};
  for (int i = 0; i < 12; ++i) {
    for (const double aside_m : {0.0, 0.02}) {
      Pose pose;
      pose.p_m = {aside_m, aside_m, 0.095 + 0.01 * i};
      const InverseResult inverse = inverse_kinematics(device, pose);
      const JacobianResult motion = jacobian(device, pose, inverse.joints);
      const EncoderAngles angles = encoder_angles(inverse.joints);
      if (!inverse.status || !motion.status || !check_joint_limits(device, angles)) continue;
      const double condition =
          measure_singularity(device, pose, inverse.joints, motion.G).inverse_condition;
      if (aside_m == 0 && pose.p_m.z() > 0.1 && pose.p_m.z() < 0.13)
        on_the_way = std::min(on_the_way, condition);
      if (condition >= worst) continue;
      worst = condition;
      found = angles;
    }
  }
  EXPECT_LT(worst, 0.95 * on_the_way) << "another pose must be worse than those of the hand";
  mechanism.inverse_condition_min = (worst + on_the_way) / 2;
  return found;
}

/// The law `hooke`, which calls kBreak in each tick in which the tip is 2 mm below a sheet.
template <void (*kBreak)(ContactOutput&)>
class BrokenLaw final : public SheetLaw {
 public:
  using SheetLaw::SheetLaw;
  FaultDetail update(const ForceLawInput& input, ContactOutput& output) noexcept override {
    const FaultDetail fault = SheetLaw::update(input, output);
    if (output.penetration_m > 2e-3) kBreak(output);
    return fault;
  }
};

template <void (*kBreak)(ContactOutput&)>
void use_broken_law(Scene& scene, const char* name) {
  static const ForceLawKind kind =
      add_force_law({name}, [](const ForceLawSetup& setup) -> Result<std::unique_ptr<ForceLaw>> {
        ContactModel model;
        model.tool = make_tool(setup.scene.tool);
        model.dt_s = 1 / setup.rate_Hz;
        return std::unique_ptr<ForceLaw>(std::make_unique<BrokenLaw<kBreak>>(model));
      });
  scene.force_law.kind = kind;
}

inline void lose_force(ContactOutput& output) {
  output.wrench_plate[2] = NAN;
}
inline void fill_queue(ContactOutput& output) {
  output.backlog = true;
}

/// Faults that need another pose of the plate, another tool or another law.
inline std::vector<FaultCase> cases_of_pose_and_law() {
  using Generator = std::mt19937_64;
  using Options = SessionOptions;
  const auto nothing = [](Generator&, Options&, MechanismLimits&) { return Injection{}; };
  return {
      {"joint_limit", Fault::kJointLimit,
       [](Generator& random, Options&, MechanismLimits& mechanism) {
         mechanism.encoder_rate_max_rad_per_s = 1e6;
         const auto i = static_cast<std::size_t>(random() % kEncoders);
         // Leg by leg, theta1 to theta4.
         const double beyond_rad = default_device_description().joint_limit[i % 4].max_rad + 0.01;
         Injection made;
         made.corrupt = [i, beyond_rad](DeviceState& state, const DeviceState&) {
           state.encoder_rad[i] = beyond_rad;
         };
         return made;
       }},
      {"singularity", Fault::kSingularity,
       [](Generator&, Options& options, MechanismLimits& mechanism) {
         const EncoderAngles angles = nearly_singular(mechanism);
         return jump_to(angles, options, mechanism);
       }},
      // The axis is tilted by 40 degrees, and then by 8 more.
      {"tool_tilt", Fault::kToolTilt,
       [](Generator&, Options& options, MechanismLimits& mechanism) {
         Pose pose;
         pose.p_m = {0, 0, 0.116};
         pose.q = from_rotation_vector({0, 8 * std::acos(-1.0) / 180, 0});
         const InverseResult inverse = inverse_kinematics(default_device_description(), pose);
         EXPECT_TRUE(inverse.status);
         return jump_to(encoder_angles(inverse.joints), options, mechanism);
       },
       0.03, true, true, [](Scene& scene) { scene.tool.tilt_deg = 40; }},
      {"torque_not_finite", Fault::kTorqueNotFinite, nothing, 0, false, true,
       [](Scene& scene) { use_broken_law<lose_force>(scene, "loses its force"); }},
      {"remesh_backlog", Fault::kRemeshBacklog, nothing, 0, false, true,
       [](Scene& scene) { use_broken_law<fill_queue>(scene, "fills its queue"); }},
  };
}

inline std::vector<FaultCase> all_cases() {
  std::vector<FaultCase> all = cases();
  for (FaultCase& each : cases_of_pose_and_law())
    all.push_back(std::move(each));
  return all;
}

/// A fault that no case injects, and why.
struct NotInjected {
  Fault fault;
  const char* because;
};
inline constexpr NotInjected kNotInjected[] = {
    {Fault::kDeadlineMissed, "it needs the real clock: ALateTickInRealTime injects it"},
    {Fault::kPaused, "the operator commands it: paused_session_test.cpp"},
    {Fault::kForcesOff, "the operator commands it: paused_session_test.cpp"},
    {Fault::kRecordingFailed, "it ends the session: session_test.cpp"},
    {Fault::kRefusedState, "a link or a pose device finds it: pose_session_test.cpp"},
};

}  // namespace trocar::runtime::testing_support
