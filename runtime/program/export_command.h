// SPDX-License-Identifier: Apache-2.0
// `trocar-run export`: writes a recording as HDF5. The program trocar-export does the work.
// Tests: tests/e2e/hdf5_export_test.py
#pragma once

#include <string>

#include "formats/base/command_line.h"

namespace trocar::runtime {

struct ExportArguments {
  std::string recording, output;
  bool quiet = false;
};

/// Declares the options that the command and the program trocar-export share.
inline void declare_export_options(const Command& command, ExportArguments& a) {
  command
      .option("RECORDING", a.recording,
              "the recording, a CSV file that trocar-run --record has written")
      .required();
  command.option("-o,--output", a.output, "the HDF5 file to write").with_form("FILE").required();
  command.flag("--quiet", a.quiet, "print errors only");
}

/// Adds the command `export`. Parsing the command line then fills `arguments`.
void declare_export(CommandLine& line, ExportArguments& arguments);

/// Replaces this process by the program trocar-export, which is in the same folder as this program.
/// If trocar-export cannot be started, prints the reason and returns an exit code. Otherwise the
/// function does not return.
int run_export(const ExportArguments& arguments);

}  // namespace trocar::runtime
