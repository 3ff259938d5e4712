// SPDX-License-Identifier: Apache-2.0
#include "formats/base/command_line.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <optional>
#include <regex>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace trocar {
namespace {

struct Outcome {
  std::optional<int> code;
  std::string out, err;
};

/// A program with some options and a command `info` with a flag --json.
struct Program {
  CLI::App app{"Does something.", "program"};
  double threshold = 0, angle = 0, width = 2.5;
  int bits = 0, count = 0;
  std::string axis, stage, file;
  bool as_json = false;

  Program() {
    add_help(app, "program 1.2 (library 3)");
    app.add_option("--threshold", threshold, "in HU");
    add_number(app, "--angle", angle, {-1e6, 60.5}, "in degrees");
    add_number(app, "--bits", bits, {0, 14}, "a number");
    one_of(app.add_option("--axis", axis, "a name"), {"coronal", "sagittal", "other"});
    add_number(app, "--width", width, {0, 9, "MM", "mm"}, "of a line");
    add_number(app, "--count", count, {0, 9, "N"}, "");
    app.add_option("FILE", file, "an argument");
    app.add_option("--dump", stage, "a stage")->group(kDiagnostics);
    app.add_subcommand("info", "describe")->add_flag("--json", as_json, "as JSON");
    app.add_subcommand("export", "");
  }
};

Outcome outcome_of(CLI::App& app, std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), app.get_name());
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  const auto code = parse_or_end(app, arguments);
  std::fflush(stdout);
  return {code, testing::internal::GetCapturedStdout(), testing::internal::GetCapturedStderr()};
}

Outcome parse(std::vector<std::string> arguments) {
  Program program;
  return outcome_of(program.app, std::move(arguments));
}

TEST(CommandLine, AcceptsWhatWasDeclared) {
  for (const Outcome& outcome : {parse({"--threshold", "3"}), parse({"info", "--json"})}) {
    EXPECT_FALSE(outcome.code);
    EXPECT_EQ(outcome.out + outcome.err, "");
  }
}

TEST(CommandLine, PrintsHelpAndVersionToStandardOutput) {
  const Outcome help = parse({"--help"});
  EXPECT_EQ(help.code, 0);
  EXPECT_NE(help.out.find("--threshold"), std::string::npos) << help.out;
  const Outcome help_on_info = parse({"info", "--help"});
  EXPECT_EQ(help_on_info.code, 0);
  EXPECT_NE(help_on_info.out.find("--json"), std::string::npos) << help_on_info.out;
  EXPECT_TRUE(std::regex_search(help.out, std::regex("--width MM(=2.5| .2.5.) "))) << help.out;
  for (const char* form :
       {"--angle -1000000..60.5", "--bits 0..14", "--axis coronal|sagittal|other", "  FILE  "})
    EXPECT_NE(help.out.find(form), std::string::npos) << form << "\n" << help.out;
  const Outcome version = parse({"--version"});
  EXPECT_EQ(version.code, 0);
  EXPECT_EQ(version.out, "program 1.2 (library 3)\n");
}

TEST(CommandLine, ShowsDiagnosticsOnlyInTheHelpOnAll) {
  const Outcome help = parse({"--help"}), all = parse({"--help-all"});
  EXPECT_EQ(all.code, 0);
  EXPECT_EQ(help.out.find("--dump"), std::string::npos) << help.out;
  for (const char* text : {"Diagnostics:", "--dump", "--threshold"})
    EXPECT_NE(all.out.find(text), std::string::npos) << all.out;
}

TEST(CommandLine, ReportsWrongUsageInOneLineWithTheNearestOption) {
  EXPECT_EQ(
      parse({"--treshold=3"}).err,
      "program: not expected: --treshold=3, did you mean --threshold? (see program --help)\n");
  EXPECT_EQ(parse({"info", "--jsom"}).err,
            "program: not expected: --jsom, did you mean --json? (see program info --help)\n");
  EXPECT_EQ(parse({"--treshold", "info", "--json"}).err,
            "program: not expected: --treshold, did you mean --threshold? (see program --help)\n");
  EXPECT_EQ(parse({"--threshold", ""}).err, "program: --threshold: its value is empty\n");
  EXPECT_EQ(parse({"--threshold="}).err, "program: --threshold: its value is empty\n");
  EXPECT_EQ(parse({""}).err, "program: an argument is empty\n");
  EXPECT_EQ(parse({"--threshold", "bone"}).err,
            "program: --threshold: bone is not a number (see program --help)\n");
  for (const std::vector<std::string>& wrong : std::vector<std::vector<std::string>>{
           {"--treshold=3"}, {"--threshold", ""}, {"--threshold", "high"}, {"--threshold"}}) {
    const Outcome outcome = parse(wrong);
    EXPECT_EQ(outcome.code, 2);
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  }
}

