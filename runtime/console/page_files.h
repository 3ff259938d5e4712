// SPDX-License-Identifier: Apache-2.0
// The files of the page, a fixed table that is read once at start, and the policy that says which
// scripts may run.
// Tests: tests/runtime/console/console_test.cpp
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar::runtime {

struct PageFile {
  std::string type;  ///< value of the header Content-Type
  std::string bytes;
};

class PageFiles {
 public:
  /// Reads the page's files in `folder` and in its subfolders hand/, view/ and vendor/, at most 64 files
  /// of at most 8 MiB each. If vendor/ is empty, the page only says how to get its libraries. Errors: (refused)
  /// there is no index.html.
  static Result<PageFiles> read(const std::filesystem::path& folder);
  /// Returns the file for the path of a request, such as "/" or "/vendor/uPlot.esm.js"; null:
  /// there is none.
  const PageFile* find(std::string_view target) const;
  /// The page's Content-Security-Policy. It allows scripts of this server and, by their hashes, the
  /// page's import map and the scripts of session reports and of the history.
  const std::string& security_policy() const noexcept { return policy_; }
  bool is_complete() const noexcept { return complete_; }

 private:
  std::map<std::string, PageFile, std::less<>> files_;
  std::string policy_;
  bool complete_ = true;
};

/// Returns the folder share/trocar/console beside the program's bin/; if there is none, the folder
/// in the sources from which the program was built.
std::filesystem::path page_folder();

/// Content-Security-Policy of session reports, and of the history. The files in the folder are not
/// trusted, so the only script that may run is that of this version's template.
const std::string& report_policy();
const std::string& history_policy();

/// Returns the hashes of the scripts in an HTML page that begin with this tag, as needed in a
/// Content-Security-Policy: 'sha256-...', each with a blank before it.
std::string script_hashes(std::string_view html, std::string_view tag);

}  // namespace trocar::runtime
