// SPDX-License-Identifier: Apache-2.0
#include "formats/base/html_text.h"

#include <map>

#include "formats/base/json_text.h"

namespace trocar {

std::string html_text(const std::string& text) {
  const auto valid = parse_known_json(json_text(nlohmann::json(text))).get<std::string>();
  static const std::map<char, const char*> kEscapes{
      {'&', "&amp;"}, {'<', "&lt;"}, {'>', "&gt;"}, {'"', "&quot;"}, {'\'', "&#39;"}};
  std::string out;
  for (const char c : valid) {
    if (const auto escape = kEscapes.find(c); escape != kEscapes.end())
      out += escape->second;
    else
      out += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  }
  return out;
}

}  // namespace trocar
