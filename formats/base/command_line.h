// SPDX-License-Identifier: Apache-2.0
// The common treatment of command line, standard output, signals and errors in all programs. This
// is a separate library (trocar_command_line), so that trocar_formats does not need CLI11.
#pragma once

#include <atomic>
#include <functional>
#include <optional>
#include <string>

#include "formats/base/result.h"

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
}

namespace trocar {

/// Set by SIGINT, SIGTERM and SIGHUP once stop_on_signals() has been called. A program checks it
/// between two steps of its work, so that it ends cleanly and leaves no partial output.
extern std::atomic<bool> stop_requested;
static_assert(std::atomic<bool>::is_always_lock_free);  // it is set in a signal handler

/// Makes SIGINT, SIGTERM and SIGHUP set stop_requested instead of ending the process.
void stop_on_signals();

/// Writes "PROGRAM: MESSAGE" to stderr and returns the error's exit code.
int report_error(const std::string& program, const Error& error);

/// Declares --help and --version. Call it before subcommands are added, because they inherit
/// --help. `version` is the text that --version prints.
void add_help_and_version(CLI::App& app, const std::string& version);

/// CLI11 group of options that only --help-all shows.
inline constexpr const char* kDiagnostics = "Diagnostics";

/// Declares --help-all. If subcommands have no diagnostic options, call this after they are added,
/// so that they do not inherit --help-all.
void add_help_for_diagnostics(CLI::App& app);

/// Parses arguments, the first of which is the program's name, into the options declared in `app`.
/// Errors: (usage) wrong arguments; if an option is unknown, the message names the nearest one.
/// Throws CLI::Success after --help, --help-all or --version.
Result<void> parse_words(CLI::App& app, int argc, const char* const* argv);

/// Parses the arguments of main() into the options declared in `app`, whose name is the program's.
/// Returns an exit code if the program must end: 0 after --help, --help-all or --version, and 2
/// after invalid arguments, which are reported in one line. If an option is unknown, this line
/// names the nearest one. An empty value (for example an unset variable of a shell) is refused,
/// because CLI11 would treat the option as not given.
std::optional<int> parse_command_line(CLI::App& app, int argc, const char* const* argv);

/// Checks the text of an option for option_range(). Returns a message if the text is not a number
/// within the range (or not a whole one if `is_whole` is set), otherwise an empty text.
std::string why_not_within(const std::string& text, double low, double high, bool is_whole);

/// Does the complete work of main(): runs `body`, which returns an exit code, and flushes standard
/// output. SIGPIPE and SIGXFSZ are ignored, so that a closed pipe, or a file beyond the user's size
/// limit, is reported as an error of write(). An exception that reaches this function is reported
/// as a bug (exit code 1).
int run_program(const std::string& program, const std::function<int()>& body);

}  // namespace trocar
