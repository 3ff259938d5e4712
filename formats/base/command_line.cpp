// SPDX-License-Identifier: Apache-2.0
#include "formats/base/command_line.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "formats/base/nearest_name.h"
#include "formats/base/program.h"
#include "formats/base/text_pattern.h"

namespace trocar {
namespace {

/// A message about the first empty value; empty if there is none.
std::string empty_value(const std::vector<std::string>& arguments) {
  for (std::size_t i = 1; i < arguments.size(); ++i) {
    const std::string &argument = arguments[i], &before = arguments[i - 1];
    if (argument.empty())
      return before.starts_with('-') ? before + ": its value is empty" : "an argument is empty";
    if (argument.starts_with("--") && argument.find('=') == argument.size() - 1)
      return argument.substr(0, argument.size() - 1) + ": its value is empty";
  }
  return {};
}

/// The option's name for messages. CLI11's get_name() is empty for an option that the help hides.
std::string name_of(const CLI::Option& option) {
  if (!option.get_lnames().empty()) return "--" + option.get_lnames().front();
  if (!option.get_snames().empty()) return "-" + option.get_snames().front();
  return option.get_single_name();
}

/// The given command; the program itself if there is none.
const CLI::App& given_command(const CLI::App& app) {
  return app.get_subcommands().empty() ? app : *app.get_subcommands().front();
}

/// The program or command that was given the first argument that no option took.
const CLI::App& owner_of_unexpected(const CLI::App& app) {
  return app.remaining(false).empty() ? given_command(app) : app;
}

/// A message about the first argument that no option took, with the option that may have been
/// meant.
std::string unexpected_argument(const CLI::App& app) {
  const std::vector<std::string> rest = app.remaining(true);
  const std::string argument = rest.empty() ? "" : rest.front();
  const auto is_named = [&](const CLI::App* command) { return command->get_name() == argument; };
  if (!app.get_subcommands().empty() && !app.get_subcommands(is_named).empty())
    return argument + ": is a second command; give only one";
  std::vector<std::string> names;
  for (const CLI::Option* option : owner_of_unexpected(app).get_options()) {
    for (const std::string& name : option->get_lnames())
      names.push_back("--" + name);
  }
  return "not expected: " + argument + did_you_mean(argument.substr(0, argument.find('=')), names);
}

std::string not_a_number(const std::string& text, bool is_whole) {
  return text + " is not a " + (is_whole ? "whole " : "") + "number";
}

/// A message about the first value that is not a number although its option takes one; empty if
/// there is none.
std::string no_number(const CLI::App& app) {
  for (const CLI::Option* option : given_command(app).get_options()) {
    const std::string type = option->get_type_name();
    const bool is_whole = type.starts_with("INT") || type.starts_with("UINT");
    if (!is_whole && !type.starts_with("FLOAT")) continue;
    for (const std::string& text : option->results()) {
      double value = 0;
      if (!CLI::detail::lexical_cast(text, value) || (is_whole && value != std::floor(value)))
        return name_of(*option) + ": " + not_a_number(text, is_whole);
    }
  }
  return {};
}

/// Writes a list for messages: "a,b,c" becomes "a, b or c", and "a,b" becomes "a or b".
std::string alternatives(std::string list) {
  const std::size_t last = list.rfind(',');
  if (last != std::string::npos) list.replace(last, 1, " or ");
  for (std::size_t at = 0; (at = list.find(',', at)) != std::string::npos; at += 2)
    list.replace(at, 1, ", ");
  return list;
}

/// The number without trailing zeros after the decimal point.
std::string shown(double number, bool is_whole) {
  if (is_whole) return std::to_string(static_cast<long long>(number));
  std::string text = std::to_string(number);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

/// Rewrites CLI11's messages about a missing value, about an option that is given twice and about a
/// word outside a list, and those of why_not_within(), in the style of the programs' own messages.
/// Other messages stay unchanged.
std::string plain_words(const std::string& message) {
  if (const auto missing = match(message, "(-[^ :]+): 1 required .* missing"); !missing.empty())
    return missing[1] + ": its value is missing";
  if (const auto twice = match(message, "(-[^ :]+): At Most 1 required but received .*");
      !twice.empty())
    return twice[1] + ": may be given only once";
  if (const auto word = match(message, R"((-[^ :]+): (.*) not in \{(.*)\})"); !word.empty())
    return word[1] + " " + word[2] + ": must be " + alternatives(word[3]);
  if (const auto range = match(message, "(-[^ :]+): (.*: must be within .*)"); !range.empty())
    return range[1] + " " + range[2];
  return message;
}

/// Was an unknown option given? It may be the required option, misspelt.
bool has_unknown_option(const CLI::App& app) {
  const std::vector<std::string> rest = app.remaining(true);
  return !rest.empty() && rest.front().starts_with("--");
}

/// Why a command line is wrong, and the program or command whose help explains it.
struct Refusal {
  std::string message;
  const CLI::App* explained_by;
};

/// Parses the arguments of main(). Throws CLI::Success if they ask for help or the version.
std::optional<Refusal> parse_arguments(CLI::App& app, const std::vector<std::string>& arguments) {
  std::vector<std::string> words;  // CLI11 takes the last word first
  if (!arguments.empty()) words.assign(arguments.rbegin(), arguments.rend() - 1);
  try {
    app.parse(std::move(words));
    return std::nullopt;
  } catch (const CLI::Success&) {
    throw;
  } catch (const CLI::ExtrasError&) {
    return Refusal{unexpected_argument(app), &owner_of_unexpected(app)};
  } catch (const CLI::RequiredError& error) {
    if (!has_unknown_option(app)) return Refusal{error.what(), &given_command(app)};
    return Refusal{unexpected_argument(app), &owner_of_unexpected(app)};
  } catch (const CLI::ParseError& error) {
    const std::string wrong = no_number(app);
    return Refusal{wrong.empty() ? plain_words(error.what()) : wrong, &given_command(app)};
  }
}

/// A message if `text` is not a number from `low` to `high`, or if `is_whole` is set and the number
/// is not whole; else an empty text.
std::string why_not_within(const std::string& text, double low, double high, bool is_whole,
                           const std::string& unit) {
  double value = 0;
  const bool is_number = CLI::detail::lexical_cast(text, value) && !std::isnan(value);
  if (!is_number || (is_whole && value != std::floor(value))) return not_a_number(text, is_whole);
  if (value >= low && value <= high) return {};
  return text + ": must be within " + shown(low, is_whole) + " and " + shown(high, is_whole) +
         (unit.empty() ? "" : " " + unit);
}

/// Makes the option take numbers from `low` to `high`. CLI::Range is not used, because its
/// messages, and whether it accepts nan, differ between versions of CLI11.
void limit(CLI::Option& option, double low, double high, bool is_whole, const char* form,
           const char* unit) {
  option.check([low, high, is_whole, unit = std::string(unit)](const std::string& text) {
    return why_not_within(text, low, high, is_whole, unit);
  });
  option.type_name(form != nullptr ? form : shown(low, is_whole) + ".." + shown(high, is_whole));
}

}  // namespace

Option Option::required() const {
  option_->required();
  return *this;
}

Option Option::within(int low, int high, const char* form) const {
  limit(*option_, low, high, true, form, "");
  return *this;
}

Option Option::within(double low, double high, const char* form, const char* unit) const {
  limit(*option_, low, high, false, form, unit);
  return *this;
}

Option Option::one_of(std::vector<std::string> words) const {
  std::string form;
  for (const std::string& word : words)
    form += (form.empty() ? "" : "|") + word;
  option_->check(CLI::IsMember(std::move(words)).description(""))->type_name(form);
  return *this;
}

Option Option::checked_by(std::function<std::string(const std::string&)> why_wrong) const {
  option_->check(std::move(why_wrong));
  return *this;
}

Option Option::in_group(const char* group) const {
  option_->group(group);
  return *this;
}

Option Option::with_form(const char* form) const {
  option_->type_name(form);
  return *this;
}

Option Option::with_default_shown() const {
  option_->capture_default_str();
  return *this;
}

Option Option::one_value_each() const {
  option_->allow_extra_args(false);
  return *this;
}

Option Option::two_values() const {
  option_->type_size(2)->expected(1)->allow_extra_args(false);
  return *this;
}

Option Option::with_optional_value() const {
  option_->expected(0, 1);
  return *this;
}

Option Option::needs(const Option& other) const {
  option_->needs(other.option_);
  return *this;
}

Option Option::excludes(const Option& other) const {
  option_->excludes(other.option_);
  return *this;
}

bool Option::is_given() const {
  return option_ != nullptr && option_->count() > 0;
}

bool Option::is_flag() const {
  return option_->get_items_expected_max() == 0;
}

std::string Option::name() const {
  return name_of(*option_);
}

std::string Option::bare_name() const {
  const std::string name = name_of(*option_);
  return name.substr(std::min(name.find_first_not_of('-'), name.size()));
}

std::vector<std::string> Option::long_names() const {
  return option_->get_lnames();
}

Option Command::declare(const std::string& names, OptionVariable variable,
                        const std::string& help) const {
  CLI::Option* option =
      std::visit([&](auto* value) { return app_->add_option(names, *value, help); }, variable);
  // The help shows an argument by its name alone.
  if (!names.starts_with('-')) option->type_name("");
  return Option(option);
}

Option Command::flag(const std::string& names, bool& variable, const std::string& help) const {
  return Option(app_->add_flag(names, variable, help));
}

std::vector<Option> Command::options() const {
  std::vector<Option> out;
  for (CLI::Option* option : app_->get_options()) {
    if (option != app_->get_help_ptr() && option != app_->get_help_all_ptr() &&
        option != app_->get_version_ptr())
      out.push_back(Option(option));
  }
  return out;
}

CommandLine::CommandLine(const std::string& program, const std::string& description,
                         const std::string& version)
    : CommandLine(std::make_unique<CLI::App>(description, program)) {
  app()->set_help_flag("-h,--help", "print this help");
  if (!version.empty()) {
    app()->set_version_flag("--version", version,
                            "print the versions of the program and its libraries");
  }
  app()->require_subcommand(0, 1);
}

CommandLine::CommandLine(std::unique_ptr<CLI::App> app)
    : Command(app.get()), owned_(std::move(app)) {}

CommandLine::~CommandLine() = default;

Command CommandLine::add_command(const std::string& name, const std::string& help) {
  return Command(app()->add_subcommand(name, help));
}

void CommandLine::set_footer(const std::string& text) {
  app()->footer(text);
}

void CommandLine::set_help_column(std::size_t column) {
  app()->get_formatter()->column_width(column);  // which all commands share
}

std::vector<std::string> CommandLine::command_names() const {
  std::vector<std::string> out;
  for (const CLI::App* command : app()->get_subcommands([](const CLI::App*) { return true; }))
    out.push_back(command->get_name());
  return out;
}

std::string CommandLine::chosen_command() const {
  const std::vector<CLI::App*> commands = app()->get_subcommands();
  return commands.empty() ? "" : commands.front()->get_name();
}

Result<void> CommandLine::parse(const std::vector<std::string>& arguments) {
  if (const auto refusal = parse_arguments(*app(), arguments)) return usage(refusal->message);
  return {};
}

std::optional<int> CommandLine::parse_or_end(const std::vector<std::string>& arguments) {
  const std::string program = app()->get_name();
  if (const std::string wrong = empty_value(arguments); !wrong.empty())
    return report_error(program, usage(wrong));
  std::vector<CLI::Option*> diagnostics;
  for (CLI::Option* option : app()->get_options()) {
    if (option->get_group() == kDiagnostics) diagnostics.push_back(option);
  }
  if (!diagnostics.empty()) {
    app()->set_help_all_flag("--help-all", "print this help with the options for diagnostics");
  }
  try {
    if (const auto refusal = parse_arguments(*app(), arguments)) {
      const CLI::App& by = *refusal->explained_by;
      const std::string page = &by == app() ? program : program + " " + by.get_name();
      return report_error(program, usage(refusal->message + " (see " + page + " --help)"));
    }
  } catch (const CLI::CallForHelp&) {
    for (CLI::Option* option : diagnostics)
      option->group("");
    std::fputs(app()->help().c_str(), stdout);
    return 0;
  } catch (const CLI::CallForAllHelp&) {
    std::fputs(app()->help().c_str(), stdout);
    return 0;
  } catch (const CLI::CallForVersion& version) {
    std::puts(version.what());
    return 0;
  }
  return std::nullopt;
}

std::string command_line_library() {
  return "CLI11 " CLI11_VERSION;
}

}  // namespace trocar
