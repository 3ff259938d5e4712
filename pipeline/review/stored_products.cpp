// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/review/stored_products.h"

#include <cstdint>
#include <nlohmann/json.hpp>
#include <system_error>

#include "formats/base/file_io.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

constexpr std::uint64_t kMaxEntryBytes = std::uint64_t{1} << 28;  // as in store.cpp
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

bool is_object_of_store(const json& file) {
  if (!file.is_object()) return false;
  const auto sha256 = file.find("sha256"), bytes = file.find("bytes");
  if (sha256 == file.end() || bytes == file.end() || !bytes->is_number_unsigned()) return false;
  const auto* text = sha256->get_ptr<const std::string*>();
  return text != nullptr && text->size() == 64 &&
         text->find_first_not_of("0123456789abcdef") == std::string::npos;
}

}  // namespace

std::vector<StoredProduct> products_of(const farm::Store& store, const std::string& scan) {
  std::vector<StoredProduct> out;
  const auto text = read_file(store.entry_file(scan), kMaxEntryBytes);
  if (!text) return out;
  const json entry = json::parse(*text, nullptr, false);
  if (!entry.is_object()) return out;
  const auto products = entry.find("products");
  if (products == entry.end() || !products->is_object()) return out;
  for (const auto& [kind, file] : kProductKinds) {
    const auto product = products->find(std::string(kind));
    if (product == products->end() || !product->is_object()) continue;
    const auto object = product->find("file"), reason = product->find("reason");
    if (object != product->end() && is_object_of_store(*object)) {
      const auto path = std::filesystem::path("products") / scan / file;
      std::error_code ignored;
      if (std::filesystem::is_regular_file(store.folder() / path, ignored))
        out.push_back({kind, path, ""});
      else
        out.push_back({kind, {}, "its file is missing in the store"});
    } else if (reason != product->end() && reason->is_string()) {
      out.push_back({kind, {}, cut(reason->get<std::string>())});
    }
  }
  return out;
}

}  // namespace trocar::pipeline
