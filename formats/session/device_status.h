// SPDX-License-Identifier: Apache-2.0
// How a haptic device answers a read or a write; recorded tick by tick.
#pragma once

#include <cstdint>

namespace trocar {

/// In quotes: its name in a recording.
enum class DeviceStatus : std::uint8_t {
  kOk,             ///< "ok"
  kNoData,         ///< "no_data": read: no new state; write: the torques were not taken
  kLinkLost,       ///< "link_lost"
  kEmergencyStop,  ///< "emergency_stop": pressed; the drives hold the torques at zero
  kMotorFault,     ///< "motor_fault": the drives report a motor that does not give its torque
  kEndOfData,      ///< a replayed recording is at its end; never recorded
};
inline constexpr int kRecordedDeviceStatuses = 5;

}  // namespace trocar
