// SPDX-License-Identifier: Apache-2.0
// The operator's X-ray commands, which come from other processes. A shot is one picture. Screening
// is X-ray that stays on while a key is held. The process in which the key is held confirms the
// screening again and again, so that X-ray ends by itself if that process dies.
// Tests: tests/runtime/session/xray_commands_test.cpp
#pragma once

#include <algorithm>
#include <cstdint>

#include "formats/session/recording.h"
#include "runtime/telemetry/session_publisher.h"

namespace trocar::runtime {

/// Only the haptic thread uses this class. It does not allocate.
class XrayCommands {
 public:
  /// Screening ends if no process has confirmed it for this long.
  static constexpr std::int64_t kHeld_ns = 1'000'000'000;
  /// Largest number of shots that wait for a tick. Each tick takes one shot. Shots beyond this
  /// number are dropped.
  static constexpr std::uint64_t kMaxWaiting = 16;

  /// Applies the commands given since the last call. Called once per tick period, also while the
  /// session is paused and makes no ticks. During a pause all shots are dropped, also those that
  /// were waiting. `now_ns`: CLOCK_MONOTONIC.
  void apply(const TelemetryCommands& given, bool is_paused, std::int64_t now_ns) noexcept {
    waiting_ =
        is_paused ? 0 : std::min(waiting_ + std::min(given.xray_shots, kMaxWaiting), kMaxWaiting);
    if (given.screening != word_) {
      word_ = given.screening;
      confirmed_ns_ = now_ns;
    }
    is_held_ = (word_ & 1) != 0 && now_ns - confirmed_ns_ < kHeld_ns;
  }

  /// Returns RecordingRow::xray for the tick that follows this call of apply(), and takes one
  /// waiting shot. Call it once for each tick.
  std::uint8_t take() noexcept {
    const bool has_shot = waiting_ > 0;
    if (has_shot) --waiting_;
    return static_cast<std::uint8_t>((has_shot ? kXrayPicture : 0) | (is_held_ ? kXrayBeam : 0));
  }

 private:
  std::uint64_t word_ = 0, waiting_ = 0;
  std::int64_t confirmed_ns_ = 0;
  bool is_held_ = false;
};

}  // namespace trocar::runtime
