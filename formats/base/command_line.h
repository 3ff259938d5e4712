// SPDX-License-Identifier: Apache-2.0
// Functions for the main() of every program: they treat the command line, standard output, signals
// and errors. These functions are a separate library (trocar_command_line), so that the library
// trocar_formats does not need CLI11.
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

/// Becomes true on SIGINT, SIGTERM or SIGHUP, if stop_on_signals() has been called before. Programs
/// check this flag between two steps of their work, and end without partial output.
extern std::atomic<bool> stop_requested;
static_assert(std::atomic<bool>::is_always_lock_free);  // a signal handler sets the flag

/// Makes SIGINT, SIGTERM and SIGHUP set stop_requested instead of ending the process.
void stop_on_signals();

/// Writes "PROGRAM: MESSAGE" to stderr and returns the error's exit code.
int report_error(const std::string& program, const Error& error);

/// Declares --help and --version. `version` is the text that --version prints. Precondition: `app`
/// has no subcommands yet, because a subcommand copies --help from `app` at the moment when the
/// subcommand is added.
void add_help_and_version(CLI::App& app, const std::string& version);

/// Name of the CLI11 group for options that only --help-all shows.
inline constexpr const char* kDiagnostics = "Diagnostics";

/// Declares --help-all. If the subcommands of `app` have no options of the group kDiagnostics, add
/// the subcommands before this call, so that no subcommand inherits --help-all.
void add_help_for_diagnostics(CLI::App& app);

/// Parses arguments into the options declared in `app`. argv[0] is the program's name. Errors:
/// kUsage if an argument is wrong. If an option is unknown, the message suggests the known option
/// with the most similar name, if any name is similar. Throws a CLI::Success after --help,
/// --help-all or --version.
Result<void> parse_words(CLI::App& app, int argc, const char* const* argv);

/// Parses the arguments of main() into the options declared in `app`. Precondition: the name of
/// `app` is the program's name. Returns an exit code if the program must end, else nullopt. The
/// exit code is 0 after --help, --help-all or --version. After invalid arguments it is 2, and one
/// line on stderr says what is wrong. An empty value (for example from an unset variable of a
/// shell) is refused, because CLI11 would treat its option as not given.
std::optional<int> parse_command_line(CLI::App& app, int argc, const char* const* argv);

/// Checks the value of an option, for option_range(). Returns a message if `text` is not a
/// number from `low` to `high`, or if `is_whole` is set and the number is not whole. Otherwise
/// returns an empty text.
std::string why_not_within(const std::string& text, double low, double high, bool is_whole);

/// Does the complete work of main(): runs `body`, which returns an exit code, and passes this code
/// to finish_output(). SIGPIPE and SIGXFSZ are ignored. So a write() to a closed pipe, or beyond
/// the user's limit of file size, returns an error and does not end the process. If `body` throws
/// an exception, the exception is reported as a bug (exit code 1).
int run_program(const std::string& program, const std::function<int()>& body);

}  // namespace trocar
