// SPDX-License-Identifier: Apache-2.0
#include "formats/base/utc_time.h"

#include <array>

namespace trocar {
namespace {

std::string formatted(std::time_t time, const char* format) {
  std::tm parts{};
  std::array<char, 32> text{};
  if (::gmtime_r(&time, &parts) == nullptr ||
      std::strftime(text.data(), text.size(), format, &parts) == 0)
    return formatted(0, format);
  return text.data();
}

}  // namespace

std::string utc_text(std::time_t time) {
  return formatted(time, "%Y-%m-%dT%H:%M:%SZ");
}

std::string utc_name(std::time_t time) {
  return formatted(time, "%Y%m%dT%H%M%SZ");
}

}  // namespace trocar
