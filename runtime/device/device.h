// SPDX-License-Identifier: Apache-2.0
// The pure interface between the loop and whatever carries the motors: a model
// in the process, a drive behind UDP, a recording being replayed, a test's script.
#pragma once

#include <array>
#include <cstdint>

namespace trocar::runtime {

inline constexpr int kLegs = 4;
inline constexpr int kMotors = 2 * kLegs;    ///< leg-major: th1, th4 of leg 1, of leg 2, ...
inline constexpr int kEncoders = 4 * kLegs;  ///< leg-major: th1, th2, th3, th4 of leg 1, ...

struct DeviceState {
  double t_s = 0;
  std::array<double, kEncoders> encoder_rad{};
};

struct DeviceCommand {
  std::array<double, kMotors> tau_motor_Nm{};
};

enum class DeviceStatus : std::uint8_t {
  kOk,
  kNoData,
  kLinkLost,
  kEndOfData,
  kEmergencyStop,  ///< pressed: the drives hold the torques at zero
  kMotorFault,     ///< the drives report a motor that does not give its torque
};

/// Called from the haptic thread: no call allocates, locks, throws or blocks.
class Device {
 public:
  virtual ~Device() = default;
  /// Latest state. On anything but kOk `state` is unchanged.
  virtual DeviceStatus read(DeviceState& state) = 0;
  /// Torques to hold until the next write.
  virtual DeviceStatus write(const DeviceCommand& command) = 0;
  /// While recovering from a fault, after a read() of kLinkLost or kMotorFault: asks that the
  /// connection be made anew. Returns at once; read() says kLinkLost until it is there.
  virtual void restore() {}
};

}  // namespace trocar::runtime
