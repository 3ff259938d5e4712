// SPDX-License-Identifier: Apache-2.0
// The interface between the haptic loop and a device that a hand holds: a pose comes in, a wrench
// goes out. The loop, its safety checks, the force laws and the checks of a scene use only this
// interface. runtime/device/four_legs/four_legs.h implements it for the four-legged device of the paper,
// on top of the interface to encoders and motors (device.h).
//
// A session calls start() once, and close() at its end. A tick calls the functions that it needs,
// in this order: read(), find_pose(), account_held_time(), then render() if forces are to be
// rendered or fade() if they are to go to zero, write(), describe() and advance(). Of the functions
// that the haptic thread calls, only advance() may block; the others do not allocate, lock, throw
// or block.
//
// Contract:
//  1. The result of a tick depends only on the construction arguments, on the readings, and on the
//     sequence of calls. A replay of the readings therefore gives the same result, bit for bit.
//  2. Whatever wrench is wanted, the command of write() is finite and within the device's limits.
//  3. delivered() is the wrench that the last command renders to the hand. The energy account
//     (runtime/haptics/loop/passivity.h) uses this wrench, not the wrench that was wanted.
#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/faults.h"
#include "formats/session/recording.h"
#include "runtime/device/device.h"

namespace trocar::runtime {

/// No device has more than kMaxMeasured values in a Measurement, or kMaxCommanded in a command.
inline constexpr int kMaxMeasured = 16, kMaxCommanded = 8;

/// Values measured at one time, in the device's own coordinates, such as encoder angles.
struct Measurement {
  double t_s = 0;  ///< time of the measurement, on the device's clock
  int count = 0;   ///< number of values
  std::array<double, kMaxMeasured> value{};
};

/// How far a pose is from the limits that the device itself checks. If the device has no joints,
/// the members about joints keep their defaults.
struct DeviceMargins {
  Fault fault = Fault::kNone;  ///< the fault that the device raises at this pose, or none
  /// True if the device's geometry allows this pose, even if the pose is outside the limits. If
  /// false, the members below keep their defaults.
  bool is_reachable = true;
  /// Smallest distance of the plate's origin from the sides of the workspace that the device itself
  /// states; negative outside, infinite if it states none.
  double box_m = std::numeric_limits<double>::infinity();
  /// Smallest distance of a joint from its limit; negative if a joint is beyond its limit.
  double joint_rad = std::numeric_limits<double>::infinity();
  /// Index in Measurement::value of the joint with the distance `joint_rad`; -1: no joint.
  int joint = -1;
  /// Smallest over largest singular value of the Jacobian: 1 is best, 0 is a singularity.
  double inverse_condition = 1;
};

/// Noise (standard deviation) and smallest step of the plate's measured position and orientation.
/// 0: exact.
struct DeviceReadings {
  double noise_m = 0, resolution_m = 0, noise_rad = 0, resolution_rad = 0;
  double delay_s = 0;       ///< from a motion to the force that answers it, without the hold
  bool is_assumed = false;  ///< resolution_m is kAssumedResolution_m, since none is stated
};
inline constexpr double kAssumedResolution_m = 50e-6, kAssumedResolution_rad = 1e-3;

/// A box in {B}, for positions of the plate's origin.
struct WorkspaceBox {
  std::array<double, 3> min_m{}, max_m{};
};

/// Limits of the motors and joints, for programs that display a session. If the device does not
/// know a limit, its member is empty.
struct MotorsAndJoints {
  std::optional<double> motor_peak_torque_Nm, motor_continuous_torque_Nm;
  std::vector<std::array<double, 2>> joint_limits_rad;  ///< each joint's least and largest angle
};

/// Facts about a device that do not change during a session. The force laws, the checks of a scene,
/// the live hand and the telemetry use this class and need no access to the device itself. The
/// haptic thread may call the functions that are noexcept.
class DeviceSpecification {
 public:
  virtual ~DeviceSpecification() = default;

