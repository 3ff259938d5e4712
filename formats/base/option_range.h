// SPDX-License-Identifier: Apache-2.0
// The range of the number that an option takes. CLI::Range is not used, because its messages, and
// whether it accepts nan, differ between versions of CLI11.
// Tests: tests/formats/base/command_line_test.cpp
#pragma once

#include <CLI/CLI.hpp>
#include <sstream>
#include <string>
#include <type_traits>

#include "formats/base/command_line.h"

namespace trocar {

/// A check for CLI::Option::check(). The help shows the type and the range, unless description("")
/// hides them.
template <typename Number>
CLI::Validator option_range(Number low, Number high) {
  constexpr bool kIsWhole = std::is_integral_v<Number>;
  std::ostringstream description;
  description << (kIsWhole ? "INT" : "FLOAT") << " in [" << low << " - " << high << "]";
  return {[low, high](const std::string& text) {
            return why_not_within(text, static_cast<double>(low), static_cast<double>(high),
                                  kIsWhole);
          },
          description.str()};
}

}  // namespace trocar
