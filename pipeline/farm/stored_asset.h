// SPDX-License-Identifier: GPL-3.0-or-later
// The assets of a store, read and checked.
#pragma once

#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "pipeline/farm/store.h"

namespace trocar::farm {

/// What the index says of a scan. Small, so that those of all scans fit in memory.
struct IndexedScan {
  enum class Status { kDone, kFailed, kDamaged };
  std::string name;
  Status status = Status::kDamaged;
  Object asset;        ///< of a scan that is done
  std::string reason;  ///< of others
};

/// All scans of the index, by name. An entry that cannot be read is a scan of status kDamaged.
std::vector<IndexedScan> indexed_scans(const Store& store);

/// Refused, naming the file and what to do, if it is missing, or not the bytes of its digest, or no
/// asset.
Result<Asset> read_stored_asset(const Store& store, const Object& object);

}  // namespace trocar::farm
