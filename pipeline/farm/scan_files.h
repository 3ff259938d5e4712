// SPDX-License-Identifier: GPL-3.0-or-later
// The files of a scan and their states. The state of a file (path, size, modification time and
// inode) shows whether the file has changed.
// Tests: tests/pipeline/farm/store_test.cpp
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
  std::string of;  ///< role of the file, as in NamedFile
  std::string path;
  std::uint64_t size = 0;
  std::int64_t mtime_ns = 0;
  std::uint64_t inode = 0;
  std::string sha256 = {};  ///< digest of the bytes; empty if they were not read
};

/// Is the file unchanged, as far as this can be known without reading the file?
bool same_state(const ScanFile& a, const ScanFile& b);
bool same_state(const std::vector<ScanFile>& a, const std::vector<ScanFile>& b);

/// The scan's input paths, or the matches of its pattern in natural order. Errors: kRefused if
/// nothing matches.
Result<std::vector<std::filesystem::path>> inputs_of(const CollectionScan& scan);

/// The files of all paths, in their order. A folder stands for all its files in natural order. No
/// file is read. Errors: kRefused if a path does not exist, or is neither a file nor a folder.
Result<std::vector<ScanFile>> list_files(const std::vector<NamedFile>& paths);

/// Waits until a further change of the most recently changed file would get a different
/// modification time. (File systems record times in steps.) After that, an unchanged time means
/// unchanged bytes.
void let_times_settle(const std::vector<ScanFile>& files);

/// Computes the digests of those `wanted` files that have none yet. Wanted files that are missing
/// in `files` are added to it. Errors: kRefused if a file cannot be read.
Result<void> digest_files(const std::vector<NamedFile>& wanted, std::vector<ScanFile>& files);

nlohmann::json files_json(const std::vector<ScanFile>& files);
/// Reads the result of files_json(); std::nullopt if it is damaged.
std::optional<std::vector<ScanFile>> files_from(const nlohmann::json& files);

}  // namespace trocar::farm
