// SPDX-License-Identifier: Apache-2.0
// Every tick of a session with what was punctured in it, handed from the haptic thread to another.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <thread>
#include <utility>

#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/realtime/spsc_queue.h"

namespace trocar::runtime {

/// A row, and a bit for each sheet (the topmost is bit 0) or layer.
struct SeenTick {
  RecordingRow row;
  std::uint64_t punctured = 0;         ///< sheets that were punctured, or that the front has passed
  std::uint64_t side_cut = 0;          ///< sheets whose wall has yielded (force law `cutting`)
  std::uint64_t layers_punctured = 0;  ///< soft layers
};
static_assert(kMaxSceneSlices <= 64 && kMaxLayers <= 64, "a bit for each");

/// Calls `see` with every tick in order, on a thread of its own.
class TickFeed {
 public:
  static constexpr std::size_t kCapacity = 8192;  ///< ticks: one second at the highest rate

  explicit TickFeed(std::function<void(const SeenTick&)> see) : see_(std::move(see)) {}
  ~TickFeed() { static_cast<void>(finish()); }
  TickFeed(const TickFeed&) = delete;
  TickFeed& operator=(const TickFeed&) = delete;

  /// Haptic thread. If the queue is full the tick is lost.
  void push(const SeenTick& tick) noexcept {
    if (!ticks_.push(tick)) lost_.fetch_add(1, std::memory_order_relaxed);
  }

  void start() {
    thread_ = std::thread([this] {
      constexpr std::chrono::milliseconds kInterval{20};
      for (;;) {
        const bool last = stopping_.load(std::memory_order_acquire);
        drain();
        if (last) return;
        std::this_thread::sleep_for(kInterval);
      }
    });
  }
  /// After the last push. Returns the number of ticks that were lost.
  std::uint64_t finish() {
    if (thread_.joinable()) {
      stopping_.store(true, std::memory_order_release);
      thread_.join();
    }
    return lost_.load();
  }

 private:
  void drain() {
    SeenTick tick;
    while (ticks_.pop(tick))
      see_(tick);
  }

  SpscQueue<SeenTick, kCapacity> ticks_;
  std::atomic<std::uint64_t> lost_{0};
  std::atomic<bool> stopping_{false};
  std::thread thread_;
  std::function<void(const SeenTick&)> see_;
};

}  // namespace trocar::runtime
