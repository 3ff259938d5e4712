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
  /// Takes the latest message, which may be one that was taken before. Called once in each tick
  /// and, while the session is paused, once in each period. `now_ns`: CLOCK_MONOTONIC. Returns
  /// kHand, kHandLetGo or kHandLost if the message changes who holds the tool, and none otherwise.
  virtual std::optional<TelemetryEventKind> receive(const TelemetryHand& latest,
                                                    std::int64_t now_ns) noexcept = 0;
  /// Called after a pause. Makes the hand's target, to which its springs pull the tip, start at the
  /// tip in the next tick.
  virtual void restart_at_tip() noexcept = 0;
};

}  // namespace trocar::runtime
