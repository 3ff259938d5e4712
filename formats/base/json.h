// SPDX-License-Identifier: Apache-2.0
// JSON: values as text, and strict reading of documents.
#pragma once

#include <cmath>
#include <concepts>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "formats/base/result.h"

namespace trocar {

// Reads and writes a JSON value as text; the value's strings need not be UTF-8. nlohmann's parser
// and serializer take about a second to compile in each file, so call these functions instead.
// Include this header in .cpp files only, because a public header must not include nlohmann/json.

/// Returns `value` as JSON text. Bytes that are not UTF-8 (in file names or in text from scans)
/// are replaced by U+FFFD. Never throws. `indent` has the meaning of nlohmann::json::dump(); -1
/// gives one line.
std::string json_text(const nlohmann::json& value, int indent = -1);

/// The same for an ordered_json, whose keys keep their order. Without this overload, an
/// ordered_json would be converted to json, which sorts the keys. (The overload is a template, so
/// that no other type is converted to ordered_json.)
template <std::same_as<nlohmann::ordered_json> Ordered>
std::string json_text(const Ordered& value, int indent = -1) {
  return value.dump(indent, ' ', false, Ordered::error_handler_t::replace);
}

/// Largest number of arrays and objects within each other in a document that is read.
inline constexpr int kMaxJsonDepth = 64;

/// Returns true if JSON text opens more than kMaxJsonDepth arrays and objects within each other.
/// Reads no further than there, and allocates nothing. Every reader of JSON from outside calls this
/// before the parser, because the parser keeps what it has opened.
bool is_nested_too_deeply(std::string_view text) noexcept;

/// Parses JSON text. If the text is not JSON or is_nested_too_deeply(), returns a discarded value,
/// for which is_discarded() is true, and is_object(), is_array() and so on are false.
nlohmann::json parse_json(std::string_view text);
nlohmann::json parse_json(std::span<const std::uint8_t> text);

/// Parses text that is certainly JSON, because Trocar has written or checked it. Throws an
/// exception of nlohmann's if the text is not JSON.
nlohmann::json parse_known_json(std::string_view text);

/// Returns a JSON array with the names (to_string()) of the first `count` values of an enumeration.
template <typename Enumeration>
nlohmann::json names_of(int count) {
  nlohmann::json list = nlohmann::json::array();
  for (int i = 0; i < count; ++i)
    list.push_back(to_string(static_cast<Enumeration>(i)));
  return list;
}

/// Rounds a number to a multiple of 1 / parts, so that its text in JSON is short.
inline double rounded(double value, double parts) {
  return std::round(value * parts) / parts;
}

// Strict reading of JSON documents: each value is checked for its type and range, unknown keys are
// refused, and the first error is reported with file and JSON path. Include this header in .cpp
// files and internal headers only, because a public header must not include nlohmann/json.

/// Parses one JSON value. `name` names the document in error messages. Errors: kRefused for a
/// syntax error (the message has line and column), bytes after the value, a key that occurs twice
/// in an object, a number beyond double's range, or nesting deeper than 64.
Result<nlohmann::json> parse_strict_json(std::string_view text, const std::string& name);

/// Keeps the first error found in a document; later errors are dropped. Reading goes on after an
/// error, because the getters of StrictObject return a substitute for a wrong value.
struct JsonErrors {
  std::string file;  ///< name of the file in messages
  std::optional<Error> first;
  void add(const std::string& path, const std::string& why);
};

/// Reads one JSON object. Each getter, such as number() or string(), returns the value under a key.
/// If the value is wrong, or is required and missing, the getter adds an error to `errors` and
/// returns a substitute: for a number the lower end of its range, otherwise an empty text, 0, false
/// or null. Only numbers() has no substitute: the elements of `result` that it has not read stay
/// unchanged. Call finish() after the last getter.
class StrictObject {
 public:
  /// `value` and `errors` must outlive this object.
  StrictObject(const nlohmann::json& value, std::string path, JsonErrors& errors);

  bool has(const char* key) const { return value_.is_object() && value_.contains(key); }
  /// Adds an error about this object, or about the value under `key`.
  void error(const std::string& why) { errors_.add(path_, why); }
  void error(const char* key, const std::string& why) { errors_.add(path(key), why); }
  /// Reads a finite number x, lowest <= x <= highest. If the key is missing, the result is
  /// `otherwise`; without `otherwise` the key is required.
  double number(const char* key, double lowest, double highest,
                std::optional<double> otherwise = std::nullopt);
  std::int64_t integer(const char* key, std::int64_t lowest, std::int64_t highest,
                       std::optional<std::int64_t> otherwise = std::nullopt);
  /// Like number(), but a missing key leaves `value` unchanged.
  void read(const char* key, double& value, double lowest, double highest);
  void read(const char* key, std::optional<double>& value, double lowest, double highest);
  /// Reads a string that must be one of `names`, and returns its index in `names`. A missing key
  /// means 0.
  std::size_t choice(const char* key, std::span<const char* const> names);
  /// Reads true or false. A missing key means false.
  bool boolean(const char* key);
  /// Reads a string of 1 to 4096 bytes without control characters.
  std::string string(const char* key);
  /// Reads an array of exactly `result.size()` numbers. If `required` is not set, a missing key
  /// leaves `result` unchanged without an error.
  void numbers(const char* key, std::span<double> result, double lowest, double highest,
               bool required);
  /// Returns the array under `key`. If the key is missing, or the value is not an array with
  /// `shortest` to `longest` elements, adds an error and returns null.
  const nlohmann::json* array(const char* key, std::size_t shortest, std::size_t longest);
  /// Returns the value under `key` unchecked, or null if the key is missing. finish() does not
  /// report the key as unknown.
  const nlohmann::json* optional_value(const char* key) { return find(key, false); }
  /// Makes a StrictObject of the object under `key`, and calls read(object), followed by
  /// object.finish(). Returns false if the key is missing.
  template <typename Read>
  bool section(const char* key, const Read& read) {
    const nlohmann::json* value = find(key, false);
    if (value != nullptr) read_object(*value, path(key), read);
    return value != nullptr;
  }
  /// Like section(), but a missing key is an error.
  template <typename Read>
  void required_section(const char* key, const Read& read) {
    if (const nlohmann::json* value = find(key, true)) read_object(*value, path(key), read);
  }
  /// Reads the array under `key` by array(). For each element, makes a StrictObject and calls
  /// read(object), followed by object.finish().
  template <typename Read>
  void elements(const char* key, std::size_t shortest, std::size_t longest, const Read& read) {
    const nlohmann::json* list = array(key, shortest, longest);
    for (std::size_t i = 0; list != nullptr && i < list->size(); ++i)
      read_object((*list)[i], path(key) + "/" + std::to_string(i), read);
  }
  std::string path(const char* key) const { return path_ + "/" + key; }
  /// Adds an error if the object has a key that no getter has read.
  void finish();

 private:
  template <typename Read>
  void read_object(const nlohmann::json& value, std::string path, const Read& read) {
    StrictObject inner(value, std::move(path), errors_);
    read(inner);
    inner.finish();
  }
  const nlohmann::json* find(const char* key, bool required);
  /// Adds an error about the value under `key`, and returns the substitute for the value.
  template <typename Value>
  Value wrong(const char* key, const std::string& why, Value substitute) {
    error(key, why);
    return substitute;
  }

  const nlohmann::json& value_;
  std::string path_;
  JsonErrors& errors_;
  std::set<std::string> known_;
};

}  // namespace trocar
