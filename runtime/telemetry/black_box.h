// SPDX-License-Identifier: Apache-2.0
// The black box keeps the rows of the last seconds, and writes them to a separate recording after a
// fault. The haptic thread pushes rows into a preallocated ring and requests a file when there is a
// fault. A worker thread copies the rows and writes the file. The ring holds twice as many rows as
// a file, so the worker has kBlackBox_s to copy them. If copying takes longer, rows have been
// overwritten. In this case no file is written, and the report contains an error.
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
  std::uint64_t rows = 0;  ///< number of rows up to the tick with zero torques, at most kBlackBox_s
  std::filesystem::path file;
  std::optional<Error> error;
};

class BlackBox final : public TickObserver {
 public:
  /// Files are written to `folder`. Their names are black_box_DATE-TIME_tSECONDSs_FAULT.csv.
  /// DATE-TIME is the start of the session in UTC, SECONDS the session's time at the fault, and
  /// FAULT the name of the fault. Existing files are not replaced. `origin` is written into the
  /// first row of each file. Errors: (unwritable) the folder does not exist, or files cannot be
  /// created in it.
  static Result<std::unique_ptr<BlackBox>> make(const std::filesystem::path& folder, double rate_Hz,
                                                const RecordingOrigin& origin = {});
  ~BlackBox() override { stop(); }

  // The haptic thread calls these functions.

  void push(const RecordingRow& row) noexcept { ring_.push(row); }
  /// Requests a file of the rows so far. Returns false if too many requests are waiting. lost()
  /// counts the requests that failed in this way.
  bool save(Fault fault, double t_s) noexcept;
  /// Pushes the row. After a fault that the operator did not command, requests a file once torques
  /// are zero, so that the file contains the whole ramp.
  void on_tick(const TickView& tick) noexcept override;

  // One other thread calls these functions: the thread that start() creates, or a thread
  // of the caller.

  /// Writes the requested files.
  void serve() override;
  /// Like TickObserver::stop(). If the session ended during the ramp after a fault, first requests
  /// a file for that fault.
  void stop() override;

  // These functions may be called after stop(), or on the thread that calls serve().

  const std::vector<BlackBoxFile>& files() const noexcept { return files_; }
  /// Number of requests lost because the queue was full.
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
