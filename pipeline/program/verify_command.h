// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh verify`: checks the invariants of assets.
// Tests: tests/e2e/assets_e2e_test.py
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <vector>

namespace trocar::pipeline {

struct VerifyArguments {
  std::vector<std::filesystem::path> assets;
  bool as_json = false;
  bool with_cgal = false;     ///< also verifies every slice with CGAL
  bool deidentified = false;  ///< also refuses texts that may identify the patient
};

/// Declares the options; `a` must outlive the app.
void add_verify_options(CLI::App& app, VerifyArguments& a);

/// Checks every asset, prints the outcomes and returns the exit code of the first failure, or 0.
int run_verify(const VerifyArguments& a);

}  // namespace trocar::pipeline
