// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/archive/archive_names.h"

#include <algorithm>
#include <charconv>

namespace trocar::archive {
namespace {

constexpr std::size_t kMaxUidLength = 64, kMaxTitleLength = 16;

bool is_digit(char c) {
  return c >= '0' && c <= '9';
}

bool is_printable(char c) {
  return c >= ' ' && c <= '~';
}

}  // namespace

bool is_uid(std::string_view text) {
  if (text.empty() || text.size() > kMaxUidLength) return false;
  char previous = '.';
  for (const char c : text) {
    if (!is_digit(c) && (c != '.' || previous == '.')) return false;
    previous = c;
  }
  return previous != '.';
}

bool is_ae_title(std::string_view text) {
  return !text.empty() && text.size() <= kMaxTitleLength && text.front() != ' ' &&
         text.back() != ' ' &&
         std::all_of(text.begin(), text.end(), [](char c) { return is_printable(c) && c != '\\'; });
}

std::string printable(std::string_view text) {
  std::string out(text.substr(0, kMaxUidLength));
  std::replace_if(
      out.begin(), out.end(), [](char c) { return !is_printable(c); }, '?');
  return out;
}

Result<Peer> parse_peer(const std::string& text) {
  const Error wrong = usage(text + ": must be AE@HOST:PORT, as in ARCHIVE@pacs.example.org:11112");
  const std::size_t at = text.find('@'), colon = text.rfind(':');
  if (at == std::string::npos || colon == std::string::npos || colon < at) return wrong;
  Peer out{text.substr(0, at), text.substr(at + 1, colon - at - 1), 0};
  if (out.host.size() > 2 && out.host.front() == '[' && out.host.back() == ']')
    out.host = out.host.substr(1, out.host.size() - 2);
  const char *first = text.data() + colon + 1, *last = text.data() + text.size();
  const auto [end, error] = std::from_chars(first, last, out.port);
  if (error == std::errc::invalid_argument || end != last) return wrong;
  if (error != std::errc() || out.port < 1 || out.port > 65535)
    return usage(text + ": the port must be within 1 and 65535");
  if (!is_ae_title(out.ae) || out.host.empty() || out.host.size() > 253 ||
      !std::all_of(out.host.begin(), out.host.end(),
                   [](char c) { return is_printable(c) && c != ' '; }))
    return wrong;
  return out;
}

}  // namespace trocar::archive