  /// Name of the device, for display.
  virtual std::string_view name() const noexcept = 0;
  /// Returns the largest force or torque as text for `check`, such as "6 Nm peak a motor".
  virtual std::string describe_strength() const = 0;
  /// False if the device measures only its position. The plate then always has the orientation that
  /// it had at the start.
  virtual bool senses_rotation() const noexcept = 0;
  /// Workspace that the maker states; nullopt if the maker states none. Without a stated workspace,
  /// only the safety limits and the device's own checks bound the workspace.
  virtual std::optional<WorkspaceBox> workspace() const noexcept { return std::nullopt; }
  virtual MotorsAndJoints motors_and_joints() const { return {}; }

  /// Mass that the hand feels at the plate.
  virtual double mass_kg() const noexcept = 0;
  /// Moments of inertia about the three axes of the plate.
  virtual std::array<double, 3> inertia_kg_m2() const noexcept = 0;
  /// Largest stiffness at the tip that the maker states; 0 if the maker states none.
  virtual double stiffness_max_N_per_m() const noexcept = 0;
  virtual DeviceReadings readings() const noexcept = 0;
  /// Damping that the device's own friction gives the plate at a pose: the matrix that maps the
  /// plate's twist to the wrench that opposes this twist. Nullopt if the pose is unreachable.
  virtual std::optional<Eigen::Matrix<double, 6, 6>> damping(const Pose& T_device_plate) const = 0;
  /// The fraction of the wrench that the device can render at this pose: 1 if it can render the
  /// whole wrench, 0 if the pose is unreachable.
  virtual double renderable_fraction(const Pose& T_device_plate,
                                     const Wrench& wrench_device) const = 0;
  /// Returns, as text for `check`, the motor torque or the force that the device needs to render
  /// this wrench at this pose. `what` names the wrench in this text.
  virtual std::string describe_demand(std::string_view what, const Pose& T_device_plate,
                                      const Wrench& wrench_device) const = 0;

  /// The margins of this pose from the limits that HandDevice::find_pose() and
  /// HandDevice::check_own_workspace() check.
  virtual DeviceMargins margins(const Pose& /*T_device_plate*/) const noexcept { return {}; }
  /// Describes, as text for `check`, the smallest margins over several reachable poses. The text
  /// is empty if the device itself limits neither joints nor the inverse condition.
  virtual std::string describe_margins(const DeviceMargins& /*smallest*/) const { return {}; }
  /// Describes how the pose exceeds the limit that belongs to `fault`: the value at the pose,
  /// and the limit. `fault` is one that margins() can return, or kWorkspace if
  /// DeviceMargins::box_m is negative. The text is empty if the pose is within the limit.
  virtual std::string describe_fault(Fault /*fault*/, const Pose& /*T_device_plate*/) const {
    return {};
  }
  /// Computes the pose from the measurements in a row of a recording, even if the device's checks
  /// reject this pose. Nullopt if the measurements give no pose.
  virtual std::optional<Pose> pose_of(const RecordingRow& row) const = 0;
};

/// The time since the reading that keep_reading() kept last. find_pose() uses this time to detect
/// jumps: the longer the time, the larger is the allowed difference between the present reading and
/// the kept one.
struct ReadingInterval {
  bool has_last = false;  ///< true if a reading was kept
  /// Time since the kept reading. The loop limits this value, so that jumps are detected even after
  /// a long pause.
  double step_s = 0;
};

struct PlatePose {
  Pose T_device_plate;
  double residual_m = 0;  ///< disagreement of redundant sensors; 0 without redundant sensors
};

/// Selects the device's own forces that render() cancels, so that the hand does not feel them.
struct CompensationOptions {
  bool friction = false;
  bool gravity = false;  ///< the plate's weight, with the gravity of the device's description
  /// Fraction of the friction that is compensated. Keep the fraction below 1, because an
  /// overcompensated device moves by itself.
  double friction_fraction = 0.8;
  /// Below this joint rate, the compensation of Coulomb friction is proportional to the joint rate,
  /// so that it does not jump when the motion reverses.
  double still_rad_per_s = 0.05;
};

struct RenderInput {
  Wrench wanted = Wrench::Zero();      ///< wanted wrench on the plate about its origin, in {B}
  Twist twist_device = Twist::Zero();  ///< the plate's smoothed twist, to compensate friction
  double dt_s = 0;                     ///< period of the loop
  CompensationOptions compensation;
  /// The compensation is multiplied by a factor that begins at 0 and rises by authority_rise in
  /// each tick, up to 1.
  double authority_rise = 0;
};

/// Values of a tick that are displayed but not recorded.
struct DeviceReadout {
  /// Largest absolute value that each value of the command can have now; 0 if not known.
  std::array<double, kMaxCommanded> command_limit{};
  /// Smallest distance of a measured value from its limit, in the unit of the value. Negative if a
  /// value exceeds its limit.
  double margin = 0;
};

class HandDevice : public DeviceConnection {
 public:
  virtual const DeviceSpecification& specification() const noexcept = 0;

