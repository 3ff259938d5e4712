// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh info`: prints what an asset contains.
#pragma once

#include <filesystem>

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
}  // namespace CLI

namespace trocar::pipeline {

struct InfoArguments {
  std::filesystem::path asset;
  bool as_json = false;
};

/// Declares the options. Parsing writes their values to `a`.
void add_info_options(CLI::App& command, InfoArguments& a);

/// Prints the description and returns the exit code.
int run_info(const InfoArguments& a);

}  // namespace trocar::pipeline
