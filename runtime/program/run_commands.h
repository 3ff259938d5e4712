// SPDX-License-Identifier: Apache-2.0
// What the commands of trocar-run do.
#pragma once

#include <atomic>

#include "runtime/program/run_options.h"

namespace trocar::runtime {

// Each function prints its errors and returns the exit code.

/// Runs or replays a session, or checks a scene, as RunArguments::task says. `recover`: the flag that
/// the handler of SIGUSR1 sets to request a recovery (SessionOptions::recover).
int run_scene(const RunArguments& arguments, std::atomic<bool>& recover);

/// Prints the values of one procedure, or of all, with the ranges and sources of the values.
int explain_procedures(const RunArguments& arguments);

/// Reads the session reports in a folder and its subfolders, and writes the history of the sessions
/// as a page and a table. In a folder without a session report, summaries are read instead.
int write_history(const RunArguments& arguments);

/// Tries the device without force, and prints whether a session would run undisturbed. If not, the
/// exit code is 5 (kDeviceFault), also after SIGINT, when there is no verdict and no summary.
int test_device(const RunArguments& arguments);

/// Proposes a scene for an asset and writes it to a file.
int make_new_scene(const RunArguments& arguments);

}  // namespace trocar::runtime
