// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh list`: prints the scans in a folder.
#pragma once

#include <filesystem>

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
}  // namespace CLI

namespace trocar::pipeline {

struct ListArguments {
  std::filesystem::path folder;
  std::filesystem::path output;                 ///< file for the collection; empty: standard output
  bool as_json = false, as_collection = false;  ///< as_collection: print a collection (--manifest)
};

/// Declares the options. Parsing writes their values to `a`.
void add_list_options(CLI::App& command, ListArguments& a);

/// Prints the scans and returns the exit code, which is 3 if none of them can be meshed.
int run_list(const ListArguments& a);

}  // namespace trocar::pipeline
