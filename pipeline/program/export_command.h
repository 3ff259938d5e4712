// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh export`: writes an asset's slices or surfaces for other programs.
#pragma once

#include <filesystem>

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
}  // namespace CLI

namespace trocar::pipeline {

struct ExportArguments {
  std::filesystem::path asset, folder;
  bool surface = false;  ///< writes the surfaces instead of the slices
};

/// Declares the options. Parsing writes their values to `a`.
void add_export_options(CLI::App& command, ExportArguments& a);

/// Verifies the asset, writes the files and returns the exit code.
int run_export(const ExportArguments& a);

}  // namespace trocar::pipeline
