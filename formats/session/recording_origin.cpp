// SPDX-License-Identifier: Apache-2.0
#include "formats/session/recording_origin.h"

#include <algorithm>
#include <array>
#include <charconv>

namespace trocar {
namespace {

constexpr std::size_t kMaxCharacters = 4096;
constexpr std::string_view kCharacters =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._+-/";

bool is_word(std::string_view text) {
  return !text.empty() && text.find_first_not_of(kCharacters) == std::string_view::npos;
}

bool is_file(std::string_view key) {
  return key == kOriginScene || key == kOriginAsset || key == kOriginDevice;
}

/// The first digits of a digest, enough for a person to compare.
std::string shown(const std::string* value) {
  constexpr std::size_t kDigest = 64, kDigits = 12;
  if (value == nullptr) return "not stated";
  return value->size() == kDigest ? value->substr(0, kDigits) + "..." : *value;
}

}  // namespace

const std::string* RecordingOrigin::find(std::string_view key) const {
  const auto found = std::find_if(entries.begin(), entries.end(),
                                  [&](const auto& entry) { return entry.first == key; });
  return found == entries.end() ? nullptr : &found->second;
}

std::optional<double> RecordingOrigin::number(std::string_view key) const {
  const std::string* const text = find(key);
  double number = 0;
  if (text == nullptr) return std::nullopt;
  const auto [end, error] = std::from_chars(text->data(), text->data() + text->size(), number);
  if (error != std::errc() || end != text->data() + text->size()) return std::nullopt;
  return number;
}

std::string origin_number(double x) {
  std::array<char, 32> text;
  const auto end = std::to_chars(text.data(), text.data() + text.size(), x).ptr;
  return {text.data(), end};
}

std::string to_text(const RecordingOrigin& origin) {
  std::string text;
  for (const auto& [key, value] : origin.entries) {
    if (!text.empty()) text += ';';
    text.append(key).append("=").append(value);
  }
  return text;
}

Result<RecordingOrigin> parse_origin(std::string_view text) {
  RecordingOrigin origin;
  if (text.size() > kMaxCharacters) return refused("is too long");
  while (!text.empty()) {
    const std::size_t end = text.find(';');
    const std::string_view entry = text.substr(0, end);
    const std::size_t equals = entry.find('=');
    const std::string_view key = entry.substr(0, equals);
    const bool good = equals != std::string_view::npos && is_word(key) &&
                      is_word(entry.substr(equals + 1)) && origin.find(key) == nullptr;
    if (!good || end == text.size() - 1) return refused("is not KEY=VALUE;KEY=VALUE");
    origin.entries.emplace_back(key, entry.substr(equals + 1));
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  }
  return origin;
}

std::string differences(const RecordingOrigin& recorded, const RecordingOrigin& run) {
  std::string text;
  const auto compare = [&](const std::string& key) {
    const std::string *const there = recorded.find(key), *const here = run.find(key);
    const bool is_same = there != nullptr && here != nullptr && *there == *here;
    if (key == kOriginProgram || is_same) return;
    if (!text.empty()) text += ", ";
    if (is_file(key)) text += "the ";
    text += key + " (" + shown(there) + ", here " + shown(here) + ")";
  };
  for (const auto& [key, value] : recorded.entries)
    compare(key);
  const std::string* const version = recorded.find(kOriginProgram);
  const std::string* const version_here = run.find(kOriginProgram);
  if (version == nullptr || version_here == nullptr || *version != *version_here) return text;
  for (const auto& [key, value] : run.entries) {
    if (recorded.find(key) == nullptr) compare(key);
  }
  return text;
}

}  // namespace trocar
