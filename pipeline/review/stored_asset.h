// SPDX-License-Identifier: GPL-3.0-or-later
// Reads and checks the assets of a store.
// Tests: tests/e2e/review_test.py
#pragma once

#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "pipeline/farm/store.h"

namespace trocar::farm {

/// The data of a scan in the index. The data are small, so that those of all scans fit into memory.
struct IndexedScan {
  enum class Status { kDone, kFailed, kDamaged };
  std::string name;
  Status status = Status::kDamaged;
  Object asset;        ///< set if the status is kDone
  std::string reason;  ///< set if the status is not kDone
};

/// All scans of the index, sorted by name. An entry that cannot be read has the status kDamaged.
std::vector<IndexedScan> indexed_scans(const Store& store);

/// Reads an asset. Errors: kRefused if the file is missing, does not have its digest, or is not an
/// asset; the message names the file and the remedy.
Result<Asset> read_stored_asset(const Store& store, const Object& object);

}  // namespace trocar::farm
