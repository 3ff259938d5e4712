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

/// Set by SIGINT, SIGTERM and SIGHUP once stop_on_signals() has been called. A program checks this
/// flag between two steps of its work, so that the program ends cleanly without partial output.
extern std::atomic<bool> stop_requested;
static_assert(std::atomic<bool>::is_always_lock_free);  // set in a signal handler

/// Makes SIGINT, SIGTERM and SIGHUP set stop_requested instead of ending the process.
void stop_on_signals();

/// Writes "PROGRAM: MESSAGE" to stderr and returns the error's exit code.
int report_error(const std::string& program, const Error& error);

/// Declares --help and --version. Precondition: `app` has no subcommands yet, because a subcommand
/// inherits --help at the time it is added. `version` is the text that --version prints.
void add_help_and_version(CLI::App& app, const std::string& version);

/// Name of the CLI11 group for options that only --help-all shows.
inline constexpr const char* kDiagnostics = "Diagnostics";

/// Declares --help-all. If the subcommands have no diagnostic options, add the subcommands
/// before this call, so that they do not inherit --help-all.
void add_help_for_diagnostics(CLI::App& app);

/// Parses arguments into the options declared in `app`. argv[0] is the program's name. Errors:
/// kUsage if an argument is wrong; if an option is unknown, the message suggests the known option
/// with the most similar name. Throws CLI::Success after --help, --help-all or --version.
Result<void> parse_words(CLI::App& app, int argc, const char* const* argv);

/// Parses the arguments of main() into the options declared in `app`. The name of `app` must be the
/// program's name. Returns an exit code if the program must end: 0 after --help, --help-all or
/// --version, and 2 after invalid arguments, which are reported in one line like the errors of
/// parse_words(). An empty value (for example from an unset variable of a shell) is refused,
/// because CLI11 would treat its option as not given.
std::optional<int> parse_command_line(CLI::App& app, int argc, const char* const* argv);

/// Checks the value of an option; called by option_range(). Returns a message if `text` is not a
/// number from `low` to `high`, or if `is_whole` is set and the number is not whole. Otherwise
/// returns an empty text.
std::string why_not_within(const std::string& text, double low, double high, bool is_whole);

/// Does the complete work of main(): runs `body`, which returns an exit code, and flushes standard
/// output. SIGPIPE and SIGXFSZ are ignored, so that a closed pipe, or a file beyond the user's size
/// limit, is reported as an error of write(). An exception that reaches this function is reported
/// as a bug (exit code 1).
int run_program(const std::string& program, const std::function<int()>& body);

}  // namespace trocar
