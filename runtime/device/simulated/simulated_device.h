// SPDX-License-Identifier: Apache-2.0
// Simulated devices in this process: four-legged, and one that measures its own pose.
#pragma once

#include <optional>
#include <random>

#include "formats/base/result.h"
#include "formats/session/device_description.h"
#include "runtime/device/device.h"
#include "runtime/device/four_legs/kinematics.h"
#include "runtime/device/pose/pose_hand.h"
#include "runtime/device/simulated/hand.h"
#include "runtime/device/simulated/mechanics.h"

namespace trocar::runtime {

// A simulated four-legged haptic device, which runs in this process. Four things act on the plate:
// the motors' wrench G^T tau at the true pose (G: Jacobian), the joints' friction, the weight, and
// a simulated hand. The weight is zero unless the description sets a gravity, because the mechanism
// is assumed to be balanced. There are two variants of the model. In the light model only the plate
// has mass, and friction is viscous. The full model of mechanics.h
// (SimulatedDeviceOptions::mechanics) has links, rotors, dry friction, current lag and encoder
// noise. The model is deterministic: the same calls give the same bits.

struct SimulatedDeviceOptions {
  Pose T_plate_tool;  ///< pose of the tool's tip on the plate
  /// Start pose. By default the tip starts at the hand's first target; if there is no hand, the
  /// plate starts at kSimulatedHomeHeight_m.
  std::optional<Pose> T_device_plate_start;
  std::optional<MechanicsOptions> mechanics;  ///< properties of the full model; none: light model
};
/// If there is no hand, the plate starts upright on the z axis at this height.
inline constexpr double kSimulatedHomeHeight_m = 0.15;

/// Work since the start, computed with midpoint velocities. In the light model, the sum of the
/// work should equal the change of the kinetic energy. If the plate only translates, the difference
/// is rounding. If the plate rotates, the difference is of first order in the length of a substep.
struct EnergyBalance {
  double hand_J = 0;    ///< work of the hand on the plate
  double motors_J = 0;  ///< work of the motors on the plate
  /// Work of joint friction on the plate. It is not positive, except for energy that the springs of
  /// dry friction return.
  double friction_J = 0;
  double gravity_J = 0;  ///< work of gravity
  double stop_J = 0;     ///< energy lost at the limit of the workspace, as a negative number
};

/// The true state of the model, which a real device does not provide.
struct SimulatedTruth {
  double t_s = 0;
  Pose T_device_plate;
  Twist twist_device = Twist::Zero();  ///< twist of the plate's origin, in {B}
  JointAngles joints;
  MotorVector tau_motor_Nm = MotorVector::Zero();    ///< commanded torques, limited to the peak
  MotorVector tau_applied_Nm = MotorVector::Zero();  ///< torques after the current loop's lag
  Wrench wrench_hand = Wrench::Zero();  ///< on the tool about its tip, in the last substep, in {B}
  double kinetic_J = 0;                 ///< energy of all moving masses, including the hand's
  EnergyBalance work;
  bool at_stop = false;  ///< the last step reached the limit of the workspace
};

/// Position and velocity of the tool's tip, in {B}.
struct TrueTip {
  Eigen::Vector3d at_m = Eigen::Vector3d::Zero(), velocity_m_per_s = Eigen::Vector3d::Zero();
};

/// Holds commands back for a time, in whole steps: the delay of a device.
template <typename Command>
class DelayedCommands {
 public:
  /// Returns the command to apply in a step of `dt_s`.
  const Command& after(double delay_s, double dt_s, const Command& latest) noexcept {
    const auto steps = static_cast<std::size_t>(
        std::clamp<double>(std::round(delay_s / dt_s), 0, static_cast<double>(kMost)));
    next_ = (next_ + 1) % ring_.size();
    ring_[next_] = latest;
    return ring_[(next_ + ring_.size() - steps) % ring_.size()];
  }

 private:
  static constexpr std::size_t kMost = 800;  ///< 0.1 s at 8 kHz
  std::array<Command, kMost + 1> ring_{};
  std::size_t next_ = 0;
};

class SimulatedDevice final : public Device {
 public:
  /// Makes a device. Errors: kRefused if check_hand() refuses the hand, if a value of the mechanics
  /// is negative or not finite, if presliding_rad is 0, or if the start pose is outside the
  /// workspace.
  static Result<SimulatedDevice> make(const DeviceDescription& device, const HandMotion& motion,
                                      const HandImpedance& impedance,
                                      const SimulatedDeviceOptions& options = {});

