// SPDX-License-Identifier: Apache-2.0
#include "formats/base/command_line.h"

#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <stdexcept>
#include <vector>

namespace trocar {
namespace {

struct Outcome {
  std::optional<int> code;
  std::string out, err;
};

/// A program with an option --threshold and a subcommand `info` with a flag --json.
Outcome parse(std::vector<const char*> arguments) {
  CLI::App app("Does something.", "program");
  add_help_and_version(app, "program 1.2 (library 3)");
  double threshold = 0;
  bool as_json = false;
  app.add_option("--threshold", threshold, "in HU");
  app.add_subcommand("info", "describe")->add_flag("--json", as_json, "as JSON");
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
  const Outcome version = parse({"--version"});
  EXPECT_EQ(version.code, 0);
  EXPECT_EQ(version.out, "program 1.2 (library 3)\n");
}

TEST(CommandLine, ReportsWrongUsageInOneLineWithTheNearestOption) {
  EXPECT_EQ(
      parse({"--treshold=3"}).err,
      "program: not expected: --treshold=3, did you mean --threshold? (see program --help)\n");
  EXPECT_EQ(parse({"info", "--jsom"}).err,
            "program: not expected: --jsom, did you mean --json? (see program --help)\n");
  EXPECT_EQ(parse({"--threshold", ""}).err, "program: --threshold: its value is empty\n");
  EXPECT_EQ(parse({"--threshold="}).err, "program: --threshold: its value is empty\n");
  EXPECT_EQ(parse({""}).err, "program: an argument: its value is empty\n");
  EXPECT_EQ(parse({"--threshold", "bone"}).err,
            "program: --threshold: bone is not a number (see program --help)\n");
  for (const std::vector<const char*>& wrong : std::vector<std::vector<const char*>>{
           {"--treshold=3"}, {"--threshold", ""}, {"--threshold", "high"}, {"--threshold"}}) {
    const Outcome outcome = parse(wrong);
    EXPECT_EQ(outcome.code, 2);
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  }
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
