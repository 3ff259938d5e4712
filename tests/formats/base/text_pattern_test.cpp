// SPDX-License-Identifier: Apache-2.0
#include "formats/base/text.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <regex>
#include <stdexcept>
#include <string>
#include <vector>

namespace trocar {
namespace {

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

}  // namespace
}  // namespace trocar
