// SPDX-License-Identifier: GPL-3.0-or-later
// The state of a scan: done, a known failure, or stale. A known failure is a scan that was refused
// in an earlier run and has not changed since (store.md). A scan is stale if it is new, if it failed
// for a passing reason, or if its program, its parameters, its input or its files in the store have
// changed.
#pragma once

#include <sys/types.h>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/batch/collection.h"
#include "pipeline/batch/store.h"

namespace trocar::farm {

/// A scan as the collection gives it now.
struct WantedScan {
  const CollectionScan* scan = nullptr;
  const Parameters* parameters = nullptr;  ///< null if a file that they name was refused
};

/// How thoroughly a scan is compared with its index entry.
struct Comparison {
  bool rehash = false;  ///< true: compares the bytes of all inputs with their digests in the index
  /// True: compares the bytes of inputs whose time or inode has changed. If the bytes are the same,
  /// the input does not make the scan stale. If this member and `rehash` are false, a changed time
  /// or inode makes the scan stale.
  bool compare_bytes = false;
  bool retry = false;  ///< true: a scan that has failed is always stale
};

/// The state of a scan. A run works on the scans that are stale.
struct ScanState {
  enum class Kind {
    kDone,          ///< done and unchanged
    kKnownFailure,  ///< failed for a lasting reason, and unchanged
    kStale,         ///< neither done nor a known failure: a run must make the scan
  };
  Kind kind = Kind::kStale;
  /// The causes of the state, as --dry-run and --explain of `trocar-mesh batch` print them with
  /// --json (store.md): changes, and the recorded failure. Empty if the scan is done.
  std::vector<nlohmann::json> why;
  std::uint64_t asset_bytes = 0;  ///< size of the asset in the index; 0 if there is none
  nlohmann::json warnings = nlohmann::json::array();  ///< those of the entry (ScanEntry::warnings)
};

/// Compares a scan with its entry in the store's index. The bytes of the input files are read only
/// if `how.rehash` or `how.compare_bytes` is true; otherwise size, times and inode are compared. A
/// damaged entry counts as none. Errors: kRefused if the entry is there, but cannot be read.
Result<ScanState> state_of(const WantedScan& wanted, const ScanProgram& program, const Store& store,
                           const Comparison& how);

/// A cause as one line, such as "parameter tolerance: 0.2 -> 0.1".
std::string cause_text(const nlohmann::json& cause);

// Tasks that run in separate processes. A crash therefore ends only one task, and all memory of a
// task is returned to the system.

/// A process that has ended.
struct Ended {
  std::size_t task = 0;
  std::string text;                ///< text that `work` returned in the process
  int signal = 0;                  ///< signal that killed the process; 0: none
  int exit_code = 0;               ///< exit code of the process if no signal killed it
  std::uint64_t memory_bytes = 0;  ///< largest resident memory of the process
  double seconds = 0;
};

class Processes {
 public:
  Processes() = default;
  Processes(const Processes&) = delete;
  Processes& operator=(const Processes&) = delete;
  /// Kills the running processes and waits for them.
  ~Processes();

  /// Starts a process for a task by fork(). The new process calls work(), sends the result to the
  /// calling process, and ends. If the calling process dies, the new one is killed. Errors: kBug if
  /// no process can be created.
  Result<void> start(std::size_t task, const std::function<std::string()>& work);
  std::size_t running() const { return running_.size(); }
  /// Waits for a process to end, at most for the given time, and returns it. Returns no value
  /// if none has ended. This can happen even before the given time is over, so call the
  /// function in a loop.
  std::optional<Ended> wait(std::chrono::milliseconds most);
  /// Sends a signal to all running processes.
  void signal_all(int signal) const;

 private:
  struct Running {
    std::size_t task = 0;
    pid_t pid = 0;
    FileDescriptor fd;  ///< the pipe from the process
    std::string text;
    std::chrono::steady_clock::time_point start;
  };
  std::vector<Running> running_;
};

// Does the work of `trocar-mesh batch` on one scan: reads the input, makes the asset, and writes
// the scan's entry in the store's index of scans. Each scan has a process of its own.

struct Work {
  WantedScan wanted;
  bool rehash = false;  ///< read all inputs, even those with unchanged size, time and inode
  bool verify = false;  ///< check the stored outputs, and make damaged ones again
  bool retry = false;   ///< try a known failure again; if it fails, the outcome is kFailed
  int threads = 1;
  /// A flag that a signal handler sets; may be null. Once it is set, an error is not a failure: the
  /// outcome is kInterrupted.
  const std::atomic<bool>* stop = nullptr;
};

/// The outcome of the work on a scan.
struct Outcome {
  enum class Kind {
    kMade,   ///< this run computed the asset and report
    kFound,  ///< the store already had the outputs for the same input, parameters and program
    kFailed,
    kKnownFailure,  ///< not tried again: refused in an earlier run, and unchanged (store.md)
    kLeased,        ///< another process is computing the outputs
    kInterrupted,   ///< a signal ended the batch
  };
  Kind kind = Kind::kFailed;
  /// key: digest of the input, the parameters and the program (scan_files.h), by which the store
  /// finds outputs; empty if not known. reason: the message of the failure.
  std::string key, reason;
  /// signal: the signal that killed the scan's process; 0 if none did.
  int exit_code = 0, signal = 0;
  /// bytes: size of the asset. input_bytes: total size of the input files whose digests were
  /// computed or taken from the index.
  std::uint64_t bytes = 0, input_bytes = 0;
  std::uint64_t memory_bytes = 0;  ///< largest resident memory of the scan's process
  double seconds = 0;              ///< time that the scan's process took
  bool is_recorded = true;         ///< false: the failure could not be written to the index
  nlohmann::json warnings =
      nlohmann::json::array();  ///< ScanEntry::warnings; empty after a failure
};
const char* outcome_name(Outcome::Kind kind);
/// What the scan's process sends; the process that started it knows the rest.
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Outcome, kind, key, reason, exit_code, bytes, input_bytes,
                                   is_recorded, warnings)

/// Works on one scan and writes its index entry. Errors and exceptions become an outcome. After a
/// failure for a reason that may pass, the entry keeps the key and outputs that the index had,
/// unless the scan's key is known to be another one now.
Outcome work_on(const Work& work, const Store& store, const ScanProgram& program);

/// Writes a failure to the index for a scan whose process was killed by a signal, or ended without
/// an outcome. The entry keeps the key and outputs that the index had.
Outcome record_killed(const Work& work, const Store& store, const ScanProgram& program, int signal,
                      int exit_code);

}  // namespace trocar::farm
