// SPDX-License-Identifier: Apache-2.0
// Checks that the value given to an option is a number in a range. CLI::Range is not used, because
// its messages, and whether it accepts nan, differ between versions of CLI11.
// Tests: tests/formats/base/command_line_test.cpp
#pragma once

#include <CLI/CLI.hpp>
#include <sstream>
#include <string>
#include <type_traits>

#include "formats/base/command_line.h"

namespace trocar {

/// Returns a check for CLI::Option::check() that accepts numbers from `low` to `high`. If Number is
/// an integer type, only whole numbers pass. The program's help shows the type and the range; to
/// hide them, call description("") on the result.
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
