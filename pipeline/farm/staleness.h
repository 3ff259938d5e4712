// SPDX-License-Identifier: GPL-3.0-or-later
// The state of a scan: done, a known failure, or stale. A known failure is a scan that was refused
// in an earlier run and has not changed since (store.md). A scan is stale if it is new, if it failed
// for a passing reason, or if its program, its parameters, its input or its files in the store have
// changed.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "pipeline/farm/collection.h"
#include "pipeline/farm/scan_program.h"
#include "pipeline/farm/store.h"

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

}  // namespace trocar::farm
