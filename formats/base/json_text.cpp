// SPDX-License-Identifier: Apache-2.0
#include "formats/base/json_text.h"

namespace trocar {

std::string json_text(const nlohmann::json& value, int indent) {
  return value.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace);
}

nlohmann::json parse_json(std::string_view text) {
  return nlohmann::json::parse(text, nullptr, false);
}

nlohmann::json parse_json(std::span<const std::uint8_t> text) {
  return nlohmann::json::parse(text.begin(), text.end(), nullptr, false);
}

nlohmann::json parse_known_json(std::string_view text) {
  return nlohmann::json::parse(text);
}

}  // namespace trocar
