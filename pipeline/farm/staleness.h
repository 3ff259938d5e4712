// SPDX-License-Identifier: GPL-3.0-or-later
// The state of a scan: done, a known failure, or stale. A known failure is a scan that was refused
// in an earlier run for a lasting reason and has not changed since (store.md). A scan is stale if
// its program, its parameters, its input, its products or its files in the store have changed.
// Tests: tests/pipeline/farm/worker_test.cpp
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "pipeline/farm/collection.h"
#include "pipeline/farm/product_maker.h"
#include "pipeline/farm/scan_program.h"
#include "pipeline/farm/store.h"

namespace trocar::farm {

/// A scan as the collection gives it now.
struct WantedScan {
  const CollectionScan* scan = nullptr;
  const Parameters* parameters = nullptr;     ///< null if a file that they name was refused
  const ProductPrograms* programs = nullptr;  ///< paths and digests of the programs
};

/// How thoroughly a scan is compared with its index entry.
struct Comparison {
  bool rehash = false;  ///< true: compares the bytes of all inputs
  /// True: compares the bytes of inputs whose state (scan_files.h) has changed. If the bytes are
  /// the same, the input does not make the scan stale.
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
  /// The causes of the state as --json shows them (store.md): changes, and recorded failures of the
  /// scan or of its products. Empty if the scan is done.
  std::vector<nlohmann::json> why;
  std::uint64_t asset_bytes = 0;  ///< size of the asset in the index; 0 if there is none
};

/// Compares a scan with its index entry and the states of its files. Without `how.rehash` and
/// `how.compare_bytes`, no file of the scan is read.
ScanState state_of(const WantedScan& wanted, const ScanProgram& program, const Store& store,
                   const Comparison& how);

/// A cause as one line, such as "parameter tolerance: 0.2 -> 0.1".
std::string cause_text(const nlohmann::json& cause);

}  // namespace trocar::farm
