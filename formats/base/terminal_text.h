// SPDX-License-Identifier: Apache-2.0
// Prints texts from outside (file names, scans, scenes, devices) so that they cannot act on a
// terminal: move its cursor, change its title, or reverse the order of letters. Everything that the
// programs print with a text in it goes through print() or print_lines().
#pragma once

#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>

namespace trocar {

/// The code point of UTF-8 text that begins at `at`. Moves `at` behind it. std::nullopt if the bytes
/// are not UTF-8.
std::optional<char32_t> next_code_point(std::string_view text, std::size_t& at);

/// Is the text UTF-8? A path may have any bytes, but JSON text is UTF-8.
bool is_utf8(std::string_view text);

/// Is it neither a control character nor one that changes the direction or position of others?
bool is_printable(char32_t c);

/// The text with each character that is not printable as its escape in JSON (\u001b, \u202e, \n),
/// and each byte that is not UTF-8 as \xff. Backslashes stay, so a text that is escaped already does
/// not change.
std::string terminal_text(std::string_view text);

/// The same for a text of several lines, whose line breaks stay. JSON stays JSON of the same value.
std::string terminal_lines(std::string_view text);

/// std::fprintf(), with every text among the values escaped by terminal_text().
template <typename... Values>
void print(std::FILE* to, const char* format, const Values&... values) {
  const auto safe = [](const auto& value) {
    using Value = std::decay_t<decltype(value)>;
    if constexpr (std::is_same_v<Value, std::filesystem::path>) {
      return terminal_text(value.native());
    } else if constexpr (std::is_convertible_v<Value, std::string_view>) {
      return terminal_text(value);
    } else {
      return value;
    }
  };
  const auto shown = [](const auto& value) {
    if constexpr (std::is_same_v<std::decay_t<decltype(value)>, std::string>) {
      return value.c_str();
    } else {
      return value;
    }
  };
  std::fprintf(to, format, shown(safe(values))...);
}

/// Prints a text of several lines, escaped by terminal_lines().
inline void print_lines(std::FILE* to, std::string_view text) {
  std::fputs(terminal_lines(text).c_str(), to);
}

}  // namespace trocar
