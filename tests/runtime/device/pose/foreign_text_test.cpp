// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/pose/connected_device.h"

#include <gtest/gtest.h>

namespace trocar::runtime {
namespace {

TEST(ForeignText, BecomesOneShortLineOfPrintableCharacters) {
  EXPECT_EQ(foreign_text("omega.3 ~"), "omega.3 ~");
  EXPECT_EQ(foreign_text("a\nb\r\x1b[2J\x7f\xc3\xa9"), "a?b??[2J???");
  EXPECT_EQ(foreign_text(std::string_view("a\0b", 3)), "a?b");
  EXPECT_EQ(foreign_text("12345", 5), "12345");
  EXPECT_EQ(foreign_text("123456", 5), "12345...");
  EXPECT_EQ(foreign_text(std::string(100'000, 'x')).size(), 303U);
}

TEST(ForeignText, NoTextIsSaid) {
  EXPECT_EQ(foreign_text(""), "(no text)");
  EXPECT_EQ(foreign_text(static_cast<const char*>(nullptr)), "(no text)");
}

}  // namespace
}  // namespace trocar::runtime
