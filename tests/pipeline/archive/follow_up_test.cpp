// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/archive/follow_up.h"

#include <gtest/gtest.h>

#include "pipeline/farm/collection.h"
#include "tests/pipeline/archive/archive_files.h"
#include "tests/support/temporary_folder.h"

namespace trocar::archive {
namespace {

using nlohmann::json;

const json kList = {{"scans",
                     {{{"kind", "dicom"},
                       {"path", "."},
                       {"uid", "1.2.3"},
                       {"number", 4},
                       {"usable", true},
                       {"localiser", false},
                       {"description", "SECRET"}},
                      {{"kind", "dicom"},
                       {"path", "."},
                       {"uid", "1.2.4"},
                       {"number", 1},
                       {"usable", true},
                       {"localiser", true}},
                      {{"kind", "dicom"},
                       {"path", "."},
                       {"uid", "1.2.5"},
                       {"number", 5},
                       {"usable", false},
                       {"localiser", false}}}}};

Result<nlohmann::ordered_json> with(const std::string& text, std::vector<std::string>& names) {
  return with_study(text, "/data/c.json", kList, "/data/scans/2.25.1", "/data", "2.25.1", names);
}

TEST(FollowUp, MakesACollectionOfTheUsableScans) {
  std::vector<std::string> names;
  const auto made = with("", names);
  ASSERT_TRUE(made);
  ASSERT_EQ(names.size(), 1U);
  EXPECT_EQ(names[0].rfind("2.25.1_", 0), 0U);
  EXPECT_TRUE(farm::is_scan_name(names[0]));
  const std::string text = made->dump();
  EXPECT_EQ(text.find("SECRET"), std::string::npos);
  const auto read = farm::parse_collection(text, "/data/c.json");
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->scans.size(), 1U);
  EXPECT_EQ(read->scans[0].name, names[0]);
  EXPECT_EQ(read->scans[0].paths, std::vector<std::string>{"scans/2.25.1"});
  EXPECT_EQ(read->scans[0].series, "1.2.3");
}

TEST(FollowUp, KeepsDefaultsOtherScansParametersAndProducts) {
  std::vector<std::string> names, again;
  ASSERT_TRUE(with("", names));
  const std::string before =
      R"({"schema": "trocar.collection/1", "scans": [{"name": "mine", "input": "x.nii"}, {"name": ")" +
      names[0] +
      R"(", "input": "gone", "parameters": {"threshold": 180}, "products": []}], "defaults": {"tolerance": 0.5}})";
  const auto made = with(before, again);
  ASSERT_TRUE(made);
  EXPECT_EQ(again, names);
  const json result = json::parse(made->dump());
  EXPECT_EQ(result["defaults"], json({{"tolerance", 0.5}}));
  ASSERT_EQ(result["scans"].size(), 2U);
  EXPECT_EQ(result["scans"][0]["name"], "mine");
  EXPECT_EQ(result["scans"][1]["parameters"], json({{"threshold", 180}}));
  EXPECT_EQ(result["scans"][1]["products"], json::array());
  EXPECT_EQ(result["scans"][1]["input"]["folder"], "scans/2.25.1");
}

// The first slice of a slow sender can be published alone.
TEST(FollowUp, NameOfASeriesStaysTheSameWhenMoreOfItsFilesArrive) {
  const test::TemporaryFolder base;
  const std::filesystem::path folder = base / "scans" / kStudy;
  write_text(folder / "1.dcm", "a slice");
  json list = kList;
  list["scans"][0]["path"] = "1.dcm";
  std::vector<std::string> first, second;
  const auto one = with_study("", base / "c.json", list, folder, base.path(), kStudy, first);
  ASSERT_TRUE(one);
  const json before = json::parse(one->dump());
  EXPECT_EQ(before["scans"][0]["input"], "scans/2.25.1/1.dcm");
  write_text(folder / "2.dcm", "another slice");
  list["scans"][0]["path"] = ".";
  const auto two =
      with_study(one->dump(), base / "c.json", list, folder, base.path(), kStudy, second);
  ASSERT_TRUE(two);
  const json after = json::parse(two->dump());
  ASSERT_EQ(after["scans"].size(), 1U);
  EXPECT_EQ(after["scans"][0]["input"]["series"], "1.2.3");
  EXPECT_EQ(second, first);
  std::vector<std::string> as_before;  // the name of a series with several files
  ASSERT_TRUE(with("", as_before));
  EXPECT_EQ(second, as_before);
}

TEST(FollowUp, RefusesWhatIsNoCollection) {
  std::vector<std::string> names;
  const auto made = with("{}", names);
  ASSERT_FALSE(made);
  EXPECT_EQ(made.error().code, ExitCode::kUsage);
}

}  // namespace
}  // namespace trocar::archive