  // The haptic thread calls these functions.

  /// Reads the device's newest state. If the result is kOk, sets `t_s` to the state's time on the
  /// device's clock; otherwise `t_s` is unchanged. Within a connection, newer states have later
  /// times.
  virtual DeviceStatus read(double& t_s) noexcept = 0;
  /// Replaces this tick's reading by the reading that keep_reading() kept last. The caller does
  /// this if read() gave no new reading.
  virtual void use_last_reading() noexcept = 0;
  /// Checks this tick's reading against the device's limits and computes the pose. Returns the
  /// first fault found, or kNone. `pose` changes only if there is no fault.
  virtual FaultDetail find_pose(const ReadingInterval& interval, PlatePose& pose) noexcept = 0;
  /// This tick's reading, from which velocities are computed.
  virtual const Measurement& measured() const noexcept = 0;
  /// Keeps this tick's reading for use_last_reading() and for the next find_pose(). If this tick's
  /// reading is not finite, returns false, and the older reading stays the kept one.
  virtual bool keep_reading() noexcept = 0;
  /// Checks this tick's reading against the workspace that the device itself states. The caller
  /// does this after find_pose() has found no fault. Returns kWorkspace or none.
  virtual FaultDetail check_own_workspace() const noexcept { return {}; }
  /// Tells the device for how long the last command was held. A device can compute from this time
  /// how hot its motors are, for example. Returns kMotorOverload if the motors are too hot.
  virtual FaultDetail account_held_time(double /*held_s*/) noexcept { return {}; }
  /// Called during a recovery if kMotorOverload was raised since the last `running`. Returns
  /// kMotorOverload until the motors have cooled enough to continue.
  virtual FaultDetail check_rested() const noexcept { return {}; }
  /// Prepares the command that renders the wanted wrench. Sets `scale` to the fraction of the
  /// wrench that the device can render. If a fault is returned, no command is prepared, and the
  /// caller must call stop() and fade().
  virtual FaultDetail render(const RenderInput& input, double& scale) noexcept = 0;
  /// Stores the last command that write() sent or tried to send, so that fade() can start from this
  /// command. Sends nothing.
  virtual void stop() noexcept = 0;
  /// Prepares the command that stop() stored, multiplied by the factor `share`, 0 to 1. Resets the
  /// factor on the compensation to 0 (RenderInput::authority_rise).
  virtual void fade(double share) noexcept = 0;
  /// Sends the prepared command, which the device holds until the next write(). Never returns
  /// kEndOfData, because only read() reports the end of a replay.
  virtual DeviceStatus write() noexcept = 0;
  /// Sends a command of zero force. The caller does this outside of a session's ticks: while the
  /// session is paused, at its end, and when it only tries the device (device_trial.h).
  virtual void write_zero() noexcept = 0;
  /// The wrench that the last command renders to the hand, without the part of the command that
  /// compensates the device's own forces.
  virtual Wrench delivered() const noexcept = 0;
  /// Returns the fault of a status that read() or write() has just returned, with what the device
  /// says about it. Precondition: the status is kLinkLost, kEmergencyStop or kMotorFault.
  virtual FaultDetail fault_of(DeviceStatus status) const noexcept {
    if (status == DeviceStatus::kEmergencyStop) return Fault::kEmergencyStop;
    if (status == DeviceStatus::kLinkLost)
      if (const FaultDetail refused = refused_contents(); refused != Fault::kNone) return refused;
    return status == DeviceStatus::kMotorFault ? Fault::kMotorFault : Fault::kLinkLost;
  }
  /// Fills the device's columns of the recording in `row`, and the values for the display.
  virtual void describe(RecordingRow& row, DeviceReadout& readout) const noexcept = 0;
};

}  // namespace trocar::runtime
