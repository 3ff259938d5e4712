// SPDX-License-Identifier: Apache-2.0
// The counts and times that a session collects on the link to its device.
#pragma once

#include <cstdint>
#include <optional>

#include "formats/base/result.h"
#include "formats/session/device_protocol.h"
#include "runtime/realtime/histogram.h"

namespace trocar::runtime {

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

}  // namespace trocar::runtime
