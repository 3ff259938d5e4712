// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh verify`: checks whether assets are valid (verify_asset() in formats/asset/asset.h).
#pragma once

#include <filesystem>
#include <vector>

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
}  // namespace CLI

namespace trocar::pipeline {

struct VerifyArguments {
  std::vector<std::filesystem::path> assets;
  bool as_json = false;
  bool with_cgal = false;  ///< also verifies every slice with CGAL
  /// Also refuses texts that may identify the patient, and HU around the material (--context).
  bool deidentified = false;
};

/// Declares the options. Parsing writes their values to `a`.
void add_verify_options(CLI::App& command, VerifyArguments& a);

/// Checks every asset and prints the outcome. Returns 0 if all assets are valid, otherwise the exit
/// code of the first failure.
int run_verify(const VerifyArguments& a);

}  // namespace trocar::pipeline
