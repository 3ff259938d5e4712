// SPDX-License-Identifier: Apache-2.0
#include "formats/base/command_line.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <regex>
#include <string>
#include <vector>

namespace trocar {
namespace {

struct Outcome {
  std::optional<int> code;
  std::string out, err;
};

/// A program with some options and a subcommand `info` with a flag --json.
Outcome parse(std::vector<std::string> arguments) {
  CommandLine line("program", "Does something.", "program 1.2 (library 3)");
  double threshold = 0, angle = 0, width = 2.5;
  int bits = 0, count = 0;
  std::string axis, stage, file;
  bool as_json = false;
  line.option("--threshold", threshold, "in HU");
  line.option("--angle", angle, "in degrees").within(-1e6, 60.5);
  line.option("--bits", bits, "a number").within(0, 14);
  line.option("--axis", axis, "a name").one_of({"coronal", "sagittal", "other"});
  line.option("--width", width, "of a line").with_default_shown().within(0.0, 9.0, "MM", "mm");
  line.option("--count", count, "").within(0, 9, "N");
  line.option("FILE", file, "an argument");
  line.option("--dump", stage, "a stage").in_group(kDiagnostics);
  line.add_command("info", "describe").flag("--json", as_json, "as JSON");
  arguments.insert(arguments.begin(), "program");
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  const auto code = line.parse_or_end(arguments);
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
  for (const char* form :
       {"--angle -1000000..60.5", "--bits 0..14 ", "--axis coronal|sagittal|other", "  FILE  "})
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
  CommandLine line("program", "Does something.", "");
  std::string key, scene;
  line.option("SCENE", scene, "").required();
  line.option("--key-file", key, "").required();
  const auto said = [&line](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "program");
    testing::internal::CaptureStderr();
    EXPECT_EQ(line.parse_or_end(arguments), 2);
    return testing::internal::GetCapturedStderr();
  };
  EXPECT_EQ(said({"a", "--keyfile", "k"}),
            "program: not expected: --keyfile, did you mean --key-file? (see program --help)\n");
  EXPECT_EQ(said({"a"}), "program: --key-file is required (see program --help)\n");
}

TEST(CommandLine, WritesEachKindOfValue) {
  CommandLine line("program", "", "");
  int whole = 0;
  std::uint64_t large = 0;
  double number = 0;
  std::string text;
  std::filesystem::path path;
  std::optional<int> maybe_whole, not_given;
  std::optional<std::int64_t> maybe_large;
  std::optional<double> maybe_number;
  std::vector<std::string> texts;
  std::vector<std::filesystem::path> pair, inputs;
  bool flag = false;
  line.option("--whole", whole, "");
  line.option("--large", large, "");
  line.option("--number", number, "");
  line.option("--text", text, "");
  line.option("--path", path, "");
  line.option("--maybe-whole", maybe_whole, "");
  line.option("--maybe-large", maybe_large, "");
  line.option("--not-given", not_given, "");
  line.option("--maybe-number", maybe_number, "");
  line.option("--texts", texts, "").one_value_each();
  line.option("--pair", pair, "").two_values();
  line.option("INPUT", inputs, "");
  line.flag("--flag", flag, "");
  const auto done = line.parse({"program",
                                "--whole=-3",
                                "--large=18446744073709551615",
                                "--number",
                                "2.5e-3",
                                "--text",
                                "a b",
                                "--path",
                                "a b/c",
                                "--maybe-whole",
                                "4",
                                "--maybe-large",
                                "-9223372036854775807",
                                "--maybe-number=0.5",
                                "--texts",
                                "x",
                                "--texts",
                                "y",
                                "in 1",
                                "--pair",
                                "p",
                                "q",
                                "in 2",
                                "--flag",
                                "--",
                                "--in3"});
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_EQ(whole, -3);
  EXPECT_EQ(large, 18446744073709551615U);
  EXPECT_EQ(number, 2.5e-3);
  EXPECT_EQ(text, "a b");
  EXPECT_EQ(path, "a b/c");
  EXPECT_EQ(maybe_whole, 4);
  EXPECT_EQ(maybe_large, -9223372036854775807);
  EXPECT_FALSE(not_given);
  EXPECT_EQ(maybe_number, 0.5);
  EXPECT_EQ(texts, (std::vector<std::string>{"x", "y"}));
  EXPECT_EQ(pair, (std::vector<std::filesystem::path>{"p", "q"}));
  EXPECT_EQ(inputs, (std::vector<std::filesystem::path>{"in 1", "in 2", "--in3"}));
  EXPECT_TRUE(flag);
}

TEST(CommandLine, TakesTwoValuesOnce) {
  std::vector<std::filesystem::path> pair;
  CommandLine line("program", "", "");
  line.option("--pair", pair, "").two_values();
  EXPECT_FALSE(line.parse({"program", "--pair", "p"}));
  EXPECT_FALSE(line.parse({"program", "--pair", "p", "q", "--pair", "r", "s"}));
}

TEST(CommandLine, AsksTheGivenFunctionAboutAValue) {
  std::string value;
  CommandLine line("program", "", "");
  line.option("--even", value, "").checked_by([](const std::string& text) {
    return text.size() % 2 == 0 ? "" : text + " is odd";
  });
  EXPECT_TRUE(line.parse({"program", "--even", "ab"}));
  const auto odd = line.parse({"program", "--even", "abc"});
  ASSERT_FALSE(odd);
  EXPECT_EQ(odd.error().message, "--even: abc is odd");
}

TEST(CommandLine, HelpShowsFormFooterAndColumn) {
  const auto help = [](std::size_t column) {
    std::string value;
    CommandLine line("program", "Does something.", "");
    line.option("--box", value, "a box").with_form("X,Y");
    line.set_footer("That is all.");
    line.set_help_column(column);
    testing::internal::CaptureStdout();
    EXPECT_EQ(line.parse_or_end({"program", "--help"}), 0);
    std::fflush(stdout);
    return testing::internal::GetCapturedStdout();
  };
  const std::string text = help(20);
  EXPECT_NE(text.find("\n  --box X,Y" + std::string(20 - 11, ' ') + "a box\n"), std::string::npos)
      << text;
  EXPECT_NE(text.find("That is all.\n"), std::string::npos) << text;
  EXPECT_EQ(text.find("--version"), std::string::npos) << text;
  EXPECT_NE(help(40).find("--box X,Y" + std::string(40 - 11, ' ') + "a box\n"), std::string::npos);
}

TEST(CommandLine, HasHelpOnDiagnosticsOnlyIfThereAreAny) {
  std::string stage;
  CommandLine without("program", "", ""), with("program", "", "");
  with.option("--dump", stage, "").in_group(kDiagnostics);
  testing::internal::CaptureStderr();
  EXPECT_EQ(without.parse_or_end({"program", "--help-all"}), 2);
  EXPECT_EQ(testing::internal::GetCapturedStderr(),
            "program: not expected: --help-all (see program --help)\n");
  EXPECT_FALSE(with.parse_or_end({"program", "--dump", "x"}));
  EXPECT_EQ(with.options().size(), 1U);
}

TEST(CommandLine, NamesAnOptionThatTheHelpHides) {
  int old = 0;
  CommandLine line("program", "", "");
  const Option hidden = line.option("-x,--former", old).in_group("");
  EXPECT_EQ(hidden.name(), "--former");
  EXPECT_EQ(hidden.bare_name(), "former");
  const auto wrong = line.parse({"program", "--former", "x"});
  ASSERT_FALSE(wrong);
  EXPECT_EQ(wrong.error().message, "--former: x is not a whole number");
  EXPECT_EQ(line.option("-y", old, "").name(), "-y");
}

TEST(CommandLine, SaysWhatIsGivenTwice) {
  std::string output;
  CommandLine line("program", "", "");
  line.option("-o,--output", output, "");
  line.add_command("fit", "");
  line.add_command("export", "");
  const auto twice = line.parse({"program", "-o", "a", "-o", "b"});
  ASSERT_FALSE(twice);
  EXPECT_EQ(twice.error().message, "--output: may be given only once");
  const auto commands = line.parse({"program", "fit", "export"});
  ASSERT_FALSE(commands);
  EXPECT_EQ(commands.error().message, "export: is a second command; give only one");
}

TEST(CommandLine, NamesItsLibraryWithTheVersion) {
  EXPECT_TRUE(std::regex_match(command_line_library(), std::regex("CLI11 [0-9]+\\.[0-9.]+")));
}

TEST(CommandLine, OptionsSayWhatWasGiven) {
  CommandLine line("program", "", "");
  std::string scene, output, context = "default";
  bool quiet = false, again = false;
  line.option("SCENE", scene, "");
  const Option out = line.option("-o,--output,--out", output, "");
  const Option around = line.option("--context", context, "").with_optional_value();
  const Option silent = line.flag("--quiet", quiet, "");
  line.add_command("fit", "").flag("--again", again, "");
  line.add_command("export", "");
  ASSERT_TRUE(line.parse({"program", "--context", "--quiet", "fit", "--again"}));
  EXPECT_EQ(line.chosen_command(), "fit");
  EXPECT_EQ(line.command_names(), (std::vector<std::string>{"fit", "export"}));
  EXPECT_TRUE(around.is_given() && silent.is_given() && again);
  EXPECT_EQ(context, "");
  EXPECT_FALSE(out.is_given() || Option().is_given());
  EXPECT_TRUE(silent.is_flag());
  EXPECT_FALSE(out.is_flag() || around.is_flag());
  EXPECT_EQ(out.name(), "--output");
  EXPECT_EQ(out.bare_name(), "output");
  EXPECT_EQ(out.long_names(), (std::vector<std::string>{"output", "out"}));
  std::vector<std::string> names;
  for (const Option& option : line.options())
    names.push_back(option.name());
  EXPECT_EQ(names, (std::vector<std::string>{"SCENE", "--output", "--context", "--quiet"}));
}

TEST(CommandLine, RefusesOptionsThatExcludeOrNeedEachOther) {
  bool check = false, strict = false, quiet = false;
  CommandLine line("program", "", "");
  const Option checks = line.flag("--check", check, "");
  line.flag("--strict", strict, "").needs(checks);
  line.flag("--quiet", quiet, "").excludes(checks);
  EXPECT_FALSE(line.parse({"program", "--strict"}));
  EXPECT_FALSE(line.parse({"program", "--quiet", "--check"}));
  EXPECT_TRUE(line.parse({"program", "--strict", "--check"}));
}

TEST(CommandLine, TakesOneCommand) {
  CommandLine line("program", "", "");
  line.add_command("fit", "");
  line.add_command("export", "");
  EXPECT_TRUE(line.parse({"program"}));
  EXPECT_EQ(line.chosen_command(), "");
  EXPECT_FALSE(line.parse({"program", "fit", "export"}));
  EXPECT_TRUE(line.parse({"program", "export"}));
}

}  // namespace
}  // namespace trocar
