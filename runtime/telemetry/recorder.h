// SPDX-License-Identifier: Apache-2.0
// Writes the row of every tick to a recording, and watches the space on its disk. In real time a
// separate thread writes the rows. If the rows cannot be written, the session is to end, because
// what it did could not be shown. The rows until its end still fit on a full disk, because the
// recorder holds space for them (disk_reserve.h).
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <limits>
#include <memory>
#include <optional>

#include "formats/base/result.h"
#include "formats/session/recording.h"
#include "runtime/realtime/spsc_queue.h"
#include "runtime/telemetry/disk_reserve.h"
#include "runtime/telemetry/tick_observer.h"

namespace trocar::runtime {

class Recorder final : public TickObserver {
 public:
  static constexpr std::size_t kCapacity = 8192;  ///< queue capacity in rows: one second at 8 kHz
  static constexpr double kLowSpace_s = 600;

  /// Opens the recording. `rate_Hz`: rate of the ticks. `low_space` is called at most once, on the
  /// thread that writes the rows, if only `left_s` < kLowSpace_s of recording fit on the disk.
  /// Errors: those of RecordingWriter::open() and DiskReserve::hold().
  static Result<std::unique_ptr<Recorder>> make(const std::filesystem::path& file,
                                                const RecordingOrigin& origin, double rate_Hz,
                                                std::function<void(double left_s)> low_space = {});
  ~Recorder() override { stop(); }

  /// If the queue is full, this row and all later ones are lost.
  void on_tick(const TickView& tick) noexcept override {
    if (is_full_.load(std::memory_order_relaxed) || rows_.push(tick.result.row)) return;
    is_full_.store(true, std::memory_order_relaxed);
  }
  /// True if a row could not be written or is lost. Wait-free, for the haptic thread.
  bool has_failed() const noexcept {
    return has_failed_.load(std::memory_order_relaxed) || is_full_.load(std::memory_order_relaxed);
  }
  /// Time of recording that fits on the disk; infinite until it has been measured. Any thread may
  /// call this function.
  double left_s() const noexcept { return left_s_.load(std::memory_order_relaxed); }

  /// Writes the rows that are now in the queue to the file.
  void serve() override;
  /// Calls stop(), and renames the file, which has a temporary name until then. Errors: kUnwritable
  /// if has_failed() is true, or if the recording cannot be ended. The message says where the rows
  /// are: in the recording, unless they did not fit on the disk.
  Result<void> finish();

 private:
  Recorder(RecordingWriter writer, DiskReserve reserve, double rate_Hz,
           std::function<void(double left_s)> low_space);
  void write(std::span<const RecordingRow> rows);
  void fail(const Error& error);
  void measure_space();

  SpscQueue<RecordingRow, kCapacity> rows_;
  std::atomic<bool> has_failed_{false}, is_full_{false};
  std::atomic<double> left_s_{std::numeric_limits<double>::infinity()};
  std::optional<Error> error_;
  RecordingWriter writer_;
  DiskReserve reserve_;
  double rate_Hz_;
  std::function<void(double left_s)> low_space_;
  std::chrono::steady_clock::time_point measured_at_{};
  bool is_low_ = false;
};

}  // namespace trocar::runtime
