// SPDX-License-Identifier: Apache-2.0
#include "formats/base/command_line.h"
#include "formats/base/option_range.h"

#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <regex>
#include <stdexcept>
#include <string>
#include <vector>

namespace trocar {
namespace {

struct Outcome {
  std::optional<int> code;
  std::string out, err;
};

/// A program with some options and a subcommand `info` with a flag --json.
Outcome parse(std::vector<const char*> arguments) {
  CLI::App app("Does something.", "program");
  add_help_and_version(app, "program 1.2 (library 3)");
  double threshold = 0, angle = 0, width = 2.5;
  int bits = 0, count = 0;
  std::string axis;
  bool as_json = false;
  app.add_option("--threshold", threshold, "in HU");
  app.add_option("--angle", angle, "in degrees")->check(option_range(-1e6, 60.5));
  app.add_option("--bits", bits, "a number")->check(option_range(0, 14));
  app.add_option("--axis", axis, "a name")->check(CLI::IsMember({"coronal", "sagittal", "other"}));
  app.add_option("--width", width, "of a line")
      ->type_name("MM")
      ->capture_default_str()
      ->check(option_range(0.0, 9.0).description(""));
  app.add_option("--count", count)->type_name("N")->check(option_range(0, 9).description(""));
  app.add_option("--dump", "a stage")->group(kDiagnostics);
  app.add_subcommand("info", "describe")->add_flag("--json", as_json, "as JSON");
  add_help_for_diagnostics(app);
  arguments.insert(arguments.begin(), "program");
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  const auto code = parse_command_line(app, static_cast<int>(arguments.size()), arguments.data());
  std::fflush(stdout);
  return {code, testing::internal::GetCapturedStdout(), testing::internal::GetCapturedStderr()};
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
            "program: not expected: --jsom, did you mean --json? (see program --help)\n");
  EXPECT_EQ(parse({"--threshold", ""}).err, "program: --threshold: its value is empty\n");
  EXPECT_EQ(parse({"--threshold="}).err, "program: --threshold: its value is empty\n");
  EXPECT_EQ(parse({""}).err, "program: an argument is empty\n");
  EXPECT_EQ(parse({"--threshold", "bone"}).err,
            "program: --threshold: bone is not a number (see program --help)\n");
  for (const std::vector<const char*>& wrong : std::vector<std::vector<const char*>>{
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
  EXPECT_EQ(parse({"--width", "10"}).err, "program: --width 10: must be within 0 and 9" + end);
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
    EXPECT_EQ(parse({axis.c_str()}).err,
              "program: --axis " + axis.substr(7) + ": must be coronal, sagittal or other" + end);
  }
}

TEST(CommandLine, AMistypedOptionIsNamedBeforeTheOneThatIsMissingForIt) {
  CLI::App app("Does something.", "program");
  std::string key, scene;
  app.add_option("SCENE", scene)->required();
  app.add_option("--key-file", key)->required();
  const auto said = [&app](std::vector<const char*> arguments) {
    arguments.insert(arguments.begin(), "program");
    testing::internal::CaptureStderr();
    EXPECT_EQ(parse_command_line(app, static_cast<int>(arguments.size()), arguments.data()), 2);
    return testing::internal::GetCapturedStderr();
  };
  EXPECT_EQ(said({"a", "--keyfile", "k"}),
            "program: not expected: --keyfile, did you mean --key-file? (see program --help)\n");
  EXPECT_EQ(said({"a"}), "program: --key-file is required (see program --help)\n");
}

TEST(CommandLine, RunProgramReportsAnExceptionAsABug) {
  EXPECT_EQ(run_program("program", [] { return 3; }), 3);
  testing::internal::CaptureStderr();
  EXPECT_EQ(run_program("program", []() -> int { throw std::runtime_error("broken"); }), 1);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "program: internal error: broken\n");
}

TEST(CommandLine, SignalsRequestAStop) {
  stop_on_signals();
  EXPECT_FALSE(stop_requested);
  std::raise(SIGTERM);
  EXPECT_TRUE(stop_requested);
}

}  // namespace
}  // namespace trocar
