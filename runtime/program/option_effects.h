// SPDX-License-Identifier: Apache-2.0
// The options of trocar-run that are accepted without a session. Each of the options --explain,
// --history, --test, --new-scene and --check replaces the session by another task, which most
// options of a session do not affect.
#pragma once

#include "formats/base/command_line.h"
#include "formats/base/result.h"
#include "runtime/program/run_arguments.h"

namespace trocar::runtime {

/// If a task replaces the session, checks that the task accepts every given option. `arguments` was
/// parsed from `line`. Errors: kUsage if the task does not accept an option. The tables of
/// option_effects.cpp name the options that each task accepts; all other options are for sessions
/// only. Some accepted options have no effect: settings of the session with --check, so that
/// --check can be added to the command of a session, and some options of the device, because the
/// console and scripts give these options to every task that uses a device.
Result<void> check_option_effects(const CommandLine& line, const RunArguments& arguments);

}  // namespace trocar::runtime
