// SPDX-License-Identifier: Apache-2.0
// Counts missed deadlines by their cause, that is, by the part of a tick that took too long.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "runtime/realtime/realtime_thread.h"

namespace trocar::runtime {

/// The parts of a tick: the thread wakes up, the device is read and written, the force law computes
/// the force, and the tick is published to its observers.
enum class TickPart : std::uint8_t { kWaking, kDevice, kLaw, kPublishing };
inline constexpr std::size_t kTickParts = 4;
inline constexpr std::array<const char*, kTickParts> kTickPartNames = {"waking", "device", "law",
                                                                       "publishing"};

/// The haptic thread calls these functions. They neither allocate nor throw.
class LateTicks {
 public:
  using Counts = std::array<std::uint64_t, kTickParts>;

  /// Call this when a tick begins. Deadlines that passed between the requested and the actual
  /// wake-up of the thread count for kWaking. All other deadlines missed since the last call of
  /// begin() passed during the previous tick. They count for the part on which the previous tick
  /// spent the longest time, according to the calls of spend().
  void begin(const TickTiming& timing, double period_ns) noexcept {
    const std::uint64_t missed = timing.missed_deadlines - missed_;
    missed_ = timing.missed_deadlines;
    const auto asleep =
        static_cast<std::uint64_t>(std::max(0.0, static_cast<double>(timing.late_ns) / period_ns));
    const std::uint64_t by_waking = std::min(missed, asleep);
    counts_[static_cast<std::size_t>(TickPart::kWaking)] += by_waking;
    const auto longest = std::max_element(spent_ns_.begin() + 1, spent_ns_.end());
    counts_[static_cast<std::size_t>(longest - spent_ns_.begin())] += missed - by_waking;
    spent_ns_.fill(0);
  }
  /// Call this after a part of the tick. Adds to the time that the tick has spent on this part.
  void spend(TickPart part, std::int64_t duration_ns) noexcept {
    spent_ns_[static_cast<std::size_t>(part)] += duration_ns;
  }
  /// Number of missed deadlines for each part. The numbers add up to the `missed_deadlines` that
  /// the last call of begin() received.
  const Counts& counts() const noexcept { return counts_; }

 private:
  Counts counts_{};
  std::array<std::int64_t, kTickParts> spent_ns_{};
  std::uint64_t missed_ = 0;
};

}  // namespace trocar::runtime
