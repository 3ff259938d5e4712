// SPDX-License-Identifier: Apache-2.0
// One line of text by a printf format, and of a value beyond its limit.
#pragma once

#include <algorithm>
#include <cstdio>
#include <string>

namespace trocar::runtime {

template <typename... Values>
std::string text_line(const char* format, Values... values) {
  const int size = std::snprintf(nullptr, 0, format, values...);
  std::string text(static_cast<std::size_t>(std::max(size, 0)) + 1, '\0');
  std::snprintf(text.data(), text.size(), format, values...);
  text.pop_back();
  return text;
}

/// A value with as many decimals as it takes to tell it from a limit, at least `decimals`.
inline std::string apart_from(double value, double limit, int decimals) {
  for (; decimals < 9; ++decimals) {
    if (text_line("%.*f", decimals, value) != text_line("%.*f", decimals, limit)) break;
  }
  return text_line("%.*f", decimals, value);
}

/// "WHAT 2.31 m/s; the limit is 2 m/s", with the unit " m/s".
inline std::string describe_beyond(const char* what, double value, double limit, const char* unit,
                                   int decimals) {
  return text_line("%s %s%s; the limit is %.4g%s", what, apart_from(value, limit, decimals).c_str(),
                   unit, limit, unit);
}

}  // namespace trocar::runtime
