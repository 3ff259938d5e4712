// SPDX-License-Identifier: Apache-2.0
// The counts and times that a session collects on the link to its device.
// Tests: tests/runtime/link/udp_device_test.cpp, tests/e2e/device_trial_test.py
#pragma once

#include <cstdint>
#include <optional>

#include "formats/base/result.h"
#include "formats/session/device_protocol.h"
#include "runtime/realtime/histogram.h"

namespace trocar::runtime {

/// Counts of the packets that arrived over the device link.
struct LinkPackets {
  LinkCounts counts;
  /// Number of states that were lost, or that arrived after a newer state. The count begins with
  /// the first command to the device.
  std::uint64_t states_missed = 0;
};

/// Counts of the link to a device, over all connections that were established during the session.
struct LinkReport {
  std::uint64_t sessions = 0;          ///< number of connections that were established
  std::optional<LinkPackets> packets;  ///< nullopt for a maker's SDK or service
  /// Time from a command to the first state that acknowledges this command. A maker's SDK or
  /// service does not acknowledge commands, so for these the time ends when the loop reads the pose
  /// that the SDK or service returned in reply to the command. Measured with the real clock only.
  Histogram round_trip;
  std::optional<Error> restore_error;  ///< set if the last attempt to reconnect failed
};

}  // namespace trocar::runtime
