// SPDX-License-Identifier: GPL-3.0-or-later
// A collection of scans with their parameters (formats/session/collection.schema.json).
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/farm/product.h"

namespace trocar::farm {

struct CollectionScan {
  std::string name;
  std::vector<std::string> paths;  ///< a file or folder, or several files
  std::string glob;                ///< pattern, if one is given instead of paths
  /// Series in a folder; if empty, it is chosen as by trocar-mesh without --series.
  std::string series;
  /// The collection's defaults overridden by the scan's own, without those set to false or null.
  nlohmann::json parameters = nlohmann::json::object();
  std::vector<WantedProduct> products = {};  ///< in the order of kProductKinds
};

struct Collection {
  std::filesystem::path folder;  ///< base of all paths
  std::vector<CollectionScan> scans;
};

/// Is the text a valid name of a scan, and thus of its files? A name begins with a letter, digit or
/// underscore, followed by letters, digits and . _ + -. It is ASCII and has at most 120 characters.
bool is_scan_name(std::string_view name);

/// Reads a collection. Its folder is that of `file`. Errors: kUsage; the message names the file and
/// the JSON member.
Result<Collection> parse_collection(std::string_view text, const std::filesystem::path& file);
Result<Collection> read_collection(const std::filesystem::path& file);

/// An initial collection, made from the scans that `trocar-mesh list` found in `folder`: every
/// usable scan except localisers, with paths relative to `relative_to`.
nlohmann::json first_collection(const nlohmann::json& list, const std::filesystem::path& folder,
                                const std::filesystem::path& relative_to);

}  // namespace trocar::farm
