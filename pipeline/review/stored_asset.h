// SPDX-License-Identifier: GPL-3.0-or-later
// The assets of a store, read and checked.
// Tests: tests/e2e/review_test.py
#pragma once

#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "pipeline/farm/store.h"

namespace trocar::farm {

/// The index's record of a scan; small enough that those of all scans fit in memory.
struct IndexedScan {
  enum class Status { kDone, kFailed, kDamaged };
  std::string name;
  Status status = Status::kDamaged;
  Object asset;        ///< asset, if the status is kDone
  std::string reason;  ///< reason, if the status is not kDone
};

/// All scans of the index, sorted by name. An entry that cannot be read has the status kDamaged.
std::vector<IndexedScan> indexed_scans(const Store& store);

/// Reads an asset. Errors (refused): the file is missing, does not have its digest, or is no asset;
/// they name the file and the remedy.
Result<Asset> read_stored_asset(const Store& store, const Object& object);

}  // namespace trocar::farm
