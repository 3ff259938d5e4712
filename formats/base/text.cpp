// SPDX-License-Identifier: Apache-2.0
#include "formats/base/text.h"

#include <regex.h>
#include <array>
#include <cstdint>
#include <limits>
#include <numeric>
#include <stdexcept>

namespace trocar {

std::vector<std::string> match(const std::string& text, const char* pattern) {
  // Without the anchors, the library would search from every character of the text.
  const std::string whole = "^(" + std::string(pattern) + ")$";
  regex_t compiled;
  if (::regcomp(&compiled, whole.c_str(), REG_EXTENDED) != 0)
    throw std::invalid_argument(std::string("not a regular expression: ") + pattern);
  std::vector<regmatch_t> parts(compiled.re_nsub + 1);
  // The text ends where parts[0] says, not at a NUL in it.
  const bool fits = text.size() <= std::numeric_limits<regoff_t>::max();
  parts[0] = {0, fits ? static_cast<regoff_t>(text.size()) : 0};
  const bool is_found =
      fits && ::regexec(&compiled, text.c_str(), parts.size(), parts.data(), REG_STARTEND) == 0;
  ::regfree(&compiled);
  std::vector<std::string> out;
  if (!is_found) return out;
  // parts[1] belongs to the parentheses above, so it is the whole text.
  for (auto part = parts.begin() + 1; part != parts.end(); ++part) {
    const bool took_part = part->rm_so >= 0;
    out.push_back(took_part ? text.substr(static_cast<std::size_t>(part->rm_so),
                                          static_cast<std::size_t>(part->rm_eo - part->rm_so))
                            : std::string());
  }
  return out;
}

bool matches(const std::string& text, const char* pattern) {
  return !match(text, pattern).empty();
}

namespace {

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i + 1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j] + 1, diagonal + 1});
    }
  }
  return row.back();
}

std::string hex(std::uint32_t value, const char* format) {
  char out[16];
  std::snprintf(out, sizeof out, format, value);
  return out;
}

std::string escaped(char32_t c) {
  switch (c) {
    case U'\n':
      return "\\n";
    case U'\r':
      return "\\r";
    case U'\t':
      return "\\t";
    default:
      break;
  }
  constexpr const char* kUnit = "\\u%04x";
  const auto code = static_cast<std::uint32_t>(c);
  if (code < 0x10000) return hex(code, kUnit);
  const std::uint32_t above = code - 0x10000;  // as a pair of UTF-16
  return hex(0xd800 + (above >> 10), kUnit) + hex(0xdc00 + (above & 0x3ff), kUnit);
}

std::string shown(std::string_view text, bool keep_lines) {
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t from = at;
    const auto c = next_code_point(text, at);
    if (!c)
      out += hex(static_cast<unsigned char>(text[at++]), "\\x%02x");
    else if (is_printable(*c) || (keep_lines && *c == U'\n'))
      out += text.substr(from, at - from);
    else
      out += escaped(*c);
  }
  return out;
}

std::string formatted(std::time_t time, const char* format) {
  std::tm parts{};
  std::array<char, 32> text{};
  if (::gmtime_r(&time, &parts) == nullptr ||
      std::strftime(text.data(), text.size(), format, &parts) == 0)
    return formatted(0, format);
  return text.data();
}

}  // namespace

std::string nearest_name(std::string_view name, const std::vector<std::string>& candidates) {
  if (name.size() > 64) return {};
  std::size_t best = std::max<std::size_t>(1, name.size() / 3) + 1;
  std::string found;
  for (const std::string& candidate : candidates) {
    const std::size_t distance = edit_distance(name, candidate);
    if (distance < best) best = distance, found = candidate;
  }
  return found;
}

std::string did_you_mean(std::string_view name, const std::vector<std::string>& candidates) {
  const std::string near = nearest_name(name, candidates);
  return near.empty() ? "" : ", did you mean " + near + "?";
}

std::optional<char32_t> next_code_point(std::string_view text, std::size_t& at) {
  const auto byte = [&text](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char first = byte(at);
  const std::size_t length = first < 0x80   ? 1
                             : first < 0xc2 ? 0
                             : first < 0xe0 ? 2
                             : first < 0xf0 ? 3
                             : first < 0xf5 ? 4
                                            : 0;
  if (length == 0 || at + length > text.size()) return {};
  std::uint32_t out = length == 1 ? first : first & (0x7fU >> length);
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(at + i) & 0xc0) != 0x80) return {};
    out = out << 6 | (byte(at + i) & 0x3fU);
  }
  constexpr std::array<std::uint32_t, 5> kMin{0, 0, 0x80, 0x800, 0x10000};
  if (out < kMin[length] || out > 0x10ffff || (out >= 0xd800 && out <= 0xdfff)) return {};
  at += length;
  return static_cast<char32_t>(out);
}

bool is_utf8(std::string_view text) {
  for (std::size_t at = 0; at < text.size();)
    if (!next_code_point(text, at)) return false;
  return true;
}

bool is_printable(char32_t c) {
  const auto within = [c](char32_t low, char32_t high) { return c >= low && c <= high; };
  return !(c < 0x20 || within(0x7f, 0x9f) || c == 0xad || c == 0x61c || c == 0x180e ||
           within(0x200b, 0x200f) || within(0x2028, 0x202e) || within(0x2060, 0x206f) ||
           within(0xfff0, 0xfffb) || c == 0xfeff || c == 0xfffe || c == 0xffff ||
           within(0xe000, 0xf8ff) || c >= 0xe0000);
}

std::string terminal_text(std::string_view text) {
  return shown(text, false);
}

std::string terminal_lines(std::string_view text) {
  return shown(text, true);
}

std::string utc_text(std::time_t time) {
  return formatted(time, "%Y-%m-%dT%H:%M:%SZ");
}

std::string utc_name(std::time_t time) {
  return formatted(time, "%Y%m%dT%H%M%SZ");
}

}  // namespace trocar
