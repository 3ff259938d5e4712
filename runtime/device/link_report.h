// SPDX-License-Identifier: Apache-2.0
// What a session counts on the link to its device.
// Tests: tests/runtime/link/udp_device_test.cpp, tests/e2e/device_trial_test.py
#pragma once

#include <cstdint>
#include <optional>

#include "formats/base/result.h"
#include "formats/session/device_protocol.h"
#include "runtime/realtime/histogram.h"

namespace trocar::runtime {

/// Counts of the device link's packets.
struct LinkPackets {
  LinkCounts counts;
  /// Number of states that the device sent after the first torques, and that were lost or arrived
  /// after a newer state.
  std::uint64_t states_missed = 0;
};

/// Counts of the link to a device, over all connections that were established during the session.
struct LinkReport {
  std::uint64_t sessions = 0;          ///< number of connections that were established
  std::optional<LinkPackets> packets;  ///< none for a maker's SDK or service
  /// Time from a command to the first state that acknowledges this command. A maker's SDK or
  /// service does not acknowledge commands. Then the time ends at the first pose that was measured
  /// after the device took the command. Measured with the real clock only.
  Histogram round_trip;
  std::optional<Error> restore_error;  ///< failure of the last attempt to restore the connection
};

}  // namespace trocar::runtime
