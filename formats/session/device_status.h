// SPDX-License-Identifier: Apache-2.0
// The status that a haptic device returns for a read or a write; recorded in each tick.
// Tests: tests/formats/session/recording_test.cpp
#pragma once

#include <cstdint>

namespace trocar {

/// The name in a recording is in quotes.
enum class DeviceStatus : std::uint8_t {
  kOk,             ///< "ok"
  kNoData,         ///< "no_data": read: no new state; write: the torques were not taken
  kLinkLost,       ///< "link_lost"
  kEmergencyStop,  ///< "emergency_stop": pressed; the drives hold the torques at zero
  kMotorFault,     ///< "motor_fault": the drives report a motor that does not give its torque
  kEndOfData,      ///< the end of a replayed recording; never recorded
};
inline constexpr int kRecordedDeviceStatuses = 5;

}  // namespace trocar
