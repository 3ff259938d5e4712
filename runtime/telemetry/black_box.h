// SPDX-License-Identifier: Apache-2.0
// The black box keeps the rows of the last seconds and writes them to a separate recording after a
// fault. The haptic thread pushes rows into a preallocated ring and, on a fault, requests a file; a
// worker thread copies the rows and writes the file. The ring holds twice as many rows as a file,
// so the worker has kBlackBox_s to copy them. If it takes longer, rows have been overwritten: the
// report then has an error, and no file is written.
// Tests: tests/runtime/telemetry/black_box_test.cpp
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/recording.h"
#include "runtime/realtime/ring_buffer.h"
#include "runtime/realtime/spsc_queue.h"
#include "runtime/telemetry/tick_observer.h"

namespace trocar::runtime {

inline constexpr double kBlackBox_s = 4;

/// One file, or the reason why it is missing or incomplete (RecordingWriter::partial_file()).
struct BlackBoxFile {
  Fault fault = Fault::kNone;
  double t_s = 0;          ///< time of the fault
  std::uint64_t rows = 0;  ///< rows up to the tick with zero torques, at most kBlackBox_s of them
  std::filesystem::path file;
  std::optional<Error> error;
};

class BlackBox final : public TickObserver {
 public:
  /// Files go into `folder`. They are named black_box_DATE-TIME_tSECONDSs_FAULT.csv after the start
  /// in UTC, the session's time and the fault's name; existing files are not replaced. `origin` goes
  /// into the first row of each file. Unwritable: the folder does not exist, or files cannot be
  /// created in it.
  static Result<std::unique_ptr<BlackBox>> make(const std::filesystem::path& folder, double rate_Hz,
                                                const RecordingOrigin& origin = {});
  ~BlackBox() override { stop(); }

  // Haptic thread.

  void push(const RecordingRow& row) noexcept { ring_.push(row); }
  /// Requests a file of the rows so far. False if too many requests wait; lost() counts them.
  bool save(Fault fault, double t_s) noexcept;
  /// Pushes the row. A fault that the operator did not command requests a file once the torques are
  /// zero, so that the file contains the whole ramp.
  void on_tick(const TickView& tick) noexcept override;

  // One other thread: the one that start() creates, or the caller's.

  /// Writes the requested files.
  void serve() override;
  /// Also requests the file of a fault whose ramp did not end before the session did.
  void stop() override;

  // After stop(), or on the thread that calls serve().

  const std::vector<BlackBoxFile>& files() const noexcept { return files_; }
  /// Requests lost because the queue was full.
  std::uint64_t lost() const noexcept { return lost_.load(); }

 private:
  struct Request {
    Fault fault = Fault::kNone;
    double t_s = 0;
    std::uint64_t end = 0;  ///< number of rows pushed so far
  };

  BlackBox(std::filesystem::path folder, std::string name, std::size_t rows_of_file,
           RecordingOrigin origin);
  void serve_one(const Request& request);
  std::filesystem::path name_of(const Request& request) const;

  std::filesystem::path folder_;
  std::string name_;
  std::size_t rows_of_file_;
  RecordingOrigin origin_;
  RingBuffer<RecordingRow> ring_;
  SpscQueue<Request, 256> requests_;
  std::atomic<std::uint64_t> lost_{0};
  bool is_pending_ = false;  ///< a fault waits for its ramp to end
  Fault latched_ = Fault::kNone;
  double latched_t_s_ = 0;
  std::vector<BlackBoxFile> files_;
};

}  // namespace trocar::runtime
