// SPDX-License-Identifier: Apache-2.0
// One field of a CSV line (RFC 4180).
#pragma once

#include <charconv>
#include <string>
#include <system_error>

namespace trocar {

/// Returns `text` as one field. A text with a comma, a quote or a line break is put in quotes. A
/// text that a spreadsheet would take for a formula gets an apostrophe in front.
inline std::string csv_field(const std::string& text) {
  double number = 0;
  const char* const last = text.data() + text.size();
  const auto [end, error] = std::from_chars(text.data(), last, number);
  const bool is_number = error == std::errc() && end == last;
  std::string field =
      !text.empty() && !is_number && std::string("=+-@\t\r").find(text[0]) != std::string::npos
          ? "'" + text
          : text;
  if (field.find_first_of(",\"\r\n") == std::string::npos) return field;
  std::string quoted = "\"";
  for (const char c : field) {
    if (c == '"') quoted += '"';
    quoted += c;
  }
  return quoted + '"';
}

}  // namespace trocar
