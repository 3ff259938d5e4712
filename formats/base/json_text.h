// SPDX-License-Identifier: Apache-2.0
// Reads and writes a JSON value as text; the value's strings need not be UTF-8. nlohmann's parser
// and serializer take about a second to compile in each file, so call these functions instead.
// Include this header in .cpp files only, because a public header must not include nlohmann/json.
#pragma once

#include <cmath>
#include <concepts>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <string_view>

namespace trocar {

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

}  // namespace trocar