  /// Reads the time and the encoder angles of the true pose. The time is rounded to nanoseconds, as
  /// on the link. The angles contain the encoder noise of MechanicsOptions, or else of the
  /// description, with new random numbers in each call, and are quantised as the description says.
  DeviceStatus read(DeviceState& state) noexcept override;
  /// Sets the torques that are held in the following steps, after the description's delay, and
  /// limits them to the motors' peak torque. If a torque is not finite, all torques become zero.
  DeviceStatus write(const DeviceCommand& command) noexcept override;

  /// Calls step().
  void advance(double dt_s) noexcept override { step(dt_s); }
  bool is_paced_by_loop() const noexcept override { return true; }

  /// Advances time by dt_s. If dt_s is not in (0, kMaxStep_s], returns false and changes nothing.
  /// The step is divided into at least minimum_substeps substeps, none longer than
  /// maximum_substep_s; the description has both numbers. If a strongly damped or stiff hand would
  /// make these substeps unstable, there are more of them. The integrator is semi-implicit Euler for
  /// the light model, and the midpoint rule for the full model and for a hand with mass. At the
  /// limit of the workspace the plate stops: it keeps its pose, and its velocity becomes zero. No
  /// allocation.
  bool step(double dt_s) noexcept;

  const SimulatedTruth& truth() const noexcept { return truth_; }
  TrueTip tip() const noexcept;

 private:
  SimulatedDevice(const DeviceDescription& device, const HandMotion& motion,
                  const HandImpedance& impedance, const SimulatedDeviceOptions& options)
      : device_(device), motion_(motion), impedance_(impedance), options_(options) {}
  struct Forces;
  void substep(double t_s, double h_s) noexcept;
  void midpoint_substep(double t_s, double h_s) noexcept;
  Forces forces(const Pose& T, const JointAngles& joints, const Twist& twist, double t_s,
                double since_s) const noexcept;
  void release_hand_mass() noexcept;
  double kinetic_energy() const noexcept;
  bool uses_mechanics() const noexcept {
    return options_.mechanics.has_value() || impedance_.mass_kg > 0;
  }
  double hand_mass_kg() const noexcept { return hand_mass_attached_ ? impedance_.mass_kg : 0; }

  DeviceDescription device_;
  HandMotion motion_;
  HandImpedance impedance_;
  SimulatedDeviceOptions options_;
  SimulatedTruth truth_;
  double damping_rate_per_s_ = 0,
         stiffness_rate_per_s2_ = 0;  ///< largest rates of the hand (max_rate())
  bool hand_mass_attached_ = false;
  MotorVector presliding_rad_ = MotorVector::Zero();  ///< deflection of dry friction's springs
  std::mt19937_64 noise_{1};
  std::array<double, kMotors> command_Nm_{};
  DelayedCommands<std::array<double, kMotors>> delayed_;
};

inline constexpr double kMaxStep_s = 0.1;

// A pose device (a device that measures its own pose) that is simulated in this process. It is a
// rigid handle with the mass and damping of the description. The commanded wrench and a simulated
// hand move the handle. If the device does not sense rotation, the handle keeps its orientation.
// The device is deterministic: the same calls give the same bits.

class SimulatedPoseDevice final : public PoseDevice {
 public:
  /// Makes a device. The tool's tip begins at the hand's first target. `T_plate_tool`: pose of the
  /// tip on the plate; the plate of this device is its handle. Errors: kRefused if check_hand()
  /// refuses the hand.
  static Result<SimulatedPoseDevice> make(const PoseDeviceDescription& description,
                                          const PoseFrame& frame, const HandMotion& motion,
                                          const HandImpedance& impedance, const Pose& T_plate_tool);

  /// Reads the pose, with the description's noise and rounded to its resolution, and its time,
  /// rounded to nanoseconds.
  DeviceStatus read(PoseReading& reading) noexcept override;
  /// Sets the wrench that is held in the following steps, after the description's delay. If a value
  /// is not finite, the wrench becomes zero.
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
  std::array<double, 6> command_{};  ///< commanded wrench on the plate, in {B}
  Wrench applied_ = Wrench::Zero();
  DelayedCommands<std::array<double, 6>> delayed_;
  std::mt19937_64 noise_{1};
  double t_s_ = 0;
};

}  // namespace trocar::runtime
