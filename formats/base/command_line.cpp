// SPDX-License-Identifier: Apache-2.0
#include "formats/base/command_line.h"

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <exception>
#include <filesystem>

#include "formats/base/files.h"
#include "formats/base/text.h"

namespace trocar {
namespace {

/// What was spelt otherwise in a former version. An option is refused anywhere, a command only as the
/// first word and if no file has its name.
struct FormerSpelling {
  std::string_view program, former, now;
};
constexpr FormerSpelling kFormerSpellings[] = {
    {"trocar-run", "--check", "trocar-run check SCENE"},
    {"trocar-run", "--new-scene", "trocar-run new-scene ASSET -o SCENE"},
    {"trocar-run", "--test", "trocar-run test --device DEVICE"},
    {"trocar-run", "--replay", "trocar-run replay SCENE RECORDING"},
    {"trocar-run", "--history", "trocar-run history FOLDER -o PAGE"},
    {"trocar-run", "--explain", "trocar-run procedures [PROCEDURE]"},
    {"trocar-run", "fit", "the program trocar-fit (package trocar-tools)"},
    {"trocar-run", "export", "the program trocar-hdf5 (package trocar-tools)"},
    {"trocar-mesh", "fetch", "the script get-study (archive.md)"},
    {"trocar-mesh", "receive", "the script orthanc-hook (archive.md)"}};

/// The option's name for messages, such as --output or, for an argument, INPUT.
std::string name_of(const CLI::Option& option) {
  // CLI11's get_name() is empty for an option that the help hides.
  if (!option.get_lnames().empty()) return "--" + option.get_lnames().front();
  if (!option.get_snames().empty()) return "-" + option.get_snames().front();
  return option.get_single_name();
}

bool is_given(const CLI::Option* option) {
  return option->count() > 0;
}

bool is_file(std::string_view name) {
  std::error_code ignored;
  return std::filesystem::exists(name, ignored);
}

/// A message about the first empty value, which CLI11 would take for an option that is not given.
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

std::string former_spelling(const std::string& program, const std::vector<std::string>& arguments) {
  for (std::size_t i = 1; i < arguments.size() && arguments[i] != "--"; ++i) {
    const std::string word = arguments[i].substr(0, arguments[i].find('='));
    for (const auto& [owner, former, now] : kFormerSpellings)
      if (program == owner && word == former &&
          (word.starts_with('-') || (i == 1 && !is_file(word))))
        return word + ": is now " + std::string(now);
  }
  return {};
}

/// The program or command that was given the first argument that no option took.
const CLI::App& owner_of_unexpected(const CLI::App& app) {
  const CLI::App* const command = given_command(app);
  return command == nullptr || !app.remaining(false).empty() ? app : *command;
}

/// A message about the first argument that no option took.
std::string unexpected_argument(const CLI::App& app) {
  const std::vector<std::string> rest = app.remaining(true);
  const std::string argument = rest.empty() ? "" : rest.front();
  const auto is_named = [&](const CLI::App* command) { return command->get_name() == argument; };
  if (given_command(app) != nullptr && !app.get_subcommands(is_named).empty())
    return argument + ": is a second command; give only one";
  std::vector<std::string> names;
  for (const CLI::Option* option : owner_of_unexpected(app).get_options())
    for (const std::string& name : option->get_lnames())
      names.push_back("--" + name);
  return "not expected: " + argument + did_you_mean(argument.substr(0, argument.find('=')), names);
}

/// A message if `text` is not a number.
std::string not_a_number(const std::string& text, bool is_whole) {
  double value = 0;
  if (CLI::detail::lexical_cast(text, value) && !std::isnan(value) &&
      (!is_whole || value == std::floor(value)))
    return {};
  return text + " is not a " + (is_whole ? "whole " : "") + "number";
}

bool takes_whole(const CLI::Option& option) {
  return option.get_type_name().starts_with("INT") || option.get_type_name().starts_with("UINT");
}

/// A message about the first value that is not a number although its option takes one.
std::string no_number(const CLI::App& app) {
  for (const CLI::Option* option : app.get_options()) {
    if (!takes_whole(*option) && !option->get_type_name().starts_with("FLOAT")) continue;
    for (const std::string& text : option->results())
      if (const std::string wrong = not_a_number(text, takes_whole(*option)); !wrong.empty())
        return name_of(*option) + ": " + wrong;
  }
  return {};
}

/// Precedes the message of refuse(), to which CLI11 adds the option's name once more.
constexpr char kRefusal = '\x1f';

/// The message of a check that refuses `text` as the value of an option.
std::string refuse(const std::string& option, const std::string& text, const std::string& why) {
  return kRefusal + option + " " + text + ": " + why;
}

/// Rewrites CLI11's messages about a missing value, about an option that is given twice, and those
/// of refuse(), in the style of the programs' own messages.
std::string plain_words(const std::string& message) {
  if (const auto missing = match(message, "(-[^ :]+): 1 required .* missing"); !missing.empty())
    return missing[1] + ": its value is missing";
  if (const auto twice = match(message, "(-[^ :]+): At Most 1 required but received .*");
      !twice.empty())
    return twice[1] + ": may be given only once";
  const std::size_t refusal = message.find(kRefusal);
  return refusal == message.npos ? message : message.substr(refusal + 1);
}

/// Why a command line is wrong, and the program or command whose help explains it.
struct Refusal {
  std::string message;
  const CLI::App* explained_by;
};

/// Throws CLI::Success if the arguments ask for help or the version.
std::optional<Refusal> parse_arguments(CLI::App& app, const std::vector<std::string>& arguments) {
  std::vector<std::string> words;  // CLI11 takes the last word first
  if (!arguments.empty()) words.assign(arguments.rbegin(), arguments.rend() - 1);
  const auto unexpected = [&app] {
    return Refusal{unexpected_argument(app), &owner_of_unexpected(app)};
  };
  const auto explainer = [&app] {
    const CLI::App* const command = given_command(app);
    return command == nullptr ? &app : command;
  };
  try {
    app.parse(std::move(words));
    return std::nullopt;
  } catch (const CLI::Success&) {
    throw;
  } catch (const CLI::ExtrasError&) {
    return unexpected();
  } catch (const CLI::RequiredError& error) {
    const std::vector<std::string> rest = app.remaining(true);
    const bool may_be_misspelt = !rest.empty() && rest.front().starts_with("--");
    return may_be_misspelt ? unexpected() : Refusal{error.what(), explainer()};
  } catch (const CLI::ParseError& error) {
    const std::string wrong = no_number(*explainer());
    return Refusal{wrong.empty() ? plain_words(error.what()) : wrong, explainer()};
  }
}

std::vector<CLI::Option*> diagnostics_of(CLI::App& app) {
  return app.get_options([](const CLI::Option* o) { return o->get_group() == kDiagnostics; });
}

}  // namespace

void add_help(CLI::App& app, const std::string& version) {
  app.set_help_flag("-h,--help", "print this help");
  if (!version.empty()) {
    app.set_version_flag("--version", version,
                         "print the versions of the program and its libraries");
  }
  app.require_subcommand(0, 1);
}

void set_heading(CLI::App& app, const std::string& heading) {
  for (CLI::Option* option : app.get_options())
    if (option->get_group() == "Options" && option != app.get_help_ptr() &&
        option != app.get_version_ptr())
      option->group(heading);
}

/// So many digits that a whole number is written out, and 0.07 as 0.07.
int digits(double value) {
  return value == std::floor(value) ? 17 : 15;
}

// CLI::Range is not used, because its messages, and whether it accepts nan, differ between versions
// of CLI11.
CLI::Option* within(CLI::Option* option, const NumberRange& range) {
  const bool is_whole = takes_whole(*option);
  const auto why = [range, is_whole, name = name_of(*option)](const std::string& text) {
    const auto [low, high, form, unit] = range;
    std::string wrong = not_a_number(text, is_whole);
    double value = 0;
    if (wrong.empty() && CLI::detail::lexical_cast(text, value) && !(value >= low && value <= high))
      wrong = refuse(name, text,
                     text_line("must be within %.*g and %.*g%s%s", digits(low), low, digits(high),
                               high, *unit == '\0' ? "" : " ", unit));
    return wrong;
  };
  const std::string form =
      range.form != nullptr ? range.form : text_line("%.15g..%.15g", range.low, range.high);
  return option->check(why)->type_name(form);
}

CLI::Option* checked_by(CLI::Option* option,
                        const std::function<std::string(const std::string&)>& why_wrong) {
  return option->check([name = name_of(*option), why_wrong](const std::string& text) {
    const std::string why = why_wrong(text);
    return why.empty() ? why : refuse(name, text, why);
  });
}

CLI::Option* one_of(CLI::Option* option, const std::vector<std::string>& words) {
  std::string form, list;
  for (const std::string& word : words) {
    form += (form.empty() ? "" : "|") + word;
    list += (list.empty() ? "" : &word == &words.back() ? " or " : ", ") + word;
  }
  const auto why = [words, list](const std::string& text) {
    const bool is_known = std::find(words.begin(), words.end(), text) != words.end();
    return is_known ? "" : "must be " + list;
  };
  return checked_by(option, why)->type_name(form);
}

CLI::Option* add_parsed(CLI::App& app, const std::string& name,
                        std::function<std::string(const std::string&)> set, const std::string& help,
                        const char* form) {
  const auto read = [name, set = std::move(set)](const std::vector<std::string>& values) {
    for (const std::string& value : values)
      if (const std::string why = set(value); !why.empty())
        throw CLI::ValidationError(name, refuse(name, value, why));
  };
  return app.add_option_function<std::vector<std::string>>(name, read, help)
      ->expected(1)
      ->type_name(form);
}

CLI::Option* many(CLI::Option* option) {
  return option->expected(CLI::detail::expected_max_vector_size)->allow_extra_args(false);
}

const CLI::App* given_command(const CLI::App& app) {
  const std::vector<CLI::App*> commands = app.get_subcommands();
  return commands.empty() ? nullptr : commands.front();
}

Result<void> parse(CLI::App& app, const std::vector<std::string>& arguments) {
  if (const auto refusal = parse_arguments(app, arguments)) return usage(refusal->message);
  return {};
}

std::optional<int> parse_or_end(CLI::App& app, const std::vector<std::string>& arguments) {
  const std::string program = app.get_name();
  for (const std::string& wrong : {empty_value(arguments), former_spelling(program, arguments)})
    if (!wrong.empty()) return report_error(program, usage(wrong));
  std::vector<CLI::App*> all = app.get_subcommands([](const CLI::App*) { return true; });
  all.push_back(&app);
  for (CLI::App* each : all)
    if (!diagnostics_of(*each).empty())
      each->set_help_all_flag("--help-all", "print this help with the options for diagnostics");
  const auto print_help = [&app, &all](bool with_diagnostics) {
    for (CLI::App* each : all) {
      for (CLI::Option* option : each->get_options())
        if (option->get_positional() && !option->nonpositional()) option->type_name("");
      for (CLI::Option* option : diagnostics_of(*each))
        if (!with_diagnostics) option->group("");
    }
    std::fputs(app.help().c_str(), stdout);
    return 0;
  };
  try {
    if (const auto refusal = parse_arguments(app, arguments)) {
      const CLI::App& by = *refusal->explained_by;
      const std::string page = &by == &app ? program : program + " " + by.get_name();
      return report_error(program, usage(refusal->message + " (see " + page + " --help)"));
    }
  } catch (const CLI::CallForHelp&) {
    return print_help(false);
  } catch (const CLI::CallForAllHelp&) {
    return print_help(true);
  } catch (const CLI::CallForVersion& version) {
    std::puts(version.what());
    return 0;
  }
  const CLI::App* const command = given_command(app);
  if (command == nullptr) return std::nullopt;
  const std::vector<const CLI::Option*> options = std::as_const(app).get_options();
  const auto before = std::find_if(options.begin(), options.end(), is_given);
  if (before == options.end()) return std::nullopt;
  return report_error(program, usage(command->get_name() + ": is a command of its own; leave " +
                                     name_of(**before) + " out"));
}

Result<void> check_command(const CLI::App& app, const std::string& word) {
  std::vector<std::string> names;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; }))
    names.push_back(command->get_name());
  const std::string meant = word.find('/') == word.npos ? did_you_mean(word, names) : "";
  if (meant.empty() || is_file(word)) return {};
  return usage(word + ": no such file, folder or command" + meant);
}

std::string command_line_library() {
  return "CLI11 " CLI11_VERSION;
}

std::atomic<bool> stop_requested{false};

void stop_on_signals() {
  struct sigaction action {};
  action.sa_handler = [](int) { stop_requested.store(true); };
  for (const int signal : {SIGINT, SIGTERM, SIGHUP})
    ::sigaction(signal, &action, nullptr);
}

int report_error(const std::string& program, const Error& error) {
  print(stderr, "%s: %s\n", program, error.message);
  return static_cast<int>(error.code);
}

int run_program(const std::string& program, const std::function<int()>& body) {
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  try {
    return finish_output(program.c_str(), body());
  } catch (const std::exception& failure) {
    return report_error(program, bug(std::string("internal error: ") + failure.what()));
  }
}

}  // namespace trocar
