// SPDX-License-Identifier: Apache-2.0
// Poses, link counts, and the interface to encoders and motors of the four-legged device.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>

#include "formats/base/result.h"
#include "formats/session/device_protocol.h"
#include "formats/session/faults.h"
#include "formats/session/recording.h"
#include "runtime/realtime/histogram.h"

namespace trocar::runtime {

// Rigid transforms, twists and wrenches of the device, in SI units. Nothing here allocates. The
// name of a pose states its frames: T_device_plate maps coordinates in the plate's frame {T} to
// coordinates in the device's frame {B}.

inline constexpr double kDegreesPerRadian = 180 / std::numbers::pi;

/// A twist [v; omega]: velocity of a frame's origin in m/s, and angular velocity in rad/s.
using Twist = Eigen::Matrix<double, 6, 1>;
/// A wrench [f; n]: force in N, and moment in N*m about a frame's origin.
using Wrench = Eigen::Matrix<double, 6, 1>;

/// A pose T_a_b of the frame {b} in the frame {a}: `p_m` is the position of the origin of {b}, and
/// `q` rotates coordinates of {b} into {a}.
struct Pose {
  Eigen::Vector3d p_m = Eigen::Vector3d::Zero();
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();  ///< unit quaternion
};

/// An earlier pose from which the present velocity is computed. The velocity is the displacement
/// from the earlier pose to the present one, divided by `ago_s`.
struct PreviousPose {
  Pose T_device_plate;
  /// Time since T_device_plate. 0 means that no pose was chosen; use the pose of the last new
  /// reading instead.
  double ago_s = 0;
};

/// Composition: T_a_c = T_a_b * T_b_c.
inline Pose operator*(const Pose& T_a_b, const Pose& T_b_c) noexcept {
  return {T_a_b.p_m + T_a_b.q * T_b_c.p_m, (T_a_b.q * T_b_c.q).normalized()};
}
inline Eigen::Vector3d operator*(const Pose& T_a_b, const Eigen::Vector3d& p_b) noexcept {
  return T_a_b.p_m + T_a_b.q * p_b;
}
inline Pose inverse(const Pose& T_a_b) noexcept {
  const Eigen::Quaterniond q_b_a = T_a_b.q.conjugate();
  return {-(q_b_a * T_a_b.p_m), q_b_a};
}
inline bool is_finite(const Pose& T) noexcept {
  return T.p_m.allFinite() && T.q.coeffs().allFinite();
}

/// Returns the shortest rotation that turns z to the direction of `d`, which is not zero. For -z it
/// is half a turn about x. (Eigen's FromTwoVectors would compile a singular value decomposition in
/// each file.)
inline Eigen::Quaterniond rotation_from_z(const Eigen::Vector3d& d) noexcept {
  const double across = std::hypot(d.x(), d.y());
  if (across == 0) return {d.z() < 0 ? 0.0 : 1.0, d.z() < 0 ? 1.0 : 0.0, 0, 0};
  const double half_rad = std::atan2(across, d.z()) / 2, sine = std::sin(half_rad);
  return {std::cos(half_rad), -d.y() / across * sine, d.x() / across * sine, 0};
}

/// Returns the rotation vector of a unit quaternion: axis times angle, with the angle in [0, pi].
inline Eigen::Vector3d rotation_vector(const Eigen::Quaterniond& q) noexcept {
  const double sign = q.w() < 0 ? -1 : 1;
  const Eigen::Vector3d v = sign * q.vec();
  const double sine = v.norm();
  const double factor = sine < 1e-12 ? 2.0 : 2 * std::atan2(sine, sign * q.w()) / sine;
  return factor * v;
}

/// Returns [translation of the frame's origin; rotation vector] of the motion from `from` to `to`,
/// in {B}. A wrench that is constant during this motion does the work wrench * displacement.
inline Twist displacement(const Pose& from, const Pose& to) noexcept {
  Twist step;
  step << to.p_m - from.p_m, rotation_vector(to.q * from.q.conjugate());
  return step;
}

/// Returns the unit quaternion of the rotation about r by the angle |r|. This function is the
/// inverse of rotation_vector().
inline Eigen::Quaterniond from_rotation_vector(const Eigen::Vector3d& r) noexcept {
  const double angle = r.norm();
  const double factor = angle < 1e-6 ? 0.5 - angle * angle / 48 : std::sin(angle / 2) / angle;
  Eigen::Quaterniond q;
  q.w() = std::cos(angle / 2);
  q.vec() = factor * r;
  return q.normalized();
}

/// Returns the pose after a motion by `step`, the inverse of displacement().
inline Pose moved(const Pose& T, const Twist& step) noexcept {
  return {T.p_m + step.head<3>(), (from_rotation_vector(step.tail<3>()) * T.q).normalized()};
}

/// Returns the same wrench with its moment taken about a new point. `lever_m` points from the new
/// point to the point about which the moment of `wrench` is taken.
inline Wrench moved_by(const Wrench& wrench, const Eigen::Vector3d& lever_m) noexcept {
  Wrench moved = wrench;
  moved.tail<3>() += lever_m.cross(Eigen::Vector3d(wrench.head<3>()));
  return moved;
}

// The counts and times that a session collects on the link to its device.

/// Counts of the packets that arrived over the device link.
struct LinkPackets {
  LinkCounts counts;  ///< packets accepted, and packets refused for each reason
  /// Number of states (packets with the device's measurements) that were lost, or that arrived
  /// after a newer state. The count begins with the first command to the device.
  std::uint64_t states_missed = 0;
};

/// Counts of the link to a device, over all connections that were established during the session.
struct LinkReport {
  std::uint64_t sessions = 0;  ///< number of connections that were established
  /// Nullopt if the device is reached through a maker's SDK or service instead of the device link.
  std::optional<LinkPackets> packets;
  /// Times from a command to the first state that acknowledges this command. A maker's SDK or
  /// service acknowledges no commands, but it returns a pose in reply to each command. The time
  /// then ends when the loop reads this pose. In lock-step, no times are measured.
  Histogram round_trip;
  std::optional<Error> restore_error;  ///< set if the last attempt to reconnect failed
};

// Interface to the encoders and motors of the four-legged device: angles come in, torques go out.
// An implementation can be a simulated device in this process, the link to a drive (the motor
// electronics), a recording that is replayed, or a test. runtime/device/four_legs/four_legs.h builds a
// HandDevice on this interface.

inline constexpr int kLegs = 4;
inline constexpr int kMotors = 2 * kLegs;    ///< order: leg by leg, joints 1 and 4 of each leg
inline constexpr int kEncoders = 4 * kLegs;  ///< order: leg by leg, joints 1 to 4 of each leg

struct DeviceState {
  /// Time at which the encoders were read, on the device's clock. It ascends from state to state.
  double t_s = 0;
  std::array<double, kEncoders> encoder_rad{};
};

struct DeviceCommand {
  std::array<double, kMotors> tau_motor_Nm{};
};

/// What every device offers besides measurements and commands.
class DeviceConnection {
 public:
  virtual ~DeviceConnection() = default;

