// SPDX-License-Identifier: Apache-2.0
// The files of the page: a fixed table, read once at start.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar::runtime {

struct PageFile {
  std::string type;  ///< of its contents, for the header Content-Type
  std::string bytes;
};

class PageFiles {
 public:
  /// The page's files in `folder` and those of its folder vendor/, at most 64 of 8 MiB. Without
  /// files in vendor/ the page is one that says how to get them. Refused: there is no index.html.
  static Result<PageFiles> read(const std::filesystem::path& folder);
  /// By the path of a request, such as "/" or "/vendor/uPlot.esm.js"; null: there is none.
  const PageFile* find(std::string_view target) const;
  /// Of the page: scripts of this server and its import map only, by the map's hash.
  const std::string& security_policy() const noexcept { return policy_; }
  bool is_complete() const noexcept { return complete_; }

 private:
  std::map<std::string, PageFile, std::less<>> files_;
  std::string policy_;
  bool complete_ = true;
};

/// Where the page is installed: share/trocar/console beside the program's bin/, else in the sources
/// that the program was built from.
std::filesystem::path page_folder();

/// The Content-Security-Policy's hashes of the import maps of an HTML page: 'sha256-...', each with
/// a blank before it.
std::string import_map_hashes(std::string_view html);

}  // namespace trocar::runtime
