// SPDX-License-Identifier: Apache-2.0
// `trocar-run export`: writes a recording as HDF5. The program trocar-export does the work.
// Tests: tests/e2e/hdf5_export_test.py
#pragma once

#include <string>

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
}

namespace trocar::runtime {

struct ExportArguments {
  std::string recording, output;
  bool quiet = false;
};

/// Adds the subcommand `export`.
CLI::App& declare_export(CLI::App& app, ExportArguments& arguments);

/// Becomes the program trocar-export in the folder of this program. Returns an exit code only if it cannot be started.
int run_export(const ExportArguments& arguments);

}  // namespace trocar::runtime
