// SPDX-License-Identifier: Apache-2.0
// Declares and parses the command line of a program: its options, its commands (such as `list` in
// `trocar-mesh list`) and their options. The library CLI11 does the work. Of the programs' files,
// only command_line.cpp includes CLI11, because CLI11's headers take seconds to compile.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "formats/base/result.h"

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
class Option;
}  // namespace CLI

namespace trocar {

/// The variable that gets the value of an option. If an option with a vector is repeated, the
/// vector gets all values.
using OptionVariable =
    std::variant<int*, std::uint64_t*, double*, std::string*, std::filesystem::path*,
                 std::optional<int>*, std::optional<std::int64_t>*, std::optional<double>*,
                 std::vector<std::string>*, std::vector<std::filesystem::path>*>;

/// The group of options that only --help-all shows. It is for a program's own options, not for
/// those of a command.
inline constexpr const char* kDiagnostics = "Diagnostics";

/// An option of a Command. Copies stand for the same option. They must not be used after the
/// CommandLine has been destroyed. The functions that change an option return it, so that calls can
/// be chained.
class Option {
 public:
  Option() = default;  ///< no option; only is_given() may be called

  /// Refuses a command line without this option.
  Option required() const;
  /// Refuses values that are not numbers from `low` to `high`; with int, also those that are not
  /// whole. The help shows `form` after the option's name, or the range if `form` is null. `unit`
  /// stands behind the range in the message about a value out of range.
  Option within(int low, int high, const char* form = nullptr) const;
  Option within(double low, double high, const char* form = nullptr, const char* unit = "") const;
  /// Refuses values that are not one of `words`. The help shows the words.
  Option one_of(std::vector<std::string> words) const;
  /// Refuses values for which `why_wrong` returns a message instead of an empty text.
  Option checked_by(std::function<std::string(const std::string&)> why_wrong) const;
  /// The help shows the option under the heading `group`; with "", not at all.
  Option in_group(const char* group) const;
  /// The help shows `form` after the option's name as the form of the value. For an option whose
  /// variable is a number, use within() instead.
  Option with_form(const char* form) const;
  /// The help shows the variable's present value as the default.
  Option with_default_shown() const;
  /// Makes an option with a vector take one value each time that the option is given. Without this
  /// call, the option takes all words that follow, up to the next option or to "--". (This "--" is
  /// not a value.)
  Option one_value_each() const;
  /// Makes an option with a vector take two values. The option may then be given only once.
  Option two_values() const;
  /// The option may be given without a value, and its variable is then empty.
  Option with_optional_value() const;
  /// Refuses a command line with this option but not `other`.
  Option needs(const Option& other) const;
  /// Refuses a command line with both this option and `other`.
  Option excludes(const Option& other) const;

  /// Was the option in the command line? False if this object stands for no option.
  bool is_given() const;
  /// True if the option takes no value.
  bool is_flag() const;
  /// The option's name for messages: its first long name with two dashes, or else its first short
  /// name with one. For an argument, its name, such as INPUT.
  std::string name() const;
  /// The same without dashes.
  std::string bare_name() const;
  /// All long names, without dashes. There are none for an argument.
  std::vector<std::string> long_names() const;

 private:
  friend class Command;
  explicit Option(CLI::Option* option) : option_(option) {}

  CLI::Option* option_ = nullptr;
};

/// A program's own options, or a command of the program with its options. Copies stand for the same
/// command. They must not be used after the CommandLine has been destroyed.
class Command {
 public:
  /// Declares an option with a value, for example "-o,--output", or an argument, for example
  /// "INPUT". Parsing writes the value to `variable`, which must exist until then.
  template <typename Variable>
  Option option(const std::string& names, Variable& variable, const std::string& help = {}) const {
    return declare(names, &variable, help);
  }
  /// Declares an option without a value. Parsing sets `variable` if the option was given.
  Option flag(const std::string& names, bool& variable, const std::string& help) const;

  /// All declared options except --help, --version and --help-all.
  std::vector<Option> options() const;

 protected:
  explicit Command(CLI::App* app) : app_(app) {}
  CLI::App* app() const { return app_; }

 private:
  friend class CommandLine;
  Option declare(const std::string& names, OptionVariable variable, const std::string& help) const;

  CLI::App* app_;
};

/// The command line of a program. It has the option --help and, if an option is in the group
/// kDiagnostics, --help-all.
class CommandLine : public Command {
 public:
  /// `program`: its name in messages and help. `version`: what --version prints; if it is empty,
  /// there is no --version.
  CommandLine(const std::string& program, const std::string& description,
              const std::string& version);
  CommandLine(const CommandLine&) = delete;
  CommandLine& operator=(const CommandLine&) = delete;
  ~CommandLine();

  /// Declares a command. A program may have several commands; its user gives at most one of them.
  Command add_command(const std::string& name, const std::string& help);
  /// Refuses a command line without a command.
  void require_command();
  /// The text at the end of the help.
  void set_footer(const std::string& text);
  /// First column of the descriptions in the help, for all commands.
  void set_help_column(std::size_t column);

  std::vector<std::string> command_names() const;
  /// The command that was given; empty if none was.
  std::string chosen_command() const;

  /// Parses the arguments of main(), the first of which is the program's name. They must not ask
  /// for help or the version. Errors: kUsage if an argument is wrong. If an option is unknown, the
  /// message suggests the known option with the most similar name, if any name is similar.
  Result<void> parse(const std::vector<std::string>& arguments);

  /// Like parse(), but also prints help, version and errors, so that main() need not. Returns an
  /// exit code if the program must end, else nullopt. The exit code is 0 after --help, --help-all
  /// or --version. After invalid arguments it is 2, and one line on stderr says what is wrong and
  /// names the help that explains it: that of the program or that of a command. An empty value (for
  /// example from an unset variable of a shell) is also refused, without naming a help, because
  /// CLI11 would treat its option as not given.
  std::optional<int> parse_or_end(const std::vector<std::string>& arguments);

 private:
  explicit CommandLine(std::unique_ptr<CLI::App> app);

  std::unique_ptr<CLI::App> owned_;
};

/// Name and version of the library CLI11, for --version.
std::string command_line_library();

}  // namespace trocar
