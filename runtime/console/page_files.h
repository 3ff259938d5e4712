// SPDX-License-Identifier: Apache-2.0
// The files of the page, which are read once when the console starts, and the policies that say
// which scripts may run in a browser (Content-Security-Policy).
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
  /// Reads the page's files in `folder` and in its subfolders hand/, imaging/, planning/, view/
  /// and vendor/: at most 64 files of at most 8 MiB each. If vendor/ is empty, the page only says
  /// how to get its libraries. Errors: kRefused if there is no index.html, or if there are more
  /// or larger files.
  static Result<PageFiles> read(const std::filesystem::path& folder);
  /// Returns the file for the path of a request, such as "/" or "/vendor/uPlot.esm.js"; null:
  /// there is none.
  const PageFile* find(std::string_view target) const;
  /// Returns the page's Content-Security-Policy. This policy allows every script of this
  /// server. It also allows, each by its hash, the page's import map and the inline scripts of
  /// session reports and of the page of learning curves.
  const std::string& security_policy() const noexcept { return policy_; }
  /// Returns false if vendor/ is empty.
  bool is_complete() const noexcept { return complete_; }

 private:
  std::map<std::string, PageFile, std::less<>> files_;
  std::string policy_;
  bool complete_ = true;
};

/// Returns the folder with the page's files: share/trocar/console next to the program's folder
/// bin/. If there is none, returns the folder in the sources from which the program was built.
std::filesystem::path page_folder();

/// The Content-Security-Policy of session reports, and that of the history. Reports in
/// the console's folder are not trusted, so the only script that may run is that of
/// this version's template.
const std::string& report_policy();
const std::string& history_policy();

/// Returns the hashes of those scripts in an HTML page that begin with `tag`, as a
/// Content-Security-Policy needs them: 'sha256-...', each with a blank before it.
std::string script_hashes(std::string_view html, std::string_view tag);

}  // namespace trocar::runtime