  /// Connects to the device. May block. After a successful start() the caller must send a command
  /// in each period of the loop, because the device may have a watchdog. Precondition: start() was
  /// not called before.
  virtual Result<void> start() { return {}; }
  /// After a read() that returned kNoData or kLinkLost: if states do arrive, but are refused
  /// because of their contents, the fault kRefusedState with the field of the newest one.
  /// Otherwise no fault.
  virtual FaultDetail refused_contents() const noexcept { return {}; }
  /// After a read() that returned kLinkLost or kMotorFault, requests a new connection. Returns
  /// immediately; read() returns kLinkLost until the connection is established. The haptic thread
  /// calls this function: it does not allocate, lock, throw or block.
  virtual void restore() {}
  /// Ends a tick of length `dt_s`. If is_paced_by_loop() is true, the device advances its time by
  /// `dt_s`, and the call may block. Called on the thread of read() and write().
  virtual void advance(double /*dt_s*/) {}
  /// Commands zero force and ends the connection to the device.
  virtual void close() {}

  /// True if the device's time advances only in advance(). Such a device waits for a late tick.
  virtual bool is_paced_by_loop() const { return false; }
  /// Returns the counts of the link, or nullopt if there is no link. Call this only after close().
  virtual std::optional<LinkReport> link_report() const { return std::nullopt; }
};

/// A session calls start() once, then read(), write() and advance() in each tick, and close() at
/// its end. The haptic thread calls read() and write(), so they never allocate, lock, throw or
/// block.
class Device : public DeviceConnection {
 public:
  /// Reads the latest state. `state` changes only if the result is kOk.
  virtual DeviceStatus read(DeviceState& state) = 0;
  /// Sends the torques that the motors hold until the next write(). Never returns kEndOfData,
  /// because only read() reports the end of a replay.
  virtual DeviceStatus write(const DeviceCommand& command) = 0;
  /// After a read() that returned kMotorFault, bit i is set if motor i does not apply its torque.
  /// The value 0 means that the faulty motors are not known.
  virtual std::uint8_t fault_byte() const noexcept { return 0; }
};

// The field for which the newest state of a device was refused. One thread writes it, another reads
// it; neither waits.

class RefusedContents {
 public:
  /// Stores the fault kRefusedState with its field, or no fault if the newest state was accepted.
  void set(const FaultDetail& refused) noexcept {
    value_.store(refused.value, std::memory_order_relaxed);
    limit_.store(refused.limit, std::memory_order_relaxed);
    field_.store({refused.quantity, refused.index, refused.fault == Fault::kRefusedState},
                 std::memory_order_release);
  }
  /// The number can be that of an older refusal if both threads are here at the same time.
  FaultDetail get() const noexcept {
    const Field field = field_.load(std::memory_order_acquire);
    if (!field.is_refused) return {};
    return {Fault::kRefusedState, field.quantity, field.index,
            value_.load(std::memory_order_relaxed), limit_.load(std::memory_order_relaxed)};
  }

 private:
  struct alignas(std::uint32_t) Field {  // aligned: clang calls a library for others
    FaultQuantity quantity = FaultQuantity::kNone;
    std::int8_t index = -1;
    bool is_refused = false;
  };
  std::atomic<Field> field_{Field{}};
  std::atomic<double> value_{0}, limit_{0};
  static_assert(std::atomic<Field>::is_always_lock_free &&
                std::atomic<double>::is_always_lock_free);
};

}  // namespace trocar::runtime
