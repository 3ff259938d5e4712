// SPDX-License-Identifier: Apache-2.0
// Faults that a stand-in is told to have: KIND@SECONDS[:DURATION], by commas.
#pragma once

#include <algorithm>
#include <charconv>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace stand_in {

struct Fault {
  std::string kind;
  int code = 1;  ///< of KIND=CODE
  double start_s = 0;
  std::optional<double> duration_s;
  int answers = 0;  ///< how many it has changed
};

template <typename Number>
std::optional<Number> number_of(std::string_view text) {
  Number value{};
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || stop != text.data() + text.size()) return std::nullopt;
  return value;
}

/// Splits `text` at the first `mark`. The second part is empty if there is none.
inline std::pair<std::string_view, std::string_view> split(std::string_view text, char mark) {
  const std::size_t at = text.find(mark);
  if (at == std::string_view::npos) return {text, {}};
  return {text.substr(0, at), text.substr(at + 1)};
}

/// Throws std::runtime_error with one line.
inline std::vector<Fault> parse_faults(std::string_view text,
                                       std::span<const std::string_view> kinds) {
  std::vector<Fault> faults;
  while (!text.empty()) {
    const auto [one, rest] = split(text, ',');
    const auto [what, when] = split(one, '@');
    const auto [kind, code] = split(what, '=');
    const auto [start, duration] = split(when, ':');
    Fault fault{std::string(kind), 1, number_of<double>(start).value_or(-1), {}, 0};
    if (!code.empty()) fault.code = number_of<int>(code).value_or(0);
    if (!duration.empty()) fault.duration_s = number_of<double>(duration).value_or(-1);
    if (std::find(kinds.begin(), kinds.end(), kind) == kinds.end() || !(fault.start_s >= 0) ||
        !(fault.duration_s.value_or(1) > 0) || fault.code < 1 ||
        (!code.empty() && kind != "error")) {
      throw std::runtime_error(std::string(one) + " is not KIND@SECONDS[:DURATION]");
    }
    faults.push_back(std::move(fault));
    text = rest;
  }
  return faults;
}

}  // namespace stand_in
