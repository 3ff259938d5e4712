// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/review/page_links.h"

#include <algorithm>
#include <string_view>
#include <system_error>

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;

// Every byte that has a meaning in a URL, or none in ASCII, is written as %XX.
std::string url_encoded(std::string_view path) {
  constexpr std::string_view kPlain =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-._~/";
  constexpr std::string_view kDigits = "0123456789ABCDEF";
  std::string out;
  for (const char c : path) {
    if (kPlain.find(c) != std::string_view::npos) {
      out += c;
      continue;
    }
    const auto byte = static_cast<unsigned char>(c);
    out += {'%', kDigits[byte >> 4], kDigits[byte & 15]};
  }
  return out;
}

// The absolute path of a folder without "." and "..". Where `..` follows a symbolic link, only the
// file system can resolve it.
fs::path plain_path(const fs::path& folder) {
  std::error_code ignored;
  fs::path out = fs::absolute(folder, ignored);
  if (std::find(out.begin(), out.end(), "..") != out.end())
    out = fs::weakly_canonical(out, ignored);
  out = out.lexically_normal();
  return out.has_filename() ? out : out.parent_path();
}

}  // namespace

PageLinks::PageLinks(const fs::path& page, const fs::path& store) {
  std::error_code error;
  const fs::path from = plain_path(fs::absolute(page, error).parent_path()), to = plain_path(store);
  const fs::path relative = to.lexically_relative(from);
  const fs::path resolved = (fs::weakly_canonical(from, error) / relative).lexically_normal();
  if (!relative.empty() && fs::equivalent(resolved, to, error)) {
    store_ = relative == "." ? "" : url_encoded(relative.generic_string()) + "/";
  } else {
    store_ = "file://" + url_encoded(to.generic_string()) + "/";
  }
}

std::string PageLinks::to(const fs::path& file) const {
  return store_ + url_encoded(file.generic_string());
}

}  // namespace trocar::pipeline
