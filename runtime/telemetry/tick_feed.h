// SPDX-License-Identifier: Apache-2.0
// Passes every tick, with the sheets and layers punctured in it, to a function on a thread other
// than the haptic thread.
// Tests: tests/runtime/session/session_test.cpp
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>

#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/realtime/spsc_queue.h"
#include "runtime/telemetry/tick_observer.h"

namespace trocar::runtime {

/// A row, three sets, and a force. In a set, each sheet or soft layer has one bit; bit 0 is
/// the topmost one.
struct ObservedTick {
  RecordingRow row;
  std::uint64_t punctured = 0;  ///< sheets that were punctured or that the cutting front passed
  std::uint64_t side_cut = 0;   ///< sheets with a hole whose wall yielded (force law `cutting`)
  std::uint64_t layers_punctured = 0;
  /// If something was punctured in this tick: force at the tip in the previous tick, times the
  /// scene's force scale.
  double tip_N = 0;
};
static_assert(kMaxSceneSlices <= 64 && kMaxLayers <= 64, "one bit for each");

class TickFeed final : public TickObserver {
 public:
  static constexpr std::size_t kCapacity = 8192;  ///< ticks in the queue: one second at 8 kHz

  /// serve() calls `observe` with every tick, in order.
  explicit TickFeed(std::function<void(const ObservedTick&)> observe);
  ~TickFeed() override { stop(); }

  /// If the queue is full, the tick is lost, and lost() counts it.
  void on_tick(const TickView& tick) noexcept override;
  void serve() override;
  std::uint64_t lost() const noexcept { return lost_.load(); }

 private:
  SpscQueue<ObservedTick, kCapacity> ticks_;
  std::atomic<std::uint64_t> lost_{0};
  std::function<void(const ObservedTick&)> observe_;
};

}  // namespace trocar::runtime
