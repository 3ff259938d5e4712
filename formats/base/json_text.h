// SPDX-License-Identifier: Apache-2.0
// JSON as text that can always be written.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace trocar {

/// Bytes that are not UTF-8 (file names, text from scans) become U+FFFD rather than an exception.
/// `indent` as in nlohmann::json::dump(); -1 is one line.
inline std::string json_text(const nlohmann::json& value, int indent = -1) {
  return value.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace);
}

}  // namespace trocar
