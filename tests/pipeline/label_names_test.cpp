// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/label_names.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

namespace trocar::pipeline {
namespace {

class LabelNamesFile : public testing::Test {
 protected:
  Result<LabelNames> read(const std::string& text) const {
    std::ofstream(file_, std::ios::binary) << text;
    return read_label_names(file_.string());
  }
  void TearDown() override { std::filesystem::remove(file_); }

  const std::filesystem::path file_ =
      std::filesystem::temp_directory_path() /
      ("label_names_" + std::to_string(testing::UnitTest::GetInstance()->random_seed()) +
       testing::UnitTest::GetInstance()->current_test_info()->name() + ".json");
};

TEST(LabelNames, VerseAndTotalSegmentator) {
  const auto verse = read_label_names("verse");
  ASSERT_TRUE(verse);
  EXPECT_EQ(verse->size(), 28U);
  for (const auto& [label, name] : LabelNames{{1, "C1"},
                                              {7, "C7"},
                                              {8, "T1"},
                                              {19, "T12"},
                                              {20, "L1"},
                                              {22, "L3"},
                                              {25, "L6"},
                                              {26, "sacrum"},
                                              {27, "coccyx"},
                                              {28, "T13"}})
    EXPECT_EQ(verse->at(label), name);
  const auto total = read_label_names("totalsegmentator");
  ASSERT_TRUE(total);
  EXPECT_EQ(total->size(), 117U);
  EXPECT_EQ(total->begin()->first, 1);
  EXPECT_EQ(total->rbegin()->first, 117);
  // The last of each part, so that no part has one too many or too few.
  for (const auto& [label, name] : LabelNames{{1, "spleen"},
                                              {24, "kidney_cyst_right"},
                                              {26, "vertebrae_S1"},
                                              {27, "vertebrae_L5"},
                                              {29, "vertebrae_L3"},
                                              {32, "vertebrae_T12"},
                                              {43, "vertebrae_T1"},
                                              {50, "vertebrae_C1"},
                                              {51, "heart"},
                                              {64, "portal_vein_and_splenic_vein"},
                                              {68, "iliac_vena_right"},
                                              {78, "hip_right"},
                                              {79, "spinal_cord"},
                                              {89, "iliopsoas_right"},
                                              {91, "skull"},
                                              {92, "rib_left_1"},
                                              {103, "rib_left_12"},
                                              {115, "rib_right_12"},
                                              {116, "sternum"},
                                              {117, "costal_cartilages"}})
    EXPECT_EQ(total->at(label), name);
}

TEST_F(LabelNamesFile, IsRead) {
  const auto names = read(R"({"22": "L3", "7": "vertebra \u00e9", "-3": "x"})");
  ASSERT_TRUE(names) << names.error().message;
  EXPECT_EQ(*names, (LabelNames{{-3, "x"}, {7, "vertebra \xc3\xa9"}, {22, "L3"}}));
}

TEST_F(LabelNamesFile, IsRefusedWithTheReason) {
  for (const std::string text :
       {"", "[]", "{}", "{\"22\": 3}", "{\"22\": \"\"}", "{\"22\": \"a\\nb\"}", "{\"0\": \"a\"}",
        "{\"022\": \"a\"}", "{\"2.5\": \"a\"}", "{\"22 \": \"a\"}", "{\"1000000000\": \"a\"}",
        "{\"99999999999\": \"a\"}", "{\"L3\": \"22\"}", "{\"2\": \"a\", \"2\": \"b\"}",
        "{\"2\": \"\xff\"}", "{\"2\": \"a\""}) {
    const auto names = read(text);
    ASSERT_FALSE(names) << text;
    EXPECT_EQ(names.error().code, ExitCode::kRefused);
    EXPECT_NE(names.error().message.find(file_.string()), std::string::npos);
    EXPECT_EQ(names.error().message.find('\n'), std::string::npos);
  }
  EXPECT_FALSE(read("{\"2\": \"" + std::string(65, 'a') + "\"}"));
  EXPECT_TRUE(read("{\"2\": \"" + std::string(64, 'a') + "\"}"));
  EXPECT_FALSE(read_label_names("/no/such/file.json"));
}

TEST(NamedMaterials, LabelsOfOneNameAreOneMaterial) {
  const auto materials =
      named_materials({3, 5, 8, 9}, {{3, "lumbar"}, {5, "disc"}, {9, "lumbar"}, {99, "unused"}});
  ASSERT_EQ(materials.size(), 3U);
  EXPECT_EQ(materials[0].name, "lumbar");
  EXPECT_EQ(materials[0].labels.labels, (std::set<int>{3, 9}));
  EXPECT_EQ(materials[1].name, "disc");
  EXPECT_EQ(materials[2].name, "label 8");
  EXPECT_EQ(materials[2].labels.labels, (std::set<int>{8}));
}

}  // namespace
}  // namespace trocar::pipeline
