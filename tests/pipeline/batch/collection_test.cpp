// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/batch/collection.h"

#include <gtest/gtest.h>

#include <string>

#include "pipeline/batch/scan_files.h"
#include "tests/support/take.h"

namespace trocar::farm {
namespace {

using nlohmann::json;

Result<Collection> parsed(const json& value) {
  return parse_collection(value.dump(), "/data/c.json");
}

json one_scan(const json& input) {
  return {{"schema", "trocar.collection/1"}, {"scans", {{{"name", "a"}, {"input", input}}}}};
}

TEST(Collection, NamesBecomeFilesAndNothingElse) {
  for (const char* good : {"a", "A9", "_x", "p001_s4", "a.b-c+d", "0"})
    EXPECT_TRUE(is_scan_name(good)) << good;
  for (const char* bad :
       {"", ".", "..", "../x", "a/b", "-o", ".a", "a b", "a\n", "\xc3\xa4", "a\\b"})
    EXPECT_FALSE(is_scan_name(bad)) << bad;
  EXPECT_TRUE(is_scan_name(std::string(120, 'a')));
  EXPECT_FALSE(is_scan_name(std::string(121, 'a')));
  EXPECT_FALSE(is_scan_name(std::string_view("a\0b", 3)));
}

TEST(Collection, EveryKindOfInput) {
  EXPECT_EQ(parsed(one_scan("x*"))->scans[0].paths, std::vector<std::string>{"x*"});
  EXPECT_EQ(parsed(one_scan({"x", "y"}))->scans[0].paths, (std::vector<std::string>{"x", "y"}));
  EXPECT_EQ(parsed(one_scan({{"glob", "x*"}}))->scans[0].glob, "x*");
  const auto series = parsed(one_scan({{"folder", "f"}, {"series", 4}}));
  EXPECT_EQ(series->scans[0].series, "4");
  EXPECT_EQ(series->scans[0].paths, std::vector<std::string>{"f"});
  EXPECT_EQ(series->folder, "/data");
}

TEST(Collection, AScansParametersAreOverTheDefaultsAndTakeThemBack) {
  json value = one_scan("x");
  value["defaults"] = {{"threshold", 200}, {"surface", true}, {"preset", "bone"}, {"lines", false}};
  value["scans"][0]["parameters"] = {{"threshold", 180}, {"surface", false}, {"preset", nullptr}};
  EXPECT_EQ(parsed(value)->scans[0].parameters, (json{{"threshold", 180}}));
}

TEST(Collection, TheSecondScanOfANameIsRefusedAndBothAreNamed) {
  json value = one_scan("x");
  value["scans"].push_back(value["scans"][0]);
  const auto refused = parsed(value);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ExitCode::kUsage);
  EXPECT_EQ(refused.error().message,
            "/data/c.json: /scans/1/name: \"a\" is also the name of /scans/0");
}

TEST(Collection, AFirstOneLeavesOutWhatCannotBeUsedAndNamesEachScanOnce) {
  const auto scan = [](const char* kind, const char* path, bool usable) {
    return json{{"kind", kind}, {"path", path}, {"usable", usable}};
  };
  json list = {{"scans",
                {scan("nifti", "a/ct.nii.gz", true), scan("nifti", "a_ct.nii", true),
                 scan("nifti", "b.nii", false), scan("images", ".", true)}}};
  json series = scan("dicom", "dicom", true);
  series.update({{"uid", "1.2"}, {"number", 4}, {"localiser", false}});
  json localiser = series;
  localiser["localiser"] = true;
  list["scans"].push_back(series);
  list["scans"].push_back(localiser);
  const json made = first_collection(list, "/data/study", "/data");
  const auto read = test::take(parse_collection(made.dump(), "/data/c.json"));
  ASSERT_EQ(read.scans.size(), 4u);
  // Two scans that would have the same name have a digest of their paths, also if one is added later.
  const auto digest = [](const char* text) {
    return sha256_of(std::string_view(text)).substr(0, 12);
  };
  EXPECT_EQ(read.scans[0].name, "a_ct-" + digest("a/ct.nii.gz"));
  EXPECT_EQ(read.scans[0].paths[0], "study/a/ct.nii.gz");
  EXPECT_EQ(read.scans[1].name, "a_ct-" + digest("a_ct.nii"));
  EXPECT_EQ(read.scans[2].paths[0], "study");
  EXPECT_EQ(read.scans[3].name, "dicom_s4-" + digest("1.2"));
  EXPECT_EQ(read.scans[3].series, "1.2");
  series.update({{"path", "dicom/first.dcm"}, {"files", 1}});
  list = {{"scans", json::array({series})}};
  const json begun = first_collection(list, "/data/study", "/data");
  EXPECT_EQ(begun["scans"][0]["name"], read.scans[3].name);
  // A collection cannot state every path.
  std::vector<std::string> left_out;
  list = {{"scans", {scan("nifti", "new\nline.nii", true), scan("nifti", "\xe9.nii", true)}}};
  EXPECT_TRUE(first_collection(list, "/data", "/data", &left_out)["scans"].empty());
  EXPECT_EQ(left_out.size(), 2u);
  list = {{"scans", {scan("nifti", "a.nii", true)}}};
  EXPECT_EQ(first_collection(list, "/data", "")["scans"][0]["input"], "/data/a.nii");
}

}  // namespace
}  // namespace trocar::farm
