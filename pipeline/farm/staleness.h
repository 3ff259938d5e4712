// SPDX-License-Identifier: GPL-3.0-or-later
// Reasons why a scan is stale: changed program, parameters, input or store.
// Tests: tests/pipeline/farm/worker_test.cpp
#pragma once

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
  const std::string* program = nullptr;    ///< digest of the program
};

struct Comparison {
  bool rehash = false;  ///< true: reads all inputs
  /// Reads inputs whose state changed; such an input is then a cause only if its bytes differ.
  bool compare_bytes = false;
};

/// The causes of staleness as --json shows them (store.md). The list is empty if the scan is done
/// and unchanged.
std::vector<nlohmann::json> causes(const WantedScan& wanted, const Store& store,
                                   const Comparison& how);

/// A cause as a line: "parameter tolerance: 0.2 -> 0.1".
std::string cause_text(const nlohmann::json& cause);

}  // namespace trocar::farm
