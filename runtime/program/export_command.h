// SPDX-License-Identifier: Apache-2.0
// `trocar-run export`: writes a recording as HDF5. The program trocar-export does the work.
// Tests: tests/e2e/hdf5_export_test.py
#pragma once

#include <string>

#include "formats/base/command_line.h"

namespace trocar::runtime {

inline constexpr const char* kExport = "export";

struct ExportArguments {
  std::string recording, output;
  bool quiet = false;
};

/// Adds the command kExport. Parsing the command line then fills `arguments`.
void declare_export(CommandLine& line, ExportArguments& arguments);

/// Replaces this process by the program trocar-export, which is in the same folder as this program.
/// If trocar-export cannot be started, prints the reason and returns an exit code. Otherwise the
/// function does not return.
int run_export(const ExportArguments& arguments);

}  // namespace trocar::runtime
