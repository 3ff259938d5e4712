// SPDX-License-Identifier: Apache-2.0
// The interface between the haptic loop and a device that a hand holds: a pose comes in, a wrench goes out. The
// loop, its safety, the force laws and the checks of a scene use only this interface. runtime/mechanism/four_legs.h implements
// it for the four-legged device of the paper, over encoders and motors (device.h).
//
// A session calls start() once, and close() at its end. In every tick the loop calls the functions
// that the tick needs, in this order. It reads the device and finds the pose, passes on for how
// long the last command was held (account_held_time()), renders a wrench or fades the last command, writes the
// command, describes the tick and advances the device. Functions of the haptic thread do not
// allocate, lock, throw or block.
//
// Contract:
//  1. The result of a tick depends only on the construction arguments, on the readings, and on the sequence of calls, so that a
//     replay of the readings gives the same bits.
//  2. Whatever wrench is wanted, the command that write() sends is finite and within the device's limits.
//  3. delivered() is the wrench that the last command renders to the hand. The energy account uses this wrench, not the wrench
//     that was wanted.
// Tests: tests/runtime/mechanism/four_legs_test.cpp, tests/runtime/control/loop_test.cpp
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/device_status.h"
#include "formats/session/fault_words.h"
#include "formats/session/recording.h"
#include "runtime/device/link_report.h"
#include "runtime/device/pose.h"

namespace trocar::runtime {

/// The largest number of measured values in a tick, and the largest number of values in a command.
inline constexpr int kMaxMeasured = 16, kMaxCommanded = 8;

/// Values measured at one time, in the device's own coordinates, such as encoder angles.
struct Measurement {
  double t_s = 0;  ///< time of the measurement, on the device's clock
  int count = 0;   ///< number of values
  std::array<double, kMaxMeasured> value{};
};

/// How far a pose is from the limits of the device's own checks. A device without joints does not set the members about joints.
struct DeviceMargins {
  Fault fault = Fault::kNone;  ///< the fault that these checks raise at this pose, or none
  /// True if the device can be at this pose. If false, the following members are not known.
  bool is_reachable = true;
  /// Smallest distance of a joint from its limit; negative if a joint is beyond its limit.
  double joint_rad = std::numeric_limits<double>::infinity();
  int joint = -1;                ///< the joint with this distance: its index in Measurement::value
  double inverse_condition = 1;  ///< that of the Jacobian: at most 1, and 0 at a singularity
};

/// A box of positions of the plate's origin in {B}.
struct WorkspaceBox {
  std::array<double, 3> min_m{}, max_m{};
};

/// Limits of the motors and joints, for programs that display a session. Members that the device
/// does not know are empty.
struct MotorsAndJoints {
  std::optional<double> motor_peak_torque_Nm, motor_continuous_torque_Nm;
  std::vector<std::array<double, 2>> joint_limits_rad;  ///< smallest and largest angle
};

/// Facts about a device that do not change during a session. The force laws, the checks of a scene, the live hand and the telemetry
/// use them without access to the device itself. The haptic thread may call the functions that are noexcept.
class DeviceSpecification {
 public:
  virtual ~DeviceSpecification() = default;

  /// Name of the device, for display.
  virtual std::string_view name() const noexcept = 0;
  /// Text for `--check`: the largest force or torque, such as "6 Nm peak a motor".
  virtual std::string describe_strength() const = 0;
  /// False if the device measures only its position. The plate's orientation is then always that
  /// of the start.
  virtual bool senses_rotation() const noexcept = 0;
  /// False if the device renders only forces. A wanted moment is then dropped.
  virtual bool renders_moment() const noexcept = 0;
  virtual int buttons() const noexcept { return 0; }
  /// Workspace that the maker states. None: only the safety limits and the device's own checks bound the workspace.
  virtual std::optional<WorkspaceBox> workspace() const noexcept { return std::nullopt; }
  virtual MotorsAndJoints motors_and_joints() const { return {}; }

  /// Mass that the hand feels at the plate, in kg, and moments of inertia about the plate's axes, in kg m^2.
  virtual double mass_kg() const noexcept = 0;
  virtual std::array<double, 3> inertia_kg_m2() const noexcept = 0;
  /// Largest stiffness at the tip that the maker states, in N/m; 0: none is stated.
  virtual double stiffness_max_N_per_m() const noexcept = 0;
  /// Resolution of every measured value, in the unit of that value; 0: the values are exact.
  virtual double resolution() const noexcept = 0;
  /// Damping that the device's own friction gives the plate at a pose: the matrix from the twist [v; omega] to the wrench that
  /// opposes it, in SI units. None: the device cannot be at this pose.
  virtual std::optional<Eigen::Matrix<double, 6, 6>> damping(const Pose& T_device_plate) const = 0;
  /// The largest factor, at most 1, such that the device can render the factor times this wrench at
  /// this pose; 0: the device cannot be at this pose.
  virtual double renderable_fraction(const Pose& T_device_plate,
                                     const Wrench& wrench_device) const = 0;
  /// Text for `--check`: what rendering a wrench at a pose demands of the device. `what` names the wrench.
  virtual std::string describe_demand(std::string_view what, const Pose& T_device_plate,
                                      const Wrench& wrench_device) const = 0;

