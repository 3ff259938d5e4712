// SPDX-License-Identifier: GPL-3.0-or-later
// Does the work of `trocar-mesh batch` on one scan: reads the input, makes the asset, and writes
// the scan's entry in the store's index of scans. Each scan has a process of its own.
#pragma once

#include <atomic>
#include <nlohmann/json.hpp>
#include <string>

#include "pipeline/farm/scan_program.h"
#include "pipeline/farm/staleness.h"
#include "pipeline/farm/store.h"

namespace trocar::farm {

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
  /// key: digest of the input, the parameters and the program (action_key.h), by which the store
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
nlohmann::json outcome_json(const Outcome& outcome);
Outcome outcome_from(const nlohmann::json& value);

/// Works on one scan and writes its index entry. Errors and exceptions become an outcome. After a
/// failure for a reason that may pass, the entry keeps the key and outputs that the index had,
/// unless the scan's key is known to be another one now.
Outcome work_on(const Work& work, const Store& store, const ScanProgram& program);

/// Writes a failure to the index for a scan whose process was killed by a signal, or ended without
/// an outcome. The entry keeps the key and outputs that the index had.
Outcome record_killed(const Work& work, const Store& store, const ScanProgram& program, int signal,
                      int exit_code);

}  // namespace trocar::farm
