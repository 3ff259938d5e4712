// SPDX-License-Identifier: Apache-2.0
// The program trocar-run apart from main(). It runs a session of the haptic loop over a scene.
// run_options.h has the options, run_arguments.h their values, and run_commands.h the commands.
#pragma once

namespace trocar::runtime {

/// Runs the command that the arguments of main() name, and returns the exit code.
int trocar_run(int argc, char** argv);

}  // namespace trocar::runtime
