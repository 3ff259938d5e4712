// SPDX-License-Identifier: Apache-2.0
// Passes every tick, with the sheets and layers punctured in it, to a function that may take longer
// than the haptic thread can wait. On the real clock, another thread calls this function.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>

#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/realtime/spsc_queue.h"
#include "runtime/telemetry/tick_observer.h"

namespace trocar::runtime {

/// One tick. `punctured`, `side_cut` and `layers_punctured` are sets: each bit stands for a sheet
/// or a soft layer, bit 0 for the topmost one.
struct ObservedTick {
  RecordingRow row;
  std::uint64_t punctured = 0;  ///< sheets that were punctured (law `cutting`: passed by the front)
  std::uint64_t side_cut = 0;   ///< sheets in which the tool cut a hole's wall (law `cutting`)
  std::uint64_t layers_punctured = 0;  ///< soft layers that were punctured
  /// In the tick of a puncture: RecordingRow::tip_N of the tick before. Otherwise without meaning.
  double tip_N = 0;
  BreakThroughTick break_through;
};
static_assert(kMaxSceneSlices <= 64 && kMaxLayers <= 64, "one bit for each");

class TickFeed final : public TickObserver {
 public:
  static constexpr std::size_t kCapacity = 8192;  ///< queue capacity in ticks: one second at 8 kHz

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
