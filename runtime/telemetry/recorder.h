// SPDX-License-Identifier: Apache-2.0
// Writes the row of every tick to a recording. In real time a separate thread writes the rows.
// Tests: tests/runtime/session/session_test.cpp
#pragma once

#include <atomic>
#include <functional>
#include <optional>

#include "formats/base/result.h"
#include "formats/session/recording.h"
#include "runtime/realtime/spsc_queue.h"
#include "runtime/telemetry/tick_observer.h"

namespace trocar::runtime {

class Recorder final : public TickObserver {
 public:
  static constexpr std::size_t kCapacity = 8192;  ///< queue capacity in rows: one second at 8 kHz

  /// If rows cannot be written, `failed` is called immediately and only once, on the thread that
  /// writes the rows. All later rows are discarded.
  explicit Recorder(RecordingWriter writer, std::function<void(const Error&)> failed = {});
  ~Recorder() override { stop(); }

  /// If the queue is full, the row is lost and finish() returns an error.
  void on_tick(const TickView& tick) noexcept override {
    if (!rows_.push(tick.result.row)) lost_.fetch_add(1, std::memory_order_relaxed);
  }
  /// Writes the rows that are now in the queue to the file.
  void serve() override;
  /// Calls stop(), and renames the file, which has a temporary name until then. Errors: kUnwritable
  /// if a row was lost or could not be written, or if the file cannot be renamed. After an error,
  /// the rows that were written are in RecordingWriter::partial_file().
  Result<void> finish();

 private:
  SpscQueue<RecordingRow, kCapacity> rows_;
  std::atomic<std::uint64_t> lost_{0};
  std::optional<Error> error_;
  RecordingWriter writer_;
  std::function<void(const Error&)> failed_;
};

}  // namespace trocar::runtime
