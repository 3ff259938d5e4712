// SPDX-License-Identifier: Apache-2.0
// How all programs treat their command line, standard output, signals and errors. A separate
// library (trocar_command_line), so that trocar_formats does not need CLI11.
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
/// between two steps of its work, so that it ends in good order and leaves no partial output.
extern std::atomic<bool> stop_requested;
static_assert(std::atomic<bool>::is_always_lock_free);  // it is set in a signal handler

/// Makes these signals set stop_requested instead of ending the process.
void stop_on_signals();

/// Writes "PROGRAM: MESSAGE" to stderr and returns the error's exit code.
int report_error(const std::string& program, const Error& error);

/// Declares --help and --version. Call it before subcommands are added, because they take over
/// --help. `version` is the text that --version prints.
void add_help_and_version(CLI::App& app, const std::string& version);

/// CLI11 group of options that only --help-all shows.
inline constexpr const char* kDiagnostics = "Diagnostics";

/// Declares --help-all. Call it after subcommands are added, unless they have such options too.
void add_help_for_diagnostics(CLI::App& app);

/// Reads words, the first of which is the program's name, into what was declared to `app`. Errors
/// (usage) name the nearest option if one is unknown. Throws CLI::Success after --help, --help-all
/// and --version.
Result<void> parse_words(CLI::App& app, int argc, const char* const* argv);

/// Reads the arguments of main() into what was declared to `app`, whose name is the program's.
/// Returns the exit code if the program is to end: 0 after --help, --help-all and --version; 2
/// after invalid arguments, which are reported in one line, with the nearest option's name if an
/// option is unknown. An empty value (an unset variable of a shell) is refused, because CLI11 would
/// treat the option as not given.
std::optional<int> parse_command_line(CLI::App& app, int argc, const char* const* argv);

/// The message about an option's text that is no number, or none within the range; empty if it is
/// one. For option_range().
std::string why_not_within(const std::string& text, double low, double high, bool is_whole);

/// Does all that main() has to do: runs `body`, which returns an exit code, and flushes standard
/// output.
/// SIGPIPE and SIGXFSZ are ignored, so that a closed pipe or a file beyond the user's size limit is
/// an error of write(). An exception that reaches this function is reported as a bug (exit code 1).
int run_program(const std::string& program, const std::function<int()>& body);

}  // namespace trocar
