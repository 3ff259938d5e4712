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
  /// Number of states that the device sent after the first torques but that were lost, or arrived
  /// after a newer one.
  std::uint64_t states_missed = 0;
};

/// Counts of the link to a device, over all sessions with this device.
struct LinkReport {
  std::uint64_t sessions = 0;
  std::optional<LinkPackets> packets;  ///< none through a maker's SDK or service
  /// Time from a command to the first state that acknowledges it, or that was measured after the device took
  /// the command. Only measured with the real clock.
  Histogram round_trip;
  std::optional<Error> restore_error;  ///< failure of the last attempt to restore the session
};

}  // namespace trocar::runtime
