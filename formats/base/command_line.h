// SPDX-License-Identifier: Apache-2.0
// What the programs add to CLI11, which declares and parses their options: checks of values, and
// errors in one line. The headers of CLI11 take seconds to compile, so include this header only
// where options are declared; elsewhere, CLI::App is declared in advance.
#pragma once

#include <CLI/CLI.hpp>
#include <atomic>
#include <functional>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "formats/base/result.h"

namespace trocar {

/// The group of options that only --help-all shows.
inline constexpr const char* kDiagnostics = "Diagnostics";

/// Declares --help and, unless `version` is empty, --version. Commands are added afterwards, so that
/// they have --help too; at most one of them may be given.
void add_help(CLI::App& app, const std::string& version);

/// The help shows the options that have no heading yet under this one; with "", not at all.
void set_heading(CLI::App& app, const std::string& heading);

/// Of a number. The help shows `form`, or else the range, as the form of the value. `unit` stands
/// behind the range in the message about a value out of it.
struct NumberRange {
  double low, high;
  const char* form = nullptr;
  const char* unit = "";
};

/// Refuses values that are not numbers of the range, and fractions if the option's variable is an
/// int.
CLI::Option* within(CLI::Option* option, const NumberRange& range);

/// Declares an option with a number of the range. The help shows the default, if there is one.
template <typename Number>
CLI::Option* add_number(CLI::App& app, const std::string& names, Number& value,
                        const NumberRange& range, const std::string& help) {
  CLI::Option* const option = within(app.add_option(names, value, help), range);
  return std::is_arithmetic_v<Number> ? option->capture_default_str() : option;
}

/// Refuses values for which `why_wrong` returns a text, with the message "NAME VALUE: TEXT".
CLI::Option* checked_by(CLI::Option* option,
                        const std::function<std::string(const std::string&)>& why_wrong);

/// Refuses values that are not one of `words`, which the help shows.
CLI::Option* one_of(CLI::Option* option, const std::vector<std::string>& words);

/// Declares an option with a word for each value that `variable` can get.
template <typename T>
CLI::Option* add_choice(CLI::App& app, const std::string& names, T& variable,
                        const std::vector<std::pair<std::string, T>>& words,
                        const std::string& help) {
  std::vector<std::string> all;
  all.reserve(words.size());
  for (const auto& [word, value] : words)
    all.push_back(word);
  const auto set = [&variable, words](const std::string& given) {
    for (const auto& [word, value] : words)
      if (word == given) variable = value;
  };
  return one_of(app.add_option_function<std::string>(names, set, help), all);
}

/// Declares the option `name`, whose value `set` reads. If `set` returns a text, the value is refused
/// with the message "NAME VALUE: TEXT". To take several values, one each time that the option is
/// given, call many() with the result.
CLI::Option* add_parsed(CLI::App& app, const std::string& name,
                        std::function<std::string(const std::string&)> set, const std::string& help,
                        const char* form);

/// Lets an option be given several times, with one value each time. (By itself, CLI11 lets a vector
/// take all words that follow.)
CLI::Option* many(CLI::Option* option);

/// The numbers in `text`, in their order. `pattern` is the form of the text with a # for each
/// number: "#:#" for "3:12". None: the text has another form.
template <typename T>
std::optional<std::vector<T>> numbers(const std::string& text, std::string_view pattern) {
  std::vector<T> out;
  std::istringstream in(text);
  for (const char c : pattern) {
    if (c == '#')
      in >> out.emplace_back();
    else if (in.get() != c)
      return std::nullopt;
  }
  if (in.fail() || in.peek() != std::char_traits<char>::eof()) return std::nullopt;
  return out;
}

/// The command that was given; null if none was.
const CLI::App* given_command(const CLI::App& app);

/// Parses the arguments of main(), the first of which is the program's name. They must not ask for
/// help or the version. Errors: kUsage if an argument is wrong; for an unknown option with the most
/// similar known one, if any is similar.
Result<void> parse(CLI::App& app, const std::vector<std::string>& arguments);

/// Like parse(), but also refuses spellings of former versions, empty values (for example from an
/// unset variable of a shell) and options before a command, and prints help, version and errors.
/// Returns the exit code if the program must end. An error is one line on stderr with the help that
/// explains it.
std::optional<int> parse_or_end(CLI::App& app, const std::vector<std::string>& arguments);

/// Finds a mistyped command, which CLI11 takes for an argument such as INPUT. Errors: kUsage if
/// there is no file `word`, and a command has a similar name.
Result<void> check_command(const CLI::App& app, const std::string& word);

/// Name and version of the library CLI11, for --version.
std::string command_line_library();

// What the main() of every program does besides its work: it treats signals, errors and standard
// output. The library trocar_command_line has these functions.

/// Becomes true on SIGINT, SIGTERM or SIGHUP, if stop_on_signals() has been called before. Programs
/// check this flag between two steps of their work, and end without partial output.
extern std::atomic<bool> stop_requested;
static_assert(std::atomic<bool>::is_always_lock_free);  // a signal handler sets the flag

/// Makes SIGINT, SIGTERM and SIGHUP set stop_requested instead of ending the process.
void stop_on_signals();

/// Writes "PROGRAM: MESSAGE" to stderr and returns the error's exit code.
int report_error(const std::string& program, const Error& error);

/// Does the complete work of main(): runs `body`, flushes standard output and returns the exit code
/// of `body`, or that of a failed write (finish_output()). SIGPIPE and SIGXFSZ
/// are ignored. So a write() to a closed pipe, or beyond the user's limit of file size, returns an
/// error and does not end the process. If `body` throws an exception, the exception is reported as
/// a bug (exit code 1).
int run_program(const std::string& program, const std::function<int()>& body);

}  // namespace trocar
