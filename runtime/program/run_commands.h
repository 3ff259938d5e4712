// SPDX-License-Identifier: Apache-2.0
// What trocar-run does without a subcommand: a session or a replay, the check of a scene, a new
// scene, the test of a device, the list of procedures, or the history of sessions. The options
// select one of these. (The subcommands fit and export are in other files.)
#pragma once

#include <atomic>

#include "runtime/program/run_arguments.h"

namespace trocar::runtime {

// Each function prints its errors and returns the exit code.

/// Runs or replays a session; with --check, checks the scene instead. `recover`: the flag that the
/// handler of SIGUSR1 sets to request a recovery (SessionOptions::recover).
int run_scene(const RunArguments& arguments, std::atomic<bool>& recover);

/// A procedure is an intervention with its tool, soft layers and resistance of the bone. Prints the
/// values of one procedure, or of all, with the ranges and sources of the values (--explain).
int explain_procedures(const RunArguments& arguments);

/// Reads the session reports in a folder and its subfolders, and writes the history of the sessions
/// as a page and a table (--history). In a folder without a session report, summaries are read
/// instead.
int write_history(const RunArguments& arguments);

/// Tries the device without force (--test), and prints whether a session would run undisturbed. If
/// not, the exit code is 5 (kDeviceFault). After SIGINT there is no verdict and no summary, and the
/// exit code is 3 (kRefused).
int test_device(const RunArguments& arguments);

/// Proposes a scene for an asset and writes it to a file (--new-scene).
int make_new_scene(const RunArguments& arguments);

}  // namespace trocar::runtime
