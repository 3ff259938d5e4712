// SPDX-License-Identifier: Apache-2.0
// Text: formats, CSV, regular expressions, suggestions, safe printing, times of day.
#pragma once

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <type_traits>
#include <vector>

namespace trocar {

// Text made from a printf format, and text about a value that is beyond its limit: above an upper
// limit or below a lower limit.

/// The text that printf() would print.
template <typename... Values>
std::string text_line(const char* format, Values... values) {
  const int size = std::snprintf(nullptr, 0, format, values...);
  std::string text(static_cast<std::size_t>(std::max(size, 0)) + 1, '\0');
  std::snprintf(text.data(), text.size(), format, values...);
  text.pop_back();
  return text;
}

/// Returns `value` with `decimals` digits after the decimal point. If `limit` would be printed as
/// the same text, digits are added until the two texts differ, up to 9 digits.
inline std::string apart_from(double value, double limit, int decimals) {
  for (; decimals < 9; ++decimals) {
    if (text_line("%.*f", decimals, value) != text_line("%.*f", decimals, limit)) break;
  }
  return text_line("%.*f", decimals, value);
}

/// Returns, for example, "plate speed 2.31 m/s; the limit is 2 m/s", where `what` is "plate speed"
/// and `unit` is " m/s".
inline std::string describe_beyond(const char* what, double value, double limit, const char* unit,
                                   int decimals) {
  return text_line("%s %s%s; the limit is %.4g%s", what, apart_from(value, limit, decimals).c_str(),
                   unit, limit, unit);
}

// One field of a CSV line (RFC 4180).

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

// Regular expressions by the C library. std::regex is not used: its recursion overflows the stack
// on long texts, and each file that uses it takes two seconds longer to compile.

/// Matches the whole of `text` against `pattern`, a POSIX extended regular expression. If it
/// matches, returns `text`, followed by one element for each pair of parentheses: the text that the
/// pair has matched, or an empty text if the pair took no part in the match. If `text` does not
/// match, or if matching runs out of memory, the result has no elements. A `.` and a `[^...]` match
/// line breaks, too; `.` does not match NUL. Throws std::invalid_argument if the pattern is wrong.
std::vector<std::string> match(const std::string& text, const char* pattern);

/// Returns whether the whole of `text` matches `pattern`, see match().
bool matches(const std::string& text, const char* pattern);

// Suggestions for misspelt names, such as: "--treshold": did you mean --threshold?

/// Returns the candidate with the smallest edit distance (Levenshtein) to `name`. Returns an empty
/// text if this distance is larger than 1 and also larger than a third of the length of `name`.
/// Also returns an empty text if `name` has more than 64 bytes.
std::string nearest_name(std::string_view name, const std::vector<std::string>& candidates);

/// Returns ", did you mean X?", where X is the result of nearest_name(). Returns an empty text if
/// that result is empty.
std::string did_you_mean(std::string_view name, const std::vector<std::string>& candidates);

// Prints texts from outside (file names, scans, scenes, devices) so that they cannot act on a
// terminal: move its cursor, change its title, or reverse the order of letters. Everything that the
// programs print with a text in it goes through print() or print_lines().

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

// Times of day in texts and in names of files. They are UTC and end in Z, whatever the time zone of
// the computer is.

/// "2026-11-30T05:34:38Z" (RFC 3339), for texts. A time that no calendar has gives that of 0.
std::string utc_text(std::time_t time);
/// "20261130T053438Z" (ISO 8601), for names of files and folders. They sort by time.
std::string utc_name(std::time_t time);

}  // namespace trocar
