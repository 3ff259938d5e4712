// SPDX-License-Identifier: GPL-3.0-or-later
// Names of labels: the tables, strict files, and names that a scan gives.
#include "pipeline/bake/label_names.h"
#include "tests/support/take.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;

class Names : public testing::Test {
 protected:
  void SetUp() override {
    file_ = fs::temp_directory_path() / ("trocar_names_" + std::to_string(::getpid()) + ".json");
  }
  void TearDown() override { fs::remove(file_); }
  Result<LabelNames> of(const std::string& text) {
    std::ofstream(file_, std::ios::binary) << text;
    return LabelNames::named(file_.string());
  }
  void expect_refused(const std::string& text, const std::string& why) {
    const auto names = of(text);
    ASSERT_FALSE(names) << text;
    const std::string& message = names.error().message;
    EXPECT_EQ(names.error().code, ExitCode::kRefused) << message;
    EXPECT_TRUE(message.starts_with(file_.string() + ": ")) << message;
    EXPECT_NE(message.find(why), std::string::npos) << message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    EXPECT_LT(message.size(), 300U) << message;
  }
  fs::path file_;
};

TEST_F(Names, TablesNameTheirLabels) {
  const auto verse = LabelNames::named("verse"), total = LabelNames::named("totalsegmentator");
  ASSERT_TRUE(verse && total);
  for (const auto& [label, name] : std::map<int, std::string>{{1, "C1"},
                                                              {8, "T1"},
                                                              {25, "L6"},
                                                              {26, "sacrum"},
                                                              {28, "T13"},
                                                              {29, "label 29"},
                                                              {0, "label 0"},
                                                              {-1, "label -1"}})
    EXPECT_EQ(verse->name_of(label), name);
  for (const auto& [label, name] : std::map<int, std::string>{{1, "spleen"},
                                                              {26, "vertebrae_S1"},
                                                              {29, "vertebrae_L3"},
                                                              {115, "rib_right_12"},
                                                              {117, "costal_cartilages"},
                                                              {118, "label 118"}})
    EXPECT_EQ(total->name_of(label), name);
  std::set<std::string> all;
  for (int label = 1; label <= 117; ++label)
    all.insert(total->name_of(label));
  EXPECT_EQ(all.size(), 117U);
}

TEST_F(Names, AFileNamesItsLabels) {
  const auto names = test::take(of(R"({"20": "L1", "2147483647": "Kreuzbein (künstlich) 骶骨"})"));
  EXPECT_EQ(names.name_of(20), "L1");
  EXPECT_EQ(names.name_of(2147483647), "Kreuzbein (künstlich) 骶骨");
  EXPECT_EQ(names.name_of(21), "label 21");
  EXPECT_TRUE(of("{\"1\": \"" + std::string(64, 'x') + "\"}"));
}

TEST_F(Names, WrongFilesAreRefused) {
  expect_refused("", "it is empty");
  expect_refused("[\"L1\"]", "must be an object");
  expect_refused("{}", "must be an object");
  expect_refused("{\"20\": \"L1\"", "not JSON");
  expect_refused("{\"20\": \"L1\"} x", "not JSON");
  expect_refused(R"({"20": "L1", "20": "L2"})", "occurs twice");
  expect_refused(R"({"20": "L1", "21": "L1"})", "another label is called \"L1\"");
  for (const char* key :
       {"0", "-1", "+1", "020", "1.0", "1e2", " 1", "1 ", "", "L1", "2147483648", "99999999999999"})
    expect_refused("{\"" + std::string(key) + "\": \"x\"}", "is no label");
  expect_refused("{\"" + std::string(100000, '7') + "\": \"x\"}", "is no label");
  for (const char* value : {"7", "null", "[]", "{\"a\": \"b\"}", "true"})
    expect_refused("{\"1\": " + std::string(value) + "}", "must be a text");
  expect_refused(R"({"1": ""})", "is empty");
  expect_refused(R"({"1": " L1"})", "space");
  expect_refused("{\"1\": \"" + std::string(65, 'x') + "\"}", "65 bytes");
  for (const char* text :
       {"a\\nb", "a\\u0000b", "a\\u007f", "a\\u0085", "\\u202eL1", "a\\u200bb", "\\ufeffL1"})
    expect_refused("{\"1\": \"" + std::string(text) + "\"}", "cannot be printed");
  expect_refused("{\"1\": \"a\xff\"}", "");
  expect_refused("{\"1\": \"" + std::string(2 << 20, 'x') + "\"}", "");
}

TEST_F(Names, NoSuchFile) {
  const auto names = LabelNames::named("verze");
  ASSERT_FALSE(names);
  EXPECT_EQ(names.error().code, ExitCode::kRefused);
  EXPECT_EQ(
      names.error().message,
      "verze: No such file or directory (--names takes a JSON file, verse or totalsegmentator)");
}

TEST_F(Names, WhatTheScanSaysIsTheDefault) {
  auto names = test::take(of(R"({"1": "L1", "5": "disc"})"));
  names.add_defaults({{1, "first"},
                      {2, "  L2\xff\x01\xe2\x80\xae"},
                      {3, "disc"},
                      {4, " \t"},
                      {6, std::string(100, 'x')},
                      {7, std::string(63, 'x') + "ü"},
                      {8, "   "}});
  EXPECT_EQ(names.name_of(1), "L1");
  EXPECT_EQ(names.name_of(2), "L2???");
  EXPECT_EQ(names.name_of(3), "label 3") << "two labels of one name";
  EXPECT_EQ(names.name_of(4), "?");
  EXPECT_EQ(names.name_of(6), std::string(64, 'x'));
  EXPECT_EQ(names.name_of(7), std::string(63, 'x'));
  EXPECT_EQ(names.name_of(8), "label 8");
}

TEST_F(Names, ListsInMessages) {
  const auto verse = test::take(LabelNames::named("verse"));
  EXPECT_EQ(LabelNames().list({20, 21, 22, 30}), "labels 20-22, 30");
  EXPECT_EQ(verse.list({22}), "label 22 (L3)");
  EXPECT_EQ(verse.list({20, 22, 100}), "labels 20 (L1), 22 (L3), 100");
  EXPECT_EQ(verse.list({100, 101}), "labels 100-101");
  EXPECT_EQ(verse.list({1, 2, 3, 4, 5, 6, 7, 8, 9, 10}),
            "labels 1 (C1), 2 (C2), 3 (C3), 4 (C4), 5 (C5), 6 (C6), 7 (C7), 8 (T1) and 2 more");
}

}  // namespace
}  // namespace trocar::pipeline
