// SPDX-License-Identifier: Apache-2.0
// The black box keeps the rows of the last seconds. After a fault, it writes these rows to a new
// file. The haptic thread pushes rows into a preallocated ring buffer. When the torques have fallen
// to zero after a fault, the haptic thread requests a file. A worker thread copies the rows and
// writes the file. The ring buffer holds twice as many rows as a file, so the worker has
// kBlackBox_s to copy the rows before they are overwritten. If the worker is too late, no file is
// written, and BlackBoxFile::error is set.
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

inline constexpr double kBlackBox_s = 4;  ///< time that the rows of a file cover

/// The outcome of one request for a file.
struct BlackBoxFile {
  Fault fault = Fault::kNone;
  double t_s = 0;          ///< time of the fault
  std::uint64_t rows = 0;  ///< number of rows copied from the ring buffer for this file
  std::filesystem::path file;
  /// None: the file is complete. Otherwise: the reason why there is no file, and where the rows are
  /// that could be written.
  std::optional<Error> error;
};

class BlackBox final : public TickObserver {
 public:
  /// Makes a black box that writes its files to `folder`. A file's name is
  /// black_box_TIME_tSECONDSs_FAULT.csv. TIME is utc_name() of this call, SECONDS the session's time
  /// at the fault, and FAULT the name of the fault. If such a file exists, "_2"
  /// or a higher number is added to the name. `origin` is written into the first row of each file.
  /// Errors: kUnwritable if the folder does not exist, or if files cannot be created in it.
  static Result<std::unique_ptr<BlackBox>> make(const std::filesystem::path& folder, double rate_Hz,
                                                const RecordingOrigin& origin = {});
  ~BlackBox() override { stop(); }

  // The haptic thread calls these functions.

  void push(const RecordingRow& row) noexcept { ring_.push(row); }
  /// Requests a file with the last rows pushed so far. If too many requests are waiting, the
  /// request is lost: the function returns false, and lost() counts the request.
  bool save(Fault fault, double t_s) noexcept;
  /// Pushes the row. After a fault, the torques fall to zero in a ramp. When the ramp has ended,
  /// requests a file, so that the file contains the whole ramp. No file is requested after faults for
  /// which is_failure() is false.
  void on_tick(const TickView& tick) noexcept override;

  // TickObserver says which thread calls these functions.

  /// Writes the requested files.
  void serve() override;
  /// Like TickObserver::stop(). If the session ended during the ramp after a fault, first requests
  /// a file for that fault.
  void stop() override;

  // Call these functions after stop(), or on the thread that calls serve().

  /// The outcomes of all requests so far.
  const std::vector<BlackBoxFile>& files() const noexcept { return files_; }
  /// Number of requests lost because the queue was full.
  std::uint64_t lost() const noexcept { return lost_.load(); }

 private:
  struct Request {
    Fault fault = Fault::kNone;
    double t_s = 0;
    std::uint64_t end = 0;  ///< number of rows pushed before the file was requested
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
  bool is_pending_ = false;  ///< a file will be requested when the ramp after a fault has ended
  Fault latched_ = Fault::kNone;
  double latched_t_s_ = 0;
  std::vector<BlackBoxFile> files_;
};

}  // namespace trocar::runtime
