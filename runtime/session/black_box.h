// SPDX-License-Identifier: Apache-2.0
// The black box: the last seconds of every tick, kept always and written out on a fault, as a
// recording of its own. The haptic thread writes into a ring made beforehand and says where it
// stood; a worker copies and writes. The ring holds twice what a file does, so the worker has as
// long again before the haptic thread comes round; if it ever were later, the file says so by
// being an error in the report, never by being a mixture.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "formats/session/recording.h"
#include "formats/base/result.h"
#include "runtime/realtime/overwriting_ring.h"
#include "runtime/realtime/spsc_queue.h"

namespace trocar::runtime {

inline constexpr double kBlackBox_s = 4;

/// One file, or why there is none.
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
  /// session's time and the fault's word; what is there already is not replaced. Unwritable: no
  /// folder, or one that nothing can be put into.
  static Result<std::unique_ptr<BlackBox>> make(const std::filesystem::path& folder,
                                                double rate_Hz);
  ~BlackBox();
  BlackBox(const BlackBox&) = delete;
  BlackBox& operator=(const BlackBox&) = delete;

  // Haptic thread.

  void push(const RecordingRow& row) noexcept { ring_.push(row); }
  /// Asks for the rows so far to be written. False: too many files wait; it is counted.
  bool save(Fault fault, double t_s) noexcept;

  // One other thread: the one that start() makes, or the caller's.

  void start();
  /// Writes what was asked for.
  void serve();
  /// Ends the thread, if any, and writes the rest.
  void stop();

  // After stop(), or from the thread that serves.

  const std::vector<BlackBoxFile>& files() const noexcept { return files_; }
  /// Requests that found no room.
  std::uint64_t lost() const noexcept { return lost_.load(); }

 private:
  struct Request {
    Fault fault = Fault::kNone;
    double t_s = 0;
    std::uint64_t end = 0;  ///< rows pushed so far
  };

  BlackBox(std::filesystem::path folder, std::string name, std::size_t rows_of_file);
  void serve_one(const Request& request);
  std::filesystem::path name_of(const Request& request) const;

  std::filesystem::path folder_;
  std::string name_;
  std::size_t rows_of_file_;
  OverwritingRing<RecordingRow> ring_;
  SpscQueue<Request, 256> requests_;
  std::atomic<std::uint64_t> lost_{0};
  std::vector<BlackBoxFile> files_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace trocar::runtime
