// SPDX-License-Identifier: Apache-2.0
#include "formats/base/text.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <regex>
#include <stdexcept>
#include <string>
#include <vector>

#include "formats/base/json.h"

namespace trocar {
namespace {

TEST(TerminalText, LeavesWhatCanBePrinted) {
  for (const char* text : {"", "scan.nii", "M\xc3\xbcller", "\xe9\xaa\xa8 \xf0\x9f\xa6\xb4",
                           "back\\slash", "\xef\xbf\xbd"})
    EXPECT_EQ(terminal_text(text), text);
}

TEST(TerminalText, EscapesWhatActsOnATerminal) {
  for (const auto& [text, shown] : {std::pair{"a\x1b[31mb", "a\\u001b[31mb"},
                                    {"a\nb\r\tc", "a\\nb\\r\\tc"},
                                    {"\x7f", "\\u007f"},
                                    {"\xc2\x9b", "\\u009b"},
                                    {"a\xe2\x80\xaetxt", "a\\u202etxt"},
                                    {"\xe2\x81\xa6\xe2\x81\xa9", "\\u2066\\u2069"},
                                    {"\xef\xbb\xbf", "\\ufeff"},
                                    {"\xd8\x9c", "\\u061c"},
                                    {"\xf3\xa0\x81\x81", "\\udb40\\udc41"}}) {
    EXPECT_EQ(terminal_text(text), shown);
    EXPECT_EQ(terminal_text(terminal_text(text)), shown);
  }
  EXPECT_EQ(terminal_text(std::string_view("a\0b", 3)), "a\\u0000b");
}

TEST(TerminalText, EscapesBytesThatAreNotUtf8) {
  for (const auto& [text, shown] : {std::pair{"\xff", "\\xff"},
                                    {"a\xc3", "a\\xc3"},
                                    {"\xc3(", "\\xc3("},
                                    {"\xc0\x8a", "\\xc0\\x8a"},
                                    {"\xed\xa0\x80", "\\xed\\xa0\\x80"},
                                    {"\xf4\x90\x80\x80", "\\xf4\\x90\\x80\\x80"}})
    EXPECT_EQ(terminal_text(text), shown);
}

TEST(TerminalText, JsonKeepsItsValue) {
  const nlohmann::json value = {{"a\n\x1b", "\xe2\x80\xae \xf3\xa0\x81\x81 \xc2\x85 \xc3\xbc"}};
  for (const int indent : {-1, 1}) {
    const std::string shown = terminal_lines(json_text(value, indent));
    EXPECT_EQ(parse_json(shown), value);
    EXPECT_EQ(shown.find("\xe2\x80\xae"), std::string::npos);
    EXPECT_EQ(shown.find('\n') != std::string::npos, indent == 1);
  }
}

TEST(TerminalText, PrintEscapesEveryTextAmongTheValues) {
  std::FILE* const file = std::tmpfile();
  ASSERT_NE(file, nullptr);
  const std::string name = "a\x1b";
  print(file, "%s %s %s %d %5.1f %-4s|\n", name, name.c_str(), std::filesystem::path("b\nc"), 7,
        2.5, "x");
  std::string out(100, '\0');
  std::rewind(file);
  out.resize(std::fread(out.data(), 1, out.size(), file));
  std::fclose(file);
  EXPECT_EQ(out, "a\\u001b a\\u001b b\\nc 7   2.5 x   |\n");
}

// std::regex is the independent implementation.
std::vector<std::string> by_standard_library(const std::string& text, const char* pattern) {
  std::smatch parts;
  std::vector<std::string> out;
  if (std::regex_match(text, parts, std::regex(pattern)))
    for (const auto& part : parts)
      out.push_back(part.str());
  return out;
}

TEST(TextPattern, FindsTheSamePartsAsTheStandardLibrary) {
  const char* const patterns[] = {"(-[^ :]+): (.*) not in \\{(.*)\\}",
                                  "slice_[0-9]{4,}(_[0-9]+)?\\.(poly|obj|svg)",
                                  "[A-Za-z0-9_ .+/-]*",
                                  ".*[0-9]{4}.*",
                                  "(-[^ :]+): 1 required .* missing",
                                  "[0-9a-f]{64}"};
  const std::string texts[] = {"--axis: x: y not in {a,b} not in {c}",
                               "--axis: x not in {a,b} ",
                               "slice_0001.obj",
                               "slice_00001_2.svg",
                               "slice_001.obj",
                               "slice_0001.objx",
                               "xslice_0001.obj",
                               "",
                               "B30f/ 1.0+",
                               "Br40d\\3",
                               "19700101",
                               "--a: 1 required TEXT missing",
                               std::string(64, 'a'),
                               std::string(65, 'a')};
  int found = 0;
  for (const char* const pattern : patterns) {
    for (const std::string& text : texts) {
      EXPECT_EQ(match(text, pattern), by_standard_library(text, pattern)) << pattern << '\n'
                                                                          << text;
      found += matches(text, pattern);
    }
  }
  EXPECT_EQ(found, 20);
}

TEST(TextPattern, DoesNotEndAtANul) {
  const std::string text("slice_0001.obj\0x", 16);
  EXPECT_FALSE(matches(text, "slice_[0-9]{4}\\.obj"));
  EXPECT_TRUE(matches(text, "slice_[0-9]{4}\\.obj[^a]x"));
}

TEST(TextPattern, TakesALongText) {
  constexpr std::size_t kLong = 10'000'000;  // far more than fits on the stack
  EXPECT_TRUE(matches(std::string(kLong, '7'), "[0-9]*"));
  EXPECT_FALSE(matches(std::string(kLong, '7') + "x", "[0-9]*"));
  // A search from each dash would take days.
  EXPECT_FALSE(matches(std::string(kLong, '-'), "(-[^ :]+): 1 required .* missing"));
}

TEST(TextPattern, RefusesAWrongPattern) {
  EXPECT_THROW(match("a", "(a"), std::invalid_argument);
}

TEST(UtcTime, DoesNotDependOnTheTimeZone) {
  for (const char* zone : {"UTC", "Asia/Tokyo", "America/New_York", "XXX-5:30"}) {
    ::setenv("TZ", zone, 1);  // NOLINT(concurrency-mt-unsafe)
    ::tzset();
    EXPECT_EQ(utc_text(1'796'016'878), "2026-11-30T05:34:38Z") << zone;
    EXPECT_EQ(utc_name(1'796'016'878), "20261130T053438Z") << zone;
  }
  ::unsetenv("TZ");  // NOLINT(concurrency-mt-unsafe)
  ::tzset();
}

TEST(UtcTime, ATimeThatNoCalendarHasIsThatOfZero) {
  EXPECT_EQ(utc_text(std::numeric_limits<std::time_t>::max()), "1970-01-01T00:00:00Z");
}

}  // namespace
}  // namespace trocar