  /// The margins of this pose from the limits that find_pose() checks.
  virtual DeviceMargins margins(const Pose& /*T_device_plate*/) const noexcept { return {}; }
  /// Text for `--check`: the smallest margins over several reachable poses. Empty: the device has no such limits.
  virtual std::string describe_margins(const DeviceMargins& /*smallest*/) const { return {}; }
  /// Text that says by how much a pose exceeds the limit that belongs to `fault`, with value and
  /// limit. `fault` is one that margins() can return. Empty: the pose does not exceed this limit.
  virtual std::string describe_fault(Fault /*fault*/, const Pose& /*T_device_plate*/) const {
    return {};
  }
  /// The pose computed from the device's measurements in a tick, even if the device's checks reject it. None: the pose
  /// cannot be computed.
  virtual std::optional<Pose> pose_of(const RecordingRow& row) const = 0;
};

/// The time since the last reading. The device uses this time to decide whether a reading differs
/// too much from the last one.
struct ReadingInterval {
  bool has_last = false;  ///< an earlier reading was kept
  double step_s = 0;      ///< time since that reading in which the device may have moved
};

struct PlatePose {
  Pose T_device_plate;
  double residual_m = 0;  ///< disagreement of redundant sensors; 0 if there are none
};

/// The device's own forces that render() cancels, so that the hand does not feel them.
struct CompensationOptions {
  bool friction = false;
  bool gravity = false;  ///< compensate the plate's weight, by the gravity of the description
  /// Compensated fraction of the friction; keep it below 1, because an overcompensated device would
  /// move by itself.
  double friction_fraction = 0.8;
  /// Below this rate of a joint, the compensation of Coulomb friction is proportional to the rate.
  double still_rad_per_s = 0.05;
};

struct RenderInput {
  Wrench wanted = Wrench::Zero();      ///< wanted wrench on the plate about its origin, in {B}
  Twist twist_device = Twist::Zero();  ///< the plate's smoothed twist
  double dt_s = 0;                     ///< period of the loop
  CompensationOptions compensation;
  /// Rise of the factor on the compensation in each tick, until the factor is 1.
  double authority_rise = 0;
};

/// Values of a tick for the display, which are not recorded.
struct DeviceReadout {
  std::array<double, kMaxCommanded> command_limit{};  ///< the largest values that are possible now
  double margin = 0;  ///< smallest distance of a measured value from its limit; negative beyond it
};

class HandDevice {
 public:
  virtual ~HandDevice() = default;

  virtual const DeviceSpecification& specification() const noexcept = 0;

  /// Connects to the device. From then on the device may require a command in each period. May
  /// block. The caller calls it once.
  virtual Result<void> start() { return {}; }

  // The haptic thread calls these functions.

  /// Reads the newest state. Sets `t_s` to the state's time on the device's clock; these times
  /// ascend. `t_s` changes only on kOk.
  virtual DeviceStatus read(double& t_s) noexcept = 0;
  /// Takes the last kept reading as the reading of this tick. Called if this tick's reading is
  /// absent or not new.
  virtual void use_last_reading() noexcept = 0;
  /// Checks the reading and the device itself, and computes the pose. `pose` changes only if there is no fault.
  virtual FaultDetail find_pose(const ReadingInterval& interval, PlatePose& pose) noexcept = 0;
  /// This tick's reading, from which velocities are computed.
  virtual const Measurement& measured() const noexcept = 0;
  /// Keeps this tick's reading as the last one. If this tick's reading is not finite, returns
  /// false, and the older reading stays the last one.
  virtual bool keep_reading() noexcept = 0;
  /// Tells the device for how long the last command was held. The device can compute from this, for example, the temperature of its
  /// motors, and returns a fault if they are too hot.
  virtual FaultDetail account_held_time(double /*held_s*/) noexcept { return {}; }
  /// After account_held_time() has returned a fault, returns this fault until the device has recovered
  /// enough to continue.
  virtual FaultDetail check_rested() const noexcept { return {}; }
  /// Prepares the command that renders the wanted wrench. Sets `scale` to the fraction of the
  /// wrench that the device can render. If a fault is returned, no command is prepared, and the
  /// caller must call stop() and fade().
  virtual FaultDetail render(const RenderInput& input, double& scale) noexcept = 0;
  /// Stores the last command that write() sent or tried to send, as the start for
  /// fade(). Sends nothing.
  virtual void stop() noexcept = 0;
  /// Prepares the command that stop() stored, multiplied by `share`. Compensation then rises from
  /// zero in the next calls of render().
  virtual void fade(double share) noexcept = 0;
  /// Sends the prepared command. The device holds it until the next write().
  /// Never returns kEndOfData.
  virtual DeviceStatus write() noexcept = 0;
  /// Sends a command without force. Used outside of ticks.
  virtual void write_zero() noexcept = 0;
  /// The wrench that the last command renders to the hand, without compensation of the device's own forces.
  virtual Wrench delivered() const noexcept = 0;
  /// After a read() that returned kMotorFault, bit i is set if motor i does not apply its torque.
  /// The value 0 means that the faulty motors are not known.
  virtual std::uint8_t motor_faults() const noexcept { return 0; }
  /// After a read() that returned kLinkLost or kMotorFault, requests a new connection. Returns
  /// immediately; read() returns kLinkLost until the connection is established.
  virtual void restore() noexcept {}
  /// Fills the device's columns of the recording, and the values for the display.
  virtual void describe(RecordingRow& row, DeviceReadout& readout) const noexcept = 0;
  /// Ends a tick of length `dt_s`. A device that is paced by the loop advances its time by `dt_s`. May block only if
  /// is_paced_by_loop() is true.
  virtual void advance(double /*dt_s*/) {}

  /// Ends the connection to the device.
  virtual void close() {}

  /// True if the device's time advances only in advance(), so that a late tick does no harm.
  virtual bool is_paced_by_loop() const { return false; }
  /// Returns the counts of the link. Call this only after close(). A device without a
  /// link returns nullopt.
  virtual std::optional<LinkReport> link_report() const { return std::nullopt; }
};

}  // namespace trocar::runtime
