// SPDX-License-Identifier: Apache-2.0
// The options of trocar-run that have an effect without a session. One of the options --explain,
// --history, --test, --new-scene and --check replaces the session by something else, for which most
// options of a session mean nothing.
// Tests: tests/e2e/wrong_uses_test.py
#pragma once

#include "formats/base/command_line.h"
#include "formats/base/result.h"
#include "runtime/program/run_arguments.h"

namespace trocar::runtime {

/// Checks that every given option has an effect. `arguments` was parsed from `line`. Errors: kUsage
/// if an option of a session is given to what replaces the session. An option that the tables of
/// option_effects.cpp do not name is for sessions only.
Result<void> check_option_effects(const CommandLine& line, const RunArguments& arguments);

}  // namespace trocar::runtime
