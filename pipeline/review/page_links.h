// SPDX-License-Identifier: GPL-3.0-or-later
// Links from a page to the files of a store.
// Tests: tests/e2e/review_test.py
#pragma once

#include <filesystem>
#include <string>

namespace trocar::pipeline {

/// Links are relative, so that page and store can be moved together. If symbolic links would make a
/// relative link wrong, links are absolute (`file:///...`): a browser resolves `..` by the text of
/// the page's address, without looking at symbolic links. A relative link is therefore used only if
/// it is right both for the page's path as it was given and for its path without symbolic links.
class PageLinks {
 public:
  PageLinks(const std::filesystem::path& page, const std::filesystem::path& store);
  /// The URL of a file. `file` is its path relative to the store.
  std::string to(const std::filesystem::path& file) const;

 private:
  std::string store_;  // the URL of the store, empty or with a slash at its end
};

}  // namespace trocar::pipeline
