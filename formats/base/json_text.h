// SPDX-License-Identifier: Apache-2.0
// Writes a JSON value as text; the value's strings need not be UTF-8. Include this header in .cpp
// files only, because a public header must not include nlohmann/json.
// Tests: tests/pipeline/scan/label_names_test.cpp
#pragma once

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

namespace trocar {

/// Returns `value` as JSON text. Bytes that are not UTF-8 (in file names or in text from scans)
/// are replaced by U+FFFD. Never throws. `indent` has the meaning of nlohmann::json::dump(); -1
/// gives one line.
inline std::string json_text(const nlohmann::json& value, int indent = -1) {
  return value.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace);
}

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
