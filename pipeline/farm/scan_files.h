// SPDX-License-Identifier: GPL-3.0-or-later
// The files of a scan: which they are, and what tells that one has changed.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/farm/collection.h"
#include "pipeline/farm/scan_program.h"

namespace trocar::farm {

struct ScanFile {
  std::string of;  ///< NamedFile's
  std::string path;
  std::uint64_t size = 0;
  std::int64_t mtime_ns = 0;
  std::uint64_t inode = 0;
  std::string sha256 = {};  ///< empty: not read
};

/// Whether it is the file that it was, as far as can be known without reading it.
bool same_state(const ScanFile& a, const ScanFile& b);
bool same_state(const std::vector<ScanFile>& a, const std::vector<ScanFile>& b);

/// The scan's inputs: its paths, or what its pattern matches, in natural order. Errors (refused):
/// nothing matches.
Result<std::vector<std::filesystem::path>> inputs_of(const CollectionScan& scan);

/// The files of all paths, in their order; of a folder all in it, in natural order. Nothing is
/// read. Errors (refused): a path that is not there, or no file.
Result<std::vector<ScanFile>> list_files(const std::vector<NamedFile>& paths);

/// Waits until a change of a file that was changed last would have another time, as far as file
/// systems can tell: the file's bytes and its time then belong together.
void let_times_settle(const std::vector<ScanFile>& files);

/// Digests of the `wanted` files that have none yet; those not in `files` are added. Errors
/// (refused): a file cannot be read.
Result<void> digest_files(const std::vector<NamedFile>& wanted, std::vector<ScanFile>& files);

nlohmann::json files_json(const std::vector<ScanFile>& files);
/// Nothing if it is not what files_json() gives.
std::optional<std::vector<ScanFile>> files_from(const nlohmann::json& files);

}  // namespace trocar::farm
