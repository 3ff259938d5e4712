// SPDX-License-Identifier: GPL-3.0-or-later
// Reads a collection, the list of scans and parameters that `trocar-mesh batch`
// works through (formats/session/collection.schema.json).
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"

namespace trocar::farm {

struct CollectionScan {
  std::string name;
  std::vector<std::string> paths;  ///< a file or folder, or several files
  std::string glob;                ///< pattern for the scan's files; empty if `paths` is given
  /// UID, number or description of a series in a folder. If it is empty, trocar-mesh
  /// chooses the series.
  std::string series;
  /// The collection's defaults, overridden by the scan's own parameters. If the scan sets a
  /// parameter to false or null, the parameter is left out, even if the defaults have it.
  nlohmann::json parameters = nlohmann::json::object();
};

struct Collection {
  std::filesystem::path folder;  ///< folder from which all relative paths start
  std::vector<CollectionScan> scans;
};

/// Is the text a valid name of a scan? Files in the store are named after the scan, so a name must
/// be ASCII and have at most 120 characters. It begins with a letter, digit or underscore, followed
/// by letters, digits and . _ + -.
bool is_scan_name(std::string_view name);

/// Reads a collection from a text or a file. Collection::folder becomes the folder of `file`.
/// Errors: kUsage; the message names the file and the JSON member.
Result<Collection> parse_collection(std::string_view text, const std::filesystem::path& file);
Result<Collection> read_collection(const std::filesystem::path& file);

/// Makes a first collection for the scans in `folder`. `list` is the result of list_scans() for the
/// folder. The collection has every scan that `list` marks as usable, except localisers. The paths
/// of the scans are relative to `relative_to`, or absolute if it is empty. A scan keeps its name when
/// others are added: the name of a series ends with a digest of its UID, and scans whose names would
/// be equal get a digest of their paths. A scan whose path a collection cannot state, because it has
/// control characters or is not UTF-8, is left out, and its path added to `left_out`.
nlohmann::json first_collection(const nlohmann::json& list, const std::filesystem::path& folder,
                                const std::filesystem::path& relative_to,
                                std::vector<std::string>* left_out = nullptr);

}  // namespace trocar::farm
