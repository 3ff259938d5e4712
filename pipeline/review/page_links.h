// SPDX-License-Identifier: GPL-3.0-or-later
// Links from a page to the files of a store.
#pragma once

#include <filesystem>
#include <string>

namespace trocar::pipeline {

/// Links are relative if possible, so that page and store can be moved together. If the page's path
/// goes through a symbolic link, a relative link can lead astray, because for `..` a browser only
/// cuts off the last part of the page's address and does not know the symbolic link. Links are
/// therefore relative only if they work with both forms of the page's path: the path as it was
/// given, and the path with symbolic links resolved. Otherwise links are absolute (`file:///...`).
class PageLinks {
 public:
  PageLinks(const std::filesystem::path& page, const std::filesystem::path& store);
  /// The URL of a file. `file` is its path relative to the store.
  std::string to(const std::filesystem::path& file) const;

 private:
  // The URL of the store with a slash at its end; empty if the store is the page's folder.
  std::string store_;
};

}  // namespace trocar::pipeline
