// SPDX-License-Identifier: GPL-3.0-or-later
// Reads and checks the assets of a store.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "pipeline/farm/store.h"

namespace trocar::farm {

/// The data of a scan in the store's index. An entry is small, so that the entries of all scans fit
/// into memory together.
struct IndexedScan {
  enum class Status { kDone, kFailed, kDamaged };
  std::string name;
  Status status = Status::kDamaged;
  Object asset;                                       ///< set if the status is kDone
  std::string reason;                                 ///< set if the status is not kDone
  nlohmann::json warnings = nlohmann::json::array();  ///< ScanEntry::warnings
};

/// All scans of the store's index, sorted by name. A scan whose entry cannot be read is kDamaged.
/// Errors: those of Store::names().
Result<std::vector<IndexedScan>> indexed_scans(const Store& store);

/// Reads the asset `object` and checks that its bytes have the digest object.sha256. Errors:
/// kRefused if the file is missing, has another digest, or is not an asset; the message names the
/// file.
Result<Asset> read_stored_asset(const Store& store, const Object& object);

}  // namespace trocar::farm
