// SPDX-License-Identifier: Apache-2.0
// The operator's X-ray commands, which come from other processes. A shot is one picture. Screening
// is X-ray that stays on while a key is held. The process in which the key is held repeats the
// command for screening, so that the X-ray ends by itself if that process dies.
#pragma once

#include <algorithm>
#include <cstdint>

#include "formats/session/recording.h"
#include "runtime/telemetry/session_publisher.h"

namespace trocar::runtime {

/// Only the haptic thread uses this class. It does not allocate.
class XrayCommands {
 public:
  /// Screening ends if its command has not been repeated for this long.
  static constexpr std::int64_t kHeld_ns = 1'000'000'000;
  /// Number of shots that can wait; further shots are dropped. Each tick takes one waiting shot.
  static constexpr std::uint64_t kMaxWaiting = 16;

  /// Applies the commands given since the last call. Call this once in each tick period, also in a
  /// pause, in which there are no ticks. A pause drops new and waiting shots, and ends screening
  /// until its command comes again after the pause. `now_ns`: CLOCK_MONOTONIC.
  void apply(const TelemetryCommands& given, bool is_paused, std::int64_t now_ns) noexcept {
    waiting_ =
        is_paused ? 0 : std::min(waiting_ + std::min(given.xray_shots, kMaxWaiting), kMaxWaiting);
    if (given.screening != word_) {
      word_ = given.screening;
      confirmed_ns_ = now_ns;
    }
    if (is_paused) confirmed_ns_ = now_ns - kHeld_ns;  // the key may be released in the pause
    is_held_ = (word_ & 1) != 0 && now_ns - confirmed_ns_ < kHeld_ns;
  }

  /// Takes one waiting shot, and returns RecordingRow::xray of this tick. Call this once in each
  /// tick, after apply().
  std::uint8_t take() noexcept {
    const bool has_shot = waiting_ > 0;
    if (has_shot) --waiting_;
    return static_cast<std::uint8_t>((has_shot ? kXrayPicture : 0) | (is_held_ ? kXrayBeam : 0));
  }

 private:
  // word_: last TelemetryCommands::screening, a counter that changes with each command for
  // screening and is odd while screening is requested. confirmed_ns_: time at which word_ last
  // changed; a pause sets it to kHeld_ns ago, which ends screening. waiting_: number of shots that
  // wait for a tick.
  std::uint64_t word_ = 0, waiting_ = 0;
  std::int64_t confirmed_ns_ = 0;
  bool is_held_ = false;
};

}  // namespace trocar::runtime
