// SPDX-License-Identifier: Apache-2.0
// The status that a haptic device returns for a read or a write. It is recorded in each tick.
#pragma once

#include <cstdint>

namespace trocar {

/// The comments give each status's name in recordings, in quotes.
enum class DeviceStatus : std::uint8_t {
  kOk,             ///< "ok"
  kNoData,         ///< "no_data": a read gave no new state, or a write was not accepted
  kLinkLost,       ///< "link_lost"
  kEmergencyStop,  ///< "emergency_stop": the stop is pressed; the drives hold the torques at zero
  kMotorFault,     ///< "motor_fault": the drives report a motor that does not give its torque
  kEndOfData,      ///< the end of a replayed recording; never recorded
};
inline constexpr int kRecordedDeviceStatuses = 5;  ///< all except kEndOfData

}  // namespace trocar
