// SPDX-License-Identifier: Apache-2.0
// Receives the messages of a live hand, which is a hand that a person moves while the session runs
// (TelemetryHand in formats/session/telemetry.h). The session only passes the messages on;
// runtime/devices/live_hand.h decides what they do.
// Tests: tests/runtime/devices/live_hand_session_test.cpp
#pragma once

#include <cstdint>
#include <optional>

#include "formats/session/telemetry.h"

namespace trocar::runtime {

/// The haptic thread calls these functions.
class HandReceiver {
 public:
  virtual ~HandReceiver() = default;
  /// Takes the latest message. If no new message has arrived since the last call, `latest` is the
  /// same message again. The session calls this once in each tick and, while it is paused, once in
  /// each period. `now_ns`: CLOCK_MONOTONIC. Returns kHand if the person has now taken the
  /// tool, kHandLetGo if the person has now let go, kHandLost if no message has arrived for too
  /// long, and otherwise none.
  virtual std::optional<TelemetryEventKind> receive(const TelemetryHand& latest,
                                                    std::int64_t now_ns) noexcept = 0;
  /// The session calls this after a pause. After this call the target, to which the springs of the
  /// hand pull the tip, starts at the tip.
  virtual void restart_at_tip() noexcept = 0;
};

}  // namespace trocar::runtime
