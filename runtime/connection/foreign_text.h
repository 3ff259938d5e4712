// SPDX-License-Identifier: Apache-2.0
// Cleans a text from a device or a library, so that it can stand in one line of a message.
#pragma once

#include <string>
#include <string_view>

namespace trocar::runtime {

/// Returns `text` with "?" in place of each character that is not printable ASCII. If the text has
/// more than `max_chars` characters, the rest is replaced by "...". An empty text becomes
/// "(no text)".
inline std::string foreign_text(std::string_view text, std::size_t max_chars = 300) {
  if (text.empty()) return "(no text)";
  std::string line(text.substr(0, max_chars));
  for (char& c : line)
    c = c >= ' ' && c <= '~' ? c : '?';
  if (text.size() > max_chars) line += "...";
  return line;
}

/// Like the function above, for a null-terminated text. A null pointer is treated as an empty text.
inline std::string foreign_text(const char* text) {
  return foreign_text(text == nullptr ? std::string_view() : std::string_view(text));
}

}  // namespace trocar::runtime
