// SPDX-License-Identifier: Apache-2.0
#include "formats/base/command_line.h"

#include <CLI/CLI.hpp>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "formats/base/nearest_name.h"
#include "formats/base/standard_output.h"
#include "formats/base/text_pattern.h"

namespace trocar {
namespace {

/// A message about the first empty value; empty if there is none.
std::string empty_value(int argc, const char* const* argv) {
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i], before = argv[i - 1];
    if (argument.empty())
      return before.starts_with('-') ? before + ": its value is empty" : "an argument is empty";
    if (argument.starts_with("--") && argument.find('=') == argument.size() - 1)
      return argument.substr(0, argument.size() - 1) + ": its value is empty";
  }
  return {};
}

/// A message about the first argument that no option took, with the option that may have been
/// meant.
std::string unexpected_argument(const CLI::App& app) {
  const std::vector<std::string> rest = app.remaining(true);
  const std::string argument = rest.empty() ? "" : rest.front();
  const CLI::App& command = app.get_subcommands().empty() ? app : *app.get_subcommands().front();
  std::vector<std::string> names;
  for (const CLI::Option* option : command.get_options()) {
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
  const CLI::App& command = app.get_subcommands().empty() ? app : *app.get_subcommands().front();
  for (const CLI::Option* option : command.get_options()) {
    const std::string type = option->get_type_name();
    const bool is_whole = type.starts_with("INT") || type.starts_with("UINT");
    if (!is_whole && !type.starts_with("FLOAT")) continue;
    for (const std::string& text : option->results()) {
      double value = 0;
      if (!CLI::detail::lexical_cast(text, value) || (is_whole && value != std::floor(value)))
        return option->get_name() + ": " + not_a_number(text, is_whole);
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

/// Rewrites CLI11's messages about a missing value and about a word outside a list, and those of
/// option_range(), in the style of the programs' own messages. Other messages stay unchanged.
std::string plain_words(const std::string& message) {
  if (const auto missing = match(message, "(-[^ :]+): 1 required .* missing"); !missing.empty())
    return missing[1] + ": its value is missing";
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

}  // namespace

std::atomic<bool> stop_requested{false};

void stop_on_signals() {
  struct sigaction action {};
  action.sa_handler = [](int) { stop_requested.store(true); };
  for (const int signal : {SIGINT, SIGTERM, SIGHUP})
    ::sigaction(signal, &action, nullptr);
}

int report_error(const std::string& program, const Error& error) {
  std::fprintf(stderr, "%s: %s\n", program.c_str(), error.message.c_str());
  return static_cast<int>(error.code);
}

std::string why_not_within(const std::string& text, double low, double high, bool is_whole) {
  double value = 0;
  const bool is_number = CLI::detail::lexical_cast(text, value) && !std::isnan(value);
  if (!is_number || (is_whole && value != std::floor(value))) return not_a_number(text, is_whole);
  if (value >= low && value <= high) return {};
  return text + ": must be within " + shown(low, is_whole) + " and " + shown(high, is_whole);
}

void add_help_and_version(CLI::App& app, const std::string& version) {
  app.set_help_flag("-h,--help", "print this help");
  app.set_version_flag("--version", version, "print the versions of the program and its libraries");
}

void add_help_for_diagnostics(CLI::App& app) {
  app.set_help_all_flag("--help-all", "print this help with the options for diagnostics");
}

Result<void> parse_words(CLI::App& app, int argc, const char* const* argv) {
  try {
    app.parse(argc, argv);
    return {};
  } catch (const CLI::Success&) {
    throw;
  } catch (const CLI::ExtrasError&) {
    return usage(unexpected_argument(app));
  } catch (const CLI::RequiredError& error) {
    return usage(has_unknown_option(app) ? unexpected_argument(app) : error.what());
  } catch (const CLI::ParseError& error) {
    const std::string wrong = no_number(app);
    return usage(wrong.empty() ? plain_words(error.what()) : wrong);
  }
}

std::optional<int> parse_command_line(CLI::App& app, int argc, const char* const* argv) {
  const std::string program = app.get_name();
  if (const std::string wrong = empty_value(argc, argv); !wrong.empty())
    return report_error(program, usage(wrong));
  try {
    if (auto ok = parse_words(app, argc, argv); !ok)
      return report_error(program, usage(ok.error().message + " (see " + program + " --help)"));
  } catch (const CLI::CallForHelp&) {
    for (CLI::Option* option : app.get_options()) {
      if (option->get_group() == kDiagnostics) option->group("");
    }
    std::fputs(app.help().c_str(), stdout);
    return 0;
  } catch (const CLI::CallForAllHelp&) {
    std::fputs(app.help().c_str(), stdout);
    return 0;
  } catch (const CLI::CallForVersion& version) {
    std::puts(version.what());
    return 0;
  }
  return std::nullopt;
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
