// SPDX-License-Identifier: Apache-2.0
// Text made from a printf format, and text about a value that is beyond its limit: above an upper
// limit or below a lower limit.
#pragma once

#include <algorithm>
#include <cstdio>
#include <string>

namespace trocar {

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

}  // namespace trocar