TEST(CommandLine, SaysWhatAValueMustBe) {
  const std::string end = " (see program --help)\n";
  EXPECT_EQ(parse({"--threshold"}).err, "program: --threshold: its value is missing" + end);
  EXPECT_EQ(parse({"--angle", "61"}).err,
            "program: --angle 61: must be within -1000000 and 60.5" + end);
  EXPECT_EQ(parse({"--bits", "-1"}).err, "program: --bits -1: must be within 0 and 14" + end);
  EXPECT_EQ(parse({"--width", "10"}).err, "program: --width 10: must be within 0 and 9 mm" + end);
  EXPECT_EQ(parse({"--width", "wide"}).err, "program: --width: wide is not a number" + end);
  EXPECT_EQ(parse({"--width", "nan"}).err, "program: --width: nan is not a number" + end);
  EXPECT_EQ(parse({"--count", "2.5"}).err, "program: --count: 2.5 is not a whole number" + end);
  EXPECT_EQ(parse({"--axis", "axial"}).err,
            "program: --axis axial: must be coronal, sagittal or other" + end);
  EXPECT_EQ(
      parse({"--axis", "Value 1 not in range 2 to 3"}).err,
      "program: --axis Value 1 not in range 2 to 3: must be coronal, sagittal or other" + end);
  // About the longest arguments that Linux passes on; std::regex overflowed the stack on them.
  for (const char c : {'x', '-'}) {
    const std::string axis = "--axis=" + std::string(131'000, c);
    EXPECT_EQ(parse({axis}).err,
              "program: --axis " + axis.substr(7) + ": must be coronal, sagittal or other" + end);
  }
}

TEST(CommandLine, AMistypedOptionIsNamedBeforeTheOneThatIsMissingForIt) {
  CLI::App app("", "program");
  std::string key, scene;
  app.add_option("SCENE", scene)->required();
  app.add_option("--key-file", key)->required();
  EXPECT_EQ(outcome_of(app, {"a", "--keyfile", "k"}).err,
            "program: not expected: --keyfile, did you mean --key-file? (see program --help)\n");
  EXPECT_EQ(outcome_of(app, {"a"}).err, "program: --key-file is required (see program --help)\n");
}

TEST(CommandLine, SaysWhatIsGivenTwiceOrInTheWrongPlace) {
  EXPECT_EQ(parse({"--axis", "other", "--axis", "other"}).err,
            "program: --axis: may be given only once (see program --help)\n");
  EXPECT_EQ(parse({"info", "export"}).err,
            "program: export: is a second command; give only one (see program info --help)\n");
  EXPECT_EQ(parse({"--bits", "3", "info"}).err,
            "program: info: is a command of its own; leave --bits out\n");
  EXPECT_EQ(parse({"a.txt", "info"}).err,
            "program: info: is a command of its own; leave FILE out\n");
}

TEST(CommandLine, FindsAMistypedCommand) {
  const Program program;
  EXPECT_EQ(check_command(program.app, "ino").error().message,
            "ino: no such file, folder or command, did you mean info?");
  for (const char* word : {"", "scene.json", "./ino"})
    EXPECT_TRUE(check_command(program.app, word)) << word;
}

TEST(CommandLine, ReadsChoicesAndWhatAFunctionReads) {
  CLI::App app("", "program");
  add_help(app, "");
  bool is_on = true;
  std::vector<int> pair;
  std::vector<std::string> all;
  add_choice<bool>(app, "--passivity", is_on, {{"on", true}, {"off", false}}, "");
  const auto read_pair = [&](const std::string& text) {
    pair = numbers<int>(text, "#:#").value_or(std::vector<int>());
    return pair.empty() ? "must be A:B" : "";
  };
  add_parsed(app, "--slices", read_pair, "", "A:B");
  const auto add = [&](const std::string& text) { return all.push_back(text), ""; };
  many(add_parsed(app, "--label", add, "", "L"));
  std::string file;
  app.add_option("FILE", file);
  ASSERT_TRUE(trocar::parse(app, {"program", "--passivity", "off", "--slices", "3:12", "--label",
                                  "a", "in", "--label", "b"}));
  EXPECT_FALSE(is_on);
  EXPECT_EQ(pair, (std::vector<int>{3, 12}));
  EXPECT_EQ(all, (std::vector<std::string>{"a", "b"}));
  EXPECT_EQ(file, "in");
  EXPECT_EQ(outcome_of(app, {"--passivity", "1"}).err,
            "program: --passivity 1: must be on or off (see program --help)\n");
  EXPECT_EQ(outcome_of(app, {"--slices", "3"}).err,
            "program: --slices 3: must be A:B (see program --help)\n");
  const std::string help = outcome_of(app, {"--help"}).out;
  for (const char* form : {"--passivity on|off", "--slices A:B"})
    EXPECT_NE(help.find(form), std::string::npos) << help;
  EXPECT_EQ(help.find("--version"), std::string::npos) << help;
  EXPECT_FALSE(numbers<int>("3:", "#:#") || numbers<int>("3:4 ", "#:#") ||
               numbers<double>("nan,1", "#,#"));
}

TEST(CommandLine, AnOptionMayBeGivenWithoutItsValue) {
  CLI::App app;
  std::string context = "default";
  bool is_quiet = false;
  add_parsed(
      app, "--context", [&](const std::string& text) { return context = text, ""; }, "", "[MM]")
      ->expected(0, 1);
  app.add_flag("--quiet", is_quiet);
  ASSERT_TRUE(trocar::parse(app, {"program", "--context", "--quiet"}));
  EXPECT_EQ(context, "");
  EXPECT_TRUE(is_quiet);
}

TEST(CommandLine, NamesItsLibraryWithTheVersion) {
  EXPECT_TRUE(std::regex_match(command_line_library(), std::regex("CLI11 [0-9]+\\.[0-9.]+")));
}

TEST(Program, ReportsAnExceptionAsABug) {
  EXPECT_EQ(run_program("program", [] { return 3; }), 3);
  testing::internal::CaptureStderr();
  EXPECT_EQ(run_program("program", []() -> int { throw std::runtime_error("broken"); }), 1);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "program: internal error: broken\n");
}

TEST(Program, SignalsRequestAStop) {
  stop_on_signals();
  EXPECT_FALSE(stop_requested);
  std::raise(SIGTERM);
  EXPECT_TRUE(stop_requested);
}

}  // namespace
}  // namespace trocar
