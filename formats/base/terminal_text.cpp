// SPDX-License-Identifier: Apache-2.0
#include "formats/base/terminal_text.h"

#include <array>
#include <cstdint>

namespace trocar {
namespace {

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
    if (!c) {
      out += hex(static_cast<unsigned char>(text[at++]), "\\x%02x");
    } else if (is_printable(*c) || (keep_lines && *c == U'\n')) {
      out += text.substr(from, at - from);
    } else {
      out += escaped(*c);
    }
  }
  return out;
}

}  // namespace

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

}  // namespace trocar
