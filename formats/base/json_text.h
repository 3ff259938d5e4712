// SPDX-License-Identifier: Apache-2.0
// A JSON value as text, even if its strings are not UTF-8. Include it in .cpp files only, because
// nlohmann/json must not be reachable from headers of runtime/.
// Tests: tests/pipeline/scan/label_names_test.cpp
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace trocar {

/// Replaces bytes that are not UTF-8 (in file names, in text from scans) by U+FFFD; never throws.
/// `indent` has the meaning of nlohmann::json::dump(); -1 gives one line.
inline std::string json_text(const nlohmann::json& value, int indent = -1) {
  return value.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace);
}

/// The names, by to_string(), of the first `count` values of an enumeration.
template <typename Enumeration>
nlohmann::json names_of(int count) {
  nlohmann::json list = nlohmann::json::array();
  for (int i = 0; i < count; ++i)
    list.push_back(to_string(static_cast<Enumeration>(i)));
  return list;
}

}  // namespace trocar
