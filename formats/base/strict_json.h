// SPDX-License-Identifier: Apache-2.0
// JSON from outside, read strictly: every key is asked for by name and type and
// range, what nobody asked for is refused, and the first thing that is wrong is
// named by file and JSON path.
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

/// One JSON value. Refuses syntax errors (line and column), bytes after the value,
/// the same key twice in an object and numbers beyond double's range.
Result<nlohmann::json> parse_strict_json(std::string_view text, const std::string& name);

/// Where a document's first error is kept while its readers go on with defaults.
struct JsonErrors {
  std::string file;  ///< named in the message
  std::optional<Error> first;
  void add(const std::string& path, const std::string& why);
};

/// Reads one object. Getters return the value, or, after noting an error, `lowest`
/// or an empty one; call finish() after the last getter.
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
  /// 1 to 4096 bytes without control characters.
  std::string string(const char* key);
  /// `result.size()` numbers. A missing key leaves `result` as it is, if `required` is not set.
  void numbers(const char* key, std::span<double> result, double lowest, double highest,
               bool required);
  /// The array under `key`, or null and an error if it is missing, no array or its length is
  /// outside the bounds.
  const nlohmann::json* array(const char* key, std::size_t shortest, std::size_t longest);
  /// The value under `key` (marked as asked for), or null if it is missing.
  const nlohmann::json* optional_value(const char* key);
  std::string path(const char* key) const { return path_ + "/" + key; }
  /// Refuses the keys that no getter asked for.
  void finish();

 private:
  const nlohmann::json* find(const char* key, bool required);

  const nlohmann::json& value_;
  std::string path_;
  JsonErrors& errors_;
  std::set<std::string> asked_;
};

}  // namespace trocar
