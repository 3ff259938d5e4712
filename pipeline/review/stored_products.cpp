// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/review/stored_products.h"

#include <cstddef>

namespace trocar::pipeline {
namespace {

constexpr std::size_t kMaxReasonBytes = 400;

// The first kMaxReasonBytes of the text, without half a character of UTF-8 at their end.
std::string cut(std::string text) {
  if (text.size() <= kMaxReasonBytes) return text;
  std::size_t end = kMaxReasonBytes;
  while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xc0) == 0x80)
    --end;
  text.resize(end);
  return text + "...";
}

}  // namespace

std::vector<ShownProduct> products_of(const farm::Store& store, const std::string& scan) {
  std::vector<ShownProduct> out;
  const auto entry = store.entry(scan);
  if (!entry) return out;
  for (const farm::ProductKind kind : farm::kProductKinds) {
    const auto at = entry->products.find(farm::product_name(kind));
    if (at == entry->products.end()) continue;
    const auto path = std::filesystem::path("products") / scan / farm::product_file(kind);
    std::error_code ignored;
    if (!at->second.file) {
      out.push_back({kind, {}, cut(at->second.reason)});
    } else if (std::filesystem::is_regular_file(store.folder() / path, ignored)) {
      out.push_back({kind, path, ""});
    } else {
      out.push_back({kind, {}, "its file is missing in the store"});
    }
  }
  return out;
}

}  // namespace trocar::pipeline
