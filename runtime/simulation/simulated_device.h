// SPDX-License-Identifier: Apache-2.0
// The haptic device as a model in the process, moved by the motors' wrench G^T tau
// at its true pose, the joints' friction and a simulated hand. Two models: the
// light one, in which only the plate has mass and friction is viscous; and, with
// SimulatedDeviceOptions::mechanics, that of mechanics.h with links, rotors, dry
// friction, current lag and encoder noise. The mechanism is taken as balanced
// (gravity 0 unless the description says otherwise).
// Deterministic: the same calls give the same bits.
#pragma once

#include <optional>
#include <random>

#include "formats/session/device_description.h"
#include "formats/base/result.h"
#include "runtime/device/device.h"
#include "runtime/simulation/hand.h"
#include "runtime/mechanism/kinematics.h"
#include "runtime/simulation/mechanics.h"
#include "runtime/mechanism/pose.h"

namespace trocar::runtime {

struct SimulatedDeviceOptions {
  Pose T_plate_tool;                          ///< the tool's tip on the plate
  std::optional<Pose> T_device_plate_start;   ///< else: the tip at the hand's first keyframe, or
                                              ///< without a hand kSimulatedHome
  bool limit_torque = true;                   ///< the drives clip each motor to its peak torque
  std::optional<MechanicsOptions> mechanics;  ///< none: the light model
};
/// Where the plate starts if nothing says otherwise: upright on the z axis.
inline constexpr double kSimulatedHomeHeight_m = 0.15;

/// Work since the start, by midpoint velocities: for translation the sum closes
/// to rounding, for rotation with the substep's length.
struct EnergyBook {
  double hand_J = 0;      ///< done by the hand on the plate
  double motors_J = 0;    ///< done by the motors on the plate
  double friction_J = 0;  ///< done by joint friction on the plate; not positive, but for what dry
                          ///< friction's springs have stored and give back
  double gravity_J = 0;   ///< done by gravity
  double stop_J = 0;      ///< taken from the plate by the end of reach, not positive
};

/// What the model knows and a real device would not tell.
struct SimulatedTruth {
  double t_s = 0;
  Pose T_device_plate;
  Twist twist_device = Twist::Zero();  ///< of the plate's origin, in {B}
  JointAngles joints;
  MotorVector tau_motor_Nm = MotorVector::Zero();    ///< as commanded, after the drives' limit
  MotorVector tau_applied_Nm = MotorVector::Zero();  ///< the same after the current loop's lag
  Wrench wrench_motors = Wrench::Zero();  ///< on the plate about its origin, at the last substep
  Wrench wrench_hand = Wrench::Zero();    ///< on the tool about its tip, at the last substep
  double kinetic_J = 0;                   ///< of all that moves, the hand's mass included
  EnergyBook work;
  bool torque_limited = false;   ///< the last command exceeded a motor's peak
  bool command_refused = false;  ///< the last command was not finite; zero torques are applied
  bool at_stop = false;          ///< the last step ended at the end of reach
};

class SimulatedDevice final : public Device {
 public:
  /// Refused: a hand that check_hand refuses, a start out of reach.
  static Result<SimulatedDevice> make(const DeviceDescription& device,
                                      const HandTrajectory& trajectory,
                                      const HandImpedance& impedance,
                                      const SimulatedDeviceOptions& options = {});

  /// Time and encoders of the true pose, with the noise of mechanics (drawn anew in each call),
  /// quantised as the description says.
  DeviceStatus read(DeviceState& state) noexcept override;
  /// Holds the torques (zero-order hold) for the steps to come.
  DeviceStatus write(const DeviceCommand& command) noexcept override;

  /// Moves time on by dt_s in (0, kLongestStep_s] (else false, and nothing
  /// happens): semi-implicit Euler in at least the description's minimum_substeps,
  /// none longer than its maximum_substep_s. Where the mechanism cannot follow
  /// it stops dead: pose kept, velocity zero. No allocation.
  bool step(double dt_s) noexcept;

  const SimulatedTruth& truth() const noexcept { return truth_; }
  Pose T_device_tool() const noexcept { return truth_.T_device_plate * options_.T_plate_tool; }

 private:
  SimulatedDevice(const DeviceDescription& device, const HandTrajectory& trajectory,
                  const HandImpedance& impedance, const SimulatedDeviceOptions& options)
      : device_(device), trajectory_(trajectory), impedance_(impedance), options_(options) {}
  struct Forces;
  void substep(double t_s, double h_s) noexcept;
  void midpoint_substep(double t_s, double h_s) noexcept;
  Forces forces(const Pose& T, const JointAngles& joints, const Twist& twist, double t_s,
                double since_s) const noexcept;
  void let_go() noexcept;
  double kinetic_energy() const noexcept;
  bool hand_holds(double t_s) const noexcept {
    return !trajectory_.keyframes.empty() && t_s < impedance_.let_go_t_s;
  }
  bool uses_mechanics() const noexcept {
    return options_.mechanics.has_value() || impedance_.mass_kg > 0;
  }
  double hand_mass_kg() const noexcept { return hand_mass_rides_ ? impedance_.mass_kg : 0; }

  DeviceDescription device_;
  HandTrajectory trajectory_;
  HandImpedance impedance_;
  SimulatedDeviceOptions options_;
  SimulatedTruth truth_;
  bool hand_mass_rides_ = false;
  MotorVector presliding_rad_ = MotorVector::Zero();  ///< of dry friction's springs
  std::mt19937_64 noise_;
};

inline constexpr double kLongestStep_s = 0.1;

}  // namespace trocar::runtime
