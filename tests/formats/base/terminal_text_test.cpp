// SPDX-License-Identifier: Apache-2.0
#include "formats/base/text.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <string>

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

}  // namespace
}  // namespace trocar
