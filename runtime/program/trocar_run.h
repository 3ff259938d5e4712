// SPDX-License-Identifier: Apache-2.0
// The program trocar-run apart from main(): its options are in run_options.h, what its commands do
// in run_commands.h.
#pragma once

namespace trocar::runtime {

/// Runs the command that the arguments of main() name, and returns the exit code.
int trocar_run(int argc, char** argv);

}  // namespace trocar::runtime
