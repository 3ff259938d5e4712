// SPDX-License-Identifier: Apache-2.0
// Strict reading of JSON documents: each key is read with its type and range, unknown keys are
// refused, and the first error is reported with file and JSON path. For .cpp files, as json_text.h.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar {

/// Parses one JSON value. Refuses syntax errors (with line and column), bytes after the value, a
/// key that occurs twice in an object, numbers beyond double's range and nesting deeper than 64.
Result<nlohmann::json> parse_strict_json(std::string_view text, const std::string& name);

/// Keeps the first error of a document; its readers continue with defaults.
struct JsonErrors {
  std::string file;  ///< for the message
  std::optional<Error> first;
  void add(const std::string& path, const std::string& why);
};

/// Reads one object. A getter returns the value; if it is missing or wrong, it adds an error and
/// returns `lowest` or an empty value. Call finish() after the last getter.
class StrictObject {
 public:
  /// `value` and `errors` must outlive the reader.
  StrictObject(const nlohmann::json& value, std::string path, JsonErrors& errors);

  bool has(const char* key) const;
  /// Finite and lowest <= x <= highest. Without `otherwise` the key is required.
  double number(const char* key, double lowest, double highest,
                std::optional<double> otherwise = std::nullopt);
  std::int64_t integer(const char* key, std::int64_t lowest, std::int64_t highest,
                       std::optional<std::int64_t> otherwise = std::nullopt);
  /// False if the key is missing.
  bool boolean(const char* key);
  /// 1 to 4096 bytes without control characters.
  std::string string(const char* key);
  /// `result.size()` numbers. A missing key leaves `result` as it is, if `required` is not set.
  void numbers(const char* key, std::span<double> result, double lowest, double highest,
               bool required);
  /// The array under `key`; null, with an error, if it is missing, not an array, or its length is
  /// out of bounds.
  const nlohmann::json* array(const char* key, std::size_t shortest, std::size_t longest);
  /// The value under `key`, or null if it is missing; the key counts as known.
  const nlohmann::json* optional_value(const char* key);
  std::string path(const char* key) const { return path_ + "/" + key; }
  /// Adds an error if the object has a key that no getter has read.
  void finish();

 private:
  const nlohmann::json* find(const char* key, bool required);

  const nlohmann::json& value_;
  std::string path_;
  JsonErrors& errors_;
  std::set<std::string> known_;
};

}  // namespace trocar
