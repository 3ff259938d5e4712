// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/request_target.h"

#include <algorithm>

namespace trocar::runtime {
namespace {

int digit_of(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

std::optional<std::string> decoded(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      out += text[i];
      continue;
    }
    const int high = i + 2 < text.size() ? digit_of(text[i + 1]) : -1;
    const int low = i + 2 < text.size() ? digit_of(text[i + 2]) : -1;
    if (high < 0 || low < 0) return std::nullopt;
    out += static_cast<char>(16 * high + low);
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
    const auto name = decoded(one.substr(0, equals)), value = decoded(one.substr(equals + 1));
    if (!name || !value || !target.parameters.emplace(*name, *value).second) return std::nullopt;
  }
  return target;
}

std::string RequestTarget::parameter(const char* name) const {
  const auto found = parameters.find(name);
  return found == parameters.end() ? "" : found->second;
}

}  // namespace trocar::runtime
