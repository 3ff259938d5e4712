// SPDX-License-Identifier: Apache-2.0
// The files of the console's page, which are read once when the console starts, and the policies
// that tell a browser which scripts may run (Content-Security-Policy).
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
  /// Reads the page's files in `folder` and in its subfolders hand/, imaging/, planning/, view/ and
  /// vendor/: at most 64 files of at most 8 MiB each. vendor/ holds the JavaScript libraries. If it
  /// is empty, the page only says how to get the libraries. Errors: kRefused if there is no
  /// index.html, or if there are more or larger files.
  static Result<PageFiles> read(const std::filesystem::path& folder);
  /// Returns the file for the path of a request, such as "/" or "/vendor/uPlot.esm.js". Returns
  /// null if there is no such file.
  const PageFile* find(std::string_view target) const;
  /// Returns the page's Content-Security-Policy. It allows every script file of this server. It
  /// also lists the hashes of the inline scripts that may run: the page's import map, and the
  /// scripts of the session report and of the history of sessions, which appear in frames.
  const std::string& security_policy() const noexcept { return policy_; }

 private:
  std::map<std::string, PageFile, std::less<>> files_;
  std::string policy_;
};

/// Returns the folder with the page's files. If the program is installed in PREFIX/bin, this is
/// PREFIX/share/trocar/console. Otherwise it is the folder runtime/console/page of the sources.
std::filesystem::path page_folder();

/// The Content-Security-Policy of session reports and of the history of sessions. Others may have
/// changed the reports in the console's folder. Therefore only the scripts that this version of
/// Trocar writes into these pages may run.
const std::string& report_policy();

/// Returns the hashes of the scripts in an HTML page that have the opening tag `tag`, such as
/// "<script>". Before each hash is a blank, and each hash has the form 'sha256-HASH' of a
/// Content-Security-Policy.
std::string script_hashes(std::string_view html, std::string_view tag);

}  // namespace trocar::runtime
