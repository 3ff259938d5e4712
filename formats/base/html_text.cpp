// SPDX-License-Identifier: Apache-2.0
#include "formats/base/html_text.h"

#include "formats/base/json_text.h"

namespace trocar {

std::string html_text(const std::string& text) {
  const auto valid = parse_known_json(json_text(nlohmann::json(text))).get<std::string>();
  std::string out;
  for (const char c : valid) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      case '\'':
        out += "&#39;";
        break;
      default:
        out += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
    }
  }
  return out;
}

}  // namespace trocar
