// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/review/stored_asset.h"

#include <optional>
#include <utility>

#include "formats/base/file_io.h"
#include "pipeline/farm/sha256.h"

namespace trocar::farm {

Result<std::vector<IndexedScan>> indexed_scans(const Store& store) {
  std::vector<IndexedScan> out;
  const auto names = store.names();  // sorted
  if (!names) return names.error();
  for (const std::string& name : *names) {
    IndexedScan scan;
    scan.name = name;
    const auto read = store.read_entry(name);
    if (!read) {
      scan.reason = read.error().is_temporary ? "its entry in the index cannot be read"
                                              : "its entry in the index is damaged";
    } else if (const auto& entry = *read) {
      scan.status = entry->is_done() ? IndexedScan::Status::kDone : IndexedScan::Status::kFailed;
      if (entry->is_done()) scan.asset = entry->outputs->asset;
      scan.reason = entry->reason;
      scan.warnings = entry->warnings;
    } else {
      continue;  // another process has dropped it
    }
    out.push_back(std::move(scan));
  }
  return out;
}

Result<Asset> read_stored_asset(const Store& store, const Object& object) {
  const std::filesystem::path file = store.content_file(object.sha256);
  const auto damaged = [&](const std::string& why) {
    return refused(file.string() + ": " + why + "; trocar-mesh batch --verify makes it again");
  };
  const auto bytes = read_file(file, object.bytes);
  if (!bytes) return damaged("cannot be read, or is longer than the index says");
  if (sha256_of(*bytes) != object.sha256) return damaged("its bytes are not those of its digest");
  return decode_asset(*bytes, file.string());
}

}  // namespace trocar::farm
