// SPDX-License-Identifier: Apache-2.0
#include "runtime/telemetry/recorder.h"

#include <array>
#include <span>
#include <string>
#include <utility>

namespace trocar::runtime {

Recorder::Recorder(RecordingWriter writer, std::function<void(const Error&)> failed)
    : TickObserver(std::chrono::milliseconds(20)),
      writer_(std::move(writer)),
      failed_(std::move(failed)) {}

void Recorder::serve() {
  std::array<RecordingRow, 64> batch;
  std::size_t count = 0;
  const auto write = [&] {
    // After a failure rows are taken from the queue and discarded, so that the queue does
    // not fill up.
    if (!error_) {
      if (Result<void> done = writer_.append(std::span(batch.data(), count)); !done) {
        error_ = done.error();
        if (failed_) failed_(*error_);
      }
    }
    count = 0;
  };
  while (rows_.pop(batch[count])) {
    if (++count == batch.size()) write();
  }
  if (count > 0) write();
}

Result<void> Recorder::finish() {
  stop();
  if (error_) return *error_;
  if (const std::uint64_t lost = lost_.load(); lost > 0) {
    return unwritable("recording: " + std::to_string(lost) +
                      " rows were lost: the disk is too slow; the others are in " +
                      writer_.partial_file().string());
  }
  return writer_.commit();
}

}  // namespace trocar::runtime
