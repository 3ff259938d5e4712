// SPDX-License-Identifier: Apache-2.0
// Receives the messages of a live hand, which is a hand that a person moves while the session runs
// (TelemetryHand in formats/session/telemetry.h). The session passes the messages on to a
// HandReceiver. runtime/devices/live_hand.h implements it, and decides what the messages do.
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
  /// same message again. The session calls this once in each tick period, also during a pause.
  /// `now_ns`: the present time on CLOCK_MONOTONIC. Returns kHand if the person has now taken the
  /// tool, kHandLetGo if the person has now let go, kHandLost if no message has arrived for too
  /// long, and otherwise none.
  virtual std::optional<TelemetryEventKind> receive(const TelemetryHand& latest,
                                                    std::int64_t now_ns) noexcept = 0;
  /// Moves the hand's target, to which springs pull the tip, to the tip's present position. The
  /// session calls this after a pause.
  virtual void restart_at_tip() noexcept = 0;
};

}  // namespace trocar::runtime
