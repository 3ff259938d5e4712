// SPDX-License-Identifier: Apache-2.0
// Attributes each missed deadline of a tick to the part of the period that made the tick late.
// Tests: tests/runtime/realtime/late_ticks_test.cpp
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "runtime/realtime/realtime_thread.h"

namespace trocar::runtime {

/// The parts of a period: the thread wakes up, the device is read and written, the force is computed, and the
/// tick is published to its observers.
enum class TickPart : std::uint8_t { kWaking, kDevice, kLaw, kPublishing };
inline constexpr std::size_t kTickParts = 4;
inline constexpr std::array<const char*, kTickParts> kTickPartNames = {"waking", "device", "law",
                                                                       "publishing"};

/// The haptic thread calls these functions: no allocation, no exception.
class LateTicks {
 public:
  using Counts = std::array<std::uint64_t, kTickParts>;

  /// Call this when a tick begins. A deadline that passed between the requested and the actual
  /// wake-up of the thread counts as late waking. All other deadlines that were missed since the
  /// last call passed during the previous tick. They count for that part of the previous tick which
  /// took the longest time.
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
  /// Adds the time that a part of this tick took.
  void spend(TickPart part, std::int64_t duration_ns) noexcept {
    spent_ns_[static_cast<std::size_t>(part)] += duration_ns;
  }
  /// Number of missed deadlines for each part. The sum of these numbers is
  /// TickTiming::missed_deadlines of the last begin(), which includes the deadlines missed by the
  /// late waking of that tick.
  const Counts& counts() const noexcept { return counts_; }

 private:
  Counts counts_{};
  std::array<std::int64_t, kTickParts> spent_ns_{};
  std::uint64_t missed_ = 0;
};

}  // namespace trocar::runtime
