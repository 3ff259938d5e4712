// SPDX-License-Identifier: Apache-2.0
// Receives the messages of a hand that a person moves while the session runs (formats/session/telemetry.h,
// TelemetryHand). The session passes the messages on. Their effect is decided by runtime/devices/live_hand.h.
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
  /// Takes the latest message, which may be one that was taken before. Called once in each tick or paused
  /// period. `now_ns`: CLOCK_MONOTONIC. If the message changes who holds the tool, returns kHand,
  /// kHandLetGo or kHandLost.
  virtual std::optional<TelemetryEventKind> receive(const TelemetryHand& latest,
                                                    std::int64_t now_ns) noexcept = 0;
  /// Makes the target of the hand start at the tip in the next step. Called after a pause.
  virtual void restart_at_tip() noexcept = 0;
};

}  // namespace trocar::runtime
