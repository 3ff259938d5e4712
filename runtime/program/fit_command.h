// SPDX-License-Identifier: Apache-2.0
// `trocar-run fit`: fits the parameters of a tissue to a measured force-depth curve
// (runtime/calibration).
// Tests: tests/e2e/fit_test.py
#pragma once

#include <optional>
#include <string>

#include "formats/base/command_line.h"

namespace trocar::runtime {

inline constexpr const char* kFit = "fit";

/// The options of the command. An empty string means that the option was not given.
struct FitArguments {
  std::string curve, tool, output, page, tip;
  std::optional<double> diameter_mm, bore_mm, half_angle_deg;
  std::optional<int> gauge;
  bool quiet = false;
};

/// Adds the command kFit. Parsing the command line then fills `arguments`.
void declare_fit(CommandLine& line, FitArguments& arguments);

/// Fits the curve, prints the parameters and writes the files. Prints errors, and returns the exit
/// code of the program.
int run_fit(const FitArguments& arguments);

}  // namespace trocar::runtime
