// SPDX-License-Identifier: Apache-2.0
// What the main() of every program does besides its work: it treats signals, errors and standard
// output. The library trocar_command_line has these functions.
#pragma once

#include <atomic>
#include <functional>
#include <string>

#include "formats/base/result.h"

namespace trocar {

/// Becomes true on SIGINT, SIGTERM or SIGHUP, if stop_on_signals() has been called before. Programs
/// check this flag between two steps of their work, and end without partial output.
extern std::atomic<bool> stop_requested;
static_assert(std::atomic<bool>::is_always_lock_free);  // a signal handler sets the flag

/// Makes SIGINT, SIGTERM and SIGHUP set stop_requested instead of ending the process.
void stop_on_signals();

/// Writes "PROGRAM: MESSAGE" to stderr and returns the error's exit code.
int report_error(const std::string& program, const Error& error);

/// Does the complete work of main(): runs `body`, flushes standard output and returns the exit code
/// of `body`, or that of a failed write (finish_output() in standard_output.h). SIGPIPE and SIGXFSZ
/// are ignored. So a write() to a closed pipe, or beyond the user's limit of file size, returns an
/// error and does not end the process. If `body` throws an exception, the exception is reported as
/// a bug (exit code 1).
int run_program(const std::string& program, const std::function<int()>& body);

}  // namespace trocar
