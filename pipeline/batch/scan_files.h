// SPDX-License-Identifier: GPL-3.0-or-later
// SHA-256 of texts and files as 64 lower-case hexadecimal digits, computed by libsodium. Also the
// bytes of a text, and the hexadecimal digits of any bytes.
#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/batch/collection.h"

namespace trocar::farm {

/// The bytes of a text.
std::span<const std::uint8_t> text_bytes(std::string_view text);

std::string sha256_of(std::span<const std::uint8_t> bytes);
std::string sha256_of(std::string_view text);

/// Errors: kRefused if the file cannot be read; the message names the file.
Result<std::string> sha256_of_file(const std::filesystem::path& file);

/// Does the text consist of 64 lower-case hexadecimal digits? The caller must check a digest that
/// was read from a store before the digest becomes part of a path.
bool is_sha256(std::string_view text);

// The files of a scan and their states. The state of a file (path, size, inode, and the times
// of the last change of its bytes and of its status, which cannot be set back) shows whether the file has changed.

struct ScanFile {
  std::string of;  ///< role of the file: "input", or the name of an option (NamedFile::of)
  std::string path;
  std::uint64_t size = 0;
  std::int64_t mtime_ns = 0;
  std::uint64_t inode = 0;
  std::string sha256 = {};  ///< digest of the bytes; empty if they were not read
  /// Time of the last change of bytes, name or rights, which nobody can set; -1: not known.
  std::int64_t ctime_ns = -1;
};

/// Are role, path, size, times and inode equal? The digests are not compared. The callers take the
/// bytes of two files with the same state to be the same.
bool same_state(const ScanFile& a, const ScanFile& b);
bool same_state(const std::vector<ScanFile>& a, const std::vector<ScanFile>& b);

/// The scan's input paths: the paths as they are given or, if the scan has a pattern, the paths
/// that match the pattern, in natural order ("s2" before "s10"). Errors: kRefused if no path
/// matches, or if the pattern's folders cannot be read.
Result<std::vector<std::filesystem::path>> inputs_of(const CollectionScan& scan);

/// The paths of a scan: its inputs, and the files that its parameters name.
std::vector<NamedFile> all_paths(const std::vector<std::filesystem::path>& inputs,
                                 const Parameters& parameters);

/// The files of all paths, in the order of the paths. For a folder, these are all files that
/// files_below() (open/scan_folder.h) finds in it. A DICOMDIR that is the only path of its role
/// stands for its folder, as for open_stack(), and the header of a NRRD also for its data's file. No digest is computed, so the digests are empty.
/// Errors: kRefused if a path does not exist, cannot be searched, or is neither a file nor a
/// folder. If only a part of a folder cannot be reached, this is an error, too, because the rest
/// must not be taken for the whole scan; this error is temporary (Error::is_temporary).
Result<std::vector<ScanFile>> list_files(const std::vector<NamedFile>& paths);

/// File systems record times of modification in steps of up to two seconds, so two changes within
/// one step get the same time. The function waits until the step of the last change of each file is
/// over. After this wait, an unchanged time means unchanged bytes.
void let_times_settle(const std::vector<ScanFile>& files);

/// Computes the digests of those `wanted` files that have none yet, and writes them to `files`.
/// Wanted files that are missing in `files` are appended. Errors: kRefused if a file cannot be
/// read.
Result<void> digest_files(const std::vector<NamedFile>& wanted, std::vector<ScanFile>& files);

nlohmann::json files_json(const std::vector<ScanFile>& files);
/// Reads the result of files_json(); std::nullopt if it is damaged.
std::optional<std::vector<ScanFile>> files_from(const nlohmann::json& files);

// The key of an action. An action is everything that determines the bytes of a scan's outputs: the
// program, the parameters and the input files.

/// The action as a JSON object: "schema", "program", "parameters", and one array for each role
/// (NamedFile::of). `program` is the digest of the program. The array of a role has the digests of
/// those files in `wanted` that have this role, in their order. Precondition: `files` has the
/// digest of every wanted file.
nlohmann::json action_of(const std::string& program, const nlohmann::json& parameters,
                         const std::vector<NamedFile>& wanted, const std::vector<ScanFile>& files);

/// SHA-256 of the action as compact JSON with sorted keys.
std::string key_of(const nlohmann::json& action);

}  // namespace trocar::farm
