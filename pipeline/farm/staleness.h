// SPDX-License-Identifier: GPL-3.0-or-later
// Why a scan is to be worked on: what of program, parameters, input and store is not as it was.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "pipeline/farm/collection.h"
#include "pipeline/farm/scan_program.h"
#include "pipeline/farm/store.h"

namespace trocar::farm {

/// A scan as the collection has it now.
struct WantedScan {
  const CollectionScan* scan = nullptr;
  const Parameters* parameters = nullptr;  ///< null: a file that they name was refused
  const std::string* program = nullptr;    ///< its digest
};

struct HowToLook {
  bool rehash = false;  ///< read all inputs
  /// Read inputs whose state changed: only what has other bytes is a cause.
  bool compare_bytes = false;
};

/// The causes as --json shows them (store.md); none: the scan is done and as it was.
std::vector<nlohmann::json> causes(const WantedScan& wanted, const Store& store,
                                   const HowToLook& how);

/// A cause as a line: "parameter tolerance: 0.2 -> 0.1".
std::string cause_text(const nlohmann::json& cause);

}  // namespace trocar::farm
