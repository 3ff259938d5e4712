// SPDX-License-Identifier: GPL-3.0-or-later
// A collection of scans with their parameters: formats/session/collection.schema.json.
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
  std::string glob;                ///< in place of paths
  std::string series;              ///< of a folder; empty: the one that is taken
  /// The scan's own over the collection's defaults, without those that were taken back.
  nlohmann::json parameters = nlohmann::json::object();
};

struct Collection {
  std::filesystem::path folder;  ///< that all paths are relative to
  std::vector<CollectionScan> scans;
};

/// A name becomes a file's name: a letter, digit or underscore, then letters, digits and . _ + -,
/// at most 120, of ASCII.
bool is_scan_name(std::string_view name);

/// Errors (usage) name the file and the place in it.
Result<Collection> parse_collection(std::string_view text, const std::filesystem::path& file);
Result<Collection> read_collection(const std::filesystem::path& file);

/// A first collection of what `trocar-mesh list` found in `folder`, with paths relative to
/// `relative_to`: every scan that can be used, but no localisers.
nlohmann::json first_collection(const nlohmann::json& list, const std::filesystem::path& folder,
                                const std::filesystem::path& relative_to);

}  // namespace trocar::farm
