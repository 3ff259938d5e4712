// SPDX-License-Identifier: Apache-2.0
// What trocar-run does: a session or a replay, the check of a scene, a new scene, or the test of a device.
// Tests: tests/e2e/scene_check_e2e_test.py
#pragma once

#include <atomic>

#include "runtime/program/run_arguments.h"

namespace trocar::runtime {

// Each function prints its errors and returns the exit code.

/// Runs or replays a session; with --check, checks the scene instead. The operator sets `recover`
/// to request recovery.
int run_scene(const RunArguments& arguments, std::atomic<bool>& recover);

/// Prints the values of one procedure, or of all, with their ranges and sources (--explain).
int explain_procedures(const RunArguments& arguments);

/// Writes the history of a folder's sessions as a page and a table (--history).
int write_history(const RunArguments& arguments);

/// Tries the device without force (--test), and says whether a session would hold. Exit code 5: it would not.
int test_device(const RunArguments& arguments);

/// Proposes a scene (--new-scene).
int make_new_scene(const RunArguments& arguments);

}  // namespace trocar::runtime
