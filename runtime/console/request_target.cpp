// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/request_target.h"

#include <algorithm>
#include <charconv>

namespace trocar::runtime {
namespace {

// `blank`: the character that stands for a blank.
std::optional<std::string> decoded(std::string_view text, char blank = ' ') {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      out += text[i] == blank ? ' ' : text[i];
      continue;
    }
    const std::string_view digits = text.substr(i + 1, 2);
    unsigned char byte = 0;
    const auto read = std::from_chars(digits.data(), digits.data() + digits.size(), byte, 16);
    if (read.ptr != digits.data() + 2) return std::nullopt;
    out += static_cast<char>(byte);
    i += 2;
  }
  return out;
}

}  // namespace

std::optional<RequestTarget> RequestTarget::parse(std::string_view text) {
  constexpr std::size_t kMaxParameters = 8;
  RequestTarget target;
  const std::size_t question = text.find('?');
  const auto path = decoded(text.substr(0, question));
  if (!path || !path->starts_with('/')) return std::nullopt;
  target.path = *path;
  std::string_view rest = question == std::string_view::npos ? "" : text.substr(question + 1);
  while (!rest.empty()) {
    const std::string_view one = rest.substr(0, rest.find('&'));
    rest.remove_prefix(std::min(rest.size(), one.size() + 1));
    const std::size_t equals = one.find('=');
    if (equals == std::string_view::npos || target.parameters.size() == kMaxParameters)
      return std::nullopt;
    const auto name = decoded(one.substr(0, equals), '+'),
               value = decoded(one.substr(equals + 1), '+');
    if (!name || !value || !target.parameters.emplace(*name, *value).second) return std::nullopt;
  }
  return target;
}

std::string RequestTarget::parameter(const char* name) const {
  const auto found = parameters.find(name);
  return found == parameters.end() ? "" : found->second;
}

}  // namespace trocar::runtime
