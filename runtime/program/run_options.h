// SPDX-License-Identifier: Apache-2.0
// The options of trocar-run: names, forms, ranges and help texts.
#pragma once

#include "formats/base/command_line.h"
#include "runtime/program/run_arguments.h"

namespace trocar::runtime {

/// Adds the options. Parsing the command line then fills `arguments`.
void declare_run_options(CommandLine& line, RunArguments& arguments);

}  // namespace trocar::runtime
