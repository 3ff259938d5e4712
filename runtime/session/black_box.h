// SPDX-License-Identifier: Apache-2.0
// The black box keeps the rows of the last seconds and writes them to a recording of their own
// after a fault. The haptic thread pushes rows into a preallocated ring and, on a fault, requests a
// file; a worker thread copies the rows and writes it. The ring holds twice as many rows as a file,
// so the worker has kBlackBox_s for its copy. If it is later, rows have been overwritten: the
// report has an error and there is no file.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/recording.h"
#include "runtime/realtime/overwriting_ring.h"
#include "runtime/realtime/spsc_queue.h"

namespace trocar::runtime {

inline constexpr double kBlackBox_s = 4;

/// One file, or the reason why there is none or only a part of it (RecordingWriter).
struct BlackBoxFile {
  Fault fault = Fault::kNone;
  double t_s = 0;          ///< of the fault
  std::uint64_t rows = 0;  ///< from kBlackBox_s before the torques came to rest, or the start
  std::filesystem::path file;
  std::optional<Error> error;
};

class BlackBox {
 public:
  /// Files go into `folder`, named black_box_DATE-TIME_tSECONDSs_FAULT.csv by the start in UTC, the
  /// session's time and the fault's name; existing files are not replaced. Unwritable: the folder
  /// does not exist or files cannot be created in it.
  /// `origin`: for the first row of each file.
  static Result<std::unique_ptr<BlackBox>> make(const std::filesystem::path& folder, double rate_Hz,
                                                const RecordingOrigin& origin = {});
  ~BlackBox();
  BlackBox(const BlackBox&) = delete;
  BlackBox& operator=(const BlackBox&) = delete;

  // Haptic thread.

  void push(const RecordingRow& row) noexcept { ring_.push(row); }
  /// Requests a file of the rows so far. False if too many requests wait; lost() counts them.
  bool save(Fault fault, double t_s) noexcept;

  // One other thread: the one that start() creates, or the caller's.

  void start();
  /// Writes the requested files.
  void serve();
  /// Ends the thread, if any, and writes the remaining files.
  void stop();

  // After stop(), or on the thread that calls serve().

  const std::vector<BlackBoxFile>& files() const noexcept { return files_; }
  /// Requests lost because the queue was full.
  std::uint64_t lost() const noexcept { return lost_.load(); }

 private:
  struct Request {
    Fault fault = Fault::kNone;
    double t_s = 0;
    std::uint64_t end = 0;  ///< rows pushed so far
  };

  BlackBox(std::filesystem::path folder, std::string name, std::size_t rows_of_file,
           RecordingOrigin origin);
  void serve_one(const Request& request);
  std::filesystem::path name_of(const Request& request) const;

  std::filesystem::path folder_;
  std::string name_;
  std::size_t rows_of_file_;
  RecordingOrigin origin_;
  OverwritingRing<RecordingRow> ring_;
  SpscQueue<Request, 256> requests_;
  std::atomic<std::uint64_t> lost_{0};
  std::vector<BlackBoxFile> files_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace trocar::runtime
