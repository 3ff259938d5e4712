// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/archive/archive_names.h"

#include <gtest/gtest.h>

namespace trocar::archive {
namespace {

TEST(ArchiveNames, UidsAreNumbersSeparatedByDots) {
  for (const char* good : {"1", "1.2.840.10008", "2.25.0", "1.02"})
    EXPECT_TRUE(is_uid(good)) << good;
  EXPECT_TRUE(is_uid(std::string(64, '1')));
  for (const char* bad :
       {"", ".", "..", ".1", "1.", "1..2", "../1", "1/2", "1.2 ", "a", "1.-2", "1\n"})
    EXPECT_FALSE(is_uid(bad)) << bad;
  EXPECT_FALSE(is_uid(std::string(65, '1')));
  EXPECT_FALSE(is_uid(std::string_view("1.2\0", 4)));
}

TEST(ArchiveNames, TitlesAreShortAndPrintable) {
  for (const char* good : {"A", "SIXTEEN_LETTERS_", "WITH SPACE"})
    EXPECT_TRUE(is_ae_title(good)) << good;
  for (const char* bad : {"", " A", "A ", "SEVENTEEN_LETTERS", "A\\B", "A\tB", "\xc3\xa4"})
    EXPECT_FALSE(is_ae_title(bad)) << bad;
}

TEST(ArchiveNames, PrintableTextIsShortAndOfOneLine) {
  EXPECT_EQ(printable("A\nB\x1b\xff"), "A?B??");
  EXPECT_EQ(printable(std::string(1000, 'x')).size(), 64U);
}

TEST(ArchiveNames, PeerHasTitleHostAndPort) {
  const auto peer = parse_peer("PACS 1@pacs.example.org:104");
  ASSERT_TRUE(peer);
  EXPECT_EQ(peer->ae, "PACS 1");
  EXPECT_EQ(peer->host, "pacs.example.org");
  EXPECT_EQ(peer->port, 104);
  const auto six = parse_peer("A@[::1]:104");
  ASSERT_TRUE(six);
  EXPECT_EQ(six->host, "::1");
  for (const char* bad :
       {"", "A", "A@b", "@b:1", "A@:1", "A@b:", "A@b:0", "A@b:65536", "A@b:1x", "A:1@b", "A@b c:1"})
    EXPECT_FALSE(parse_peer(bad)) << bad;
  for (const char* port : {"A@b:0", "A@b:65536", "A@b:99999999999"})
    EXPECT_EQ(parse_peer(port).error().message,
              std::string(port) + ": the port must be within 1 and 65535");
}

}  // namespace
}  // namespace trocar::archive
