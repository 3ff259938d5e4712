// SPDX-License-Identifier: Apache-2.0
// Shows a running session in memory that other processes read, and takes their commands
// (formats/session/live_memory.md). The haptic thread writes the latest tick into a triple buffer
// and pushes events into a queue; another thread writes both to the memory. Sheets are written by
// the thread that publishes their meshes.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <type_traits>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/device_description.h"
#include "formats/session/live_memory.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/contact/tool.h"
#include "runtime/mechanism/motor.h"
#include "runtime/mesh/triangle_grid.h"
#include "runtime/realtime/spsc_queue.h"
#include "runtime/realtime/triple_buffer.h"
#include "runtime/session/responder.h"
#include "runtime/session/workers.h"

namespace trocar::runtime {

/// What the session's options do not have.
struct LiveOptions {
  std::filesystem::path file;  ///< becomes the link
  std::string scene_file, device, recovery;
  std::vector<std::string> tissue_of_sheet;  ///< names, the topmost first; empty: without a name
};

/// A tick for the snapshot; counts are those since the session began.
struct LiveTick {
  RecordingRow row;
  std::int64_t taken_ns = 0;  ///< CLOCK_MONOTONIC
  std::array<double, kMotors> motor_load_A2s{};
  std::int32_t active_sheet = -1;
  double force_N = 0;
  std::uint64_t ticks = 0, missed_deadlines = 0, punctures = 0, faults = 0;
  std::int64_t late_max_ns = 0;
  std::uint64_t sheets_touched = 0, sheets_punctured = 0;  ///< a bit for each sheet
  std::array<std::uint32_t, kMaxSceneSlices> sheet_cuts{};
  bool is_paused = false, has_ended = false;
};
static_assert(kMaxSceneSlices <= kMostLiveSheets && kMaxSceneSlices <= 64);

/// Durations in quarters of an octave from 256 ns on; what is shorter counts in the first bin, what
/// is longer than 16.8 ms in the last. Written by one thread, read by any.
class LiveHistogram {
 public:
  static constexpr std::size_t kBins = 64;

  void add(std::int64_t duration_ns) noexcept {
    std::atomic<std::uint64_t>& count = counts_[bin(duration_ns)];
    count.store(count.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  }
  std::uint64_t count(std::size_t i) const noexcept {
    return counts_[i].load(std::memory_order_relaxed);
  }
  static std::size_t bin(std::int64_t duration_ns) noexcept;
  /// Where bin i begins; the first at 0.
  static double lower_us(std::size_t i) noexcept;

 private:
  std::array<std::atomic<std::uint64_t>, kBins> counts_{};
};

class LiveView {
 public:
  /// Makes the memory and its link, with the sheets as they are first. `responder`: may be null.
  /// Unwritable: no memory, or LiveWriter::link().
  static Result<std::unique_ptr<LiveView>> make(const Scene& scene,
                                                const DeviceDescription& description,
                                                const Remesher& remesher,
                                                const Responder* responder,
                                                const struct SessionOptions& options);
  ~LiveView();
  LiveView(const LiveView&) = delete;
  LiveView& operator=(const LiveView&) = delete;

  // Haptic thread: wait-free.

  void tick(const LiveTick& tick) noexcept { ticks_.write(tick); }
  /// Readers are told of events that the full queue did not take.
  void event(const LiveEvent& event) noexcept {
    if (!events_.push(event)) lost_.fetch_add(1, std::memory_order_relaxed);
  }
  void count_tick(std::int64_t duration_ns) noexcept { tick_times_.add(duration_ns); }
  void count_wake(std::int64_t late_ns) noexcept { wake_times_.add(late_ns); }
  /// Whether the command was given since the last call for it.
  bool takes(LiveCommand command) noexcept {
    const std::uint64_t count = writer_->commands(command);
    return count != std::exchange(seen_[static_cast<std::size_t>(command)], count);
  }

  // The thread that publishes meshes.

  /// Writes the sheets whose published version has changed.
  void show_sheets(const Remesher& remesher);

  // One other thread: the one that start() creates, or the caller's.

  void start();
  void serve();
  /// Ends the thread, if any, and writes what waits.
  void stop();

 private:
  struct FirstSheet {
    SheetMesh mesh;
    TriangleGrid grid;
    std::shared_ptr<const std::vector<float>> hu;  ///< null: none
  };

  LiveView() = default;
  void show_sheet(std::size_t index, const Sheet& sheet);
  float hu_at(const FirstSheet& first, LatticePoint point) const;
  void show_shape();
  void write(const LiveTick& tick);

  SpscQueue<LiveEvent, 1024> events_;  // first, as they are aligned to a cache line
  SpscQueue<LiveEvent, 1024> shown_;   ///< from the thread that publishes
  TripleBuffer<LiveTick> ticks_;
  LiveHistogram tick_times_, wake_times_;
  std::atomic<std::uint64_t> lost_{0};
  std::array<std::uint64_t, kLiveCommands> seen_{};
  std::unique_ptr<LiveWriter> writer_;
  const Responder* responder_ = nullptr;
  DeviceDescription description_;
  MotorModel motor_;
  Tool tool_;
  std::vector<FirstSheet> first_;
  std::vector<std::int32_t> slices_;
  std::vector<std::int64_t> shown_cuts_;  ///< -1: not yet
  std::atomic<double> last_t_s_{0};
  std::shared_ptr<const SheetShape> shape_;
  std::uint64_t shapes_ = 0;
  std::vector<double> values_;
  std::thread thread_;
  std::atomic<bool> stopping_{false};
};

}  // namespace trocar::runtime
