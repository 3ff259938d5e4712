// SPDX-License-Identifier: Apache-2.0
// A JSON value as text, also if its strings are not UTF-8. For .cpp files: it includes
// nlohmann/json, which no header of runtime/ may reach.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace trocar {

/// Bytes that are not UTF-8 (in file names, in text from scans) become U+FFFD; nothing is thrown.
/// `indent` as in nlohmann::json::dump(); -1 is one line.
inline std::string json_text(const nlohmann::json& value, int indent = -1) {
  return value.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace);
}

/// The names of an enumeration's first `count` values, by its to_string().
template <typename Enumeration>
nlohmann::json names_of(int count) {
  nlohmann::json list = nlohmann::json::array();
  for (int i = 0; i < count; ++i)
    list.push_back(to_string(static_cast<Enumeration>(i)));
  return list;
}

}  // namespace trocar
