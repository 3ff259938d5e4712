// SPDX-License-Identifier: Apache-2.0
#include "formats/session/trainee.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "formats/session/recording.h"
#include "tests/support/temporary_folder.h"

namespace trocar {
namespace {

RecordingRow row_of(double t_s, int xray) {
  RecordingRow row;
  row.t_s = t_s;
  row.xray = static_cast<std::uint8_t>(xray);
  return row;
}

std::string recording_of(const std::vector<RecordingRow>& rows, const RecordingOrigin& origin,
                         const std::filesystem::path& file) {
  auto writer = RecordingWriter::open(file, origin);
  EXPECT_TRUE(writer);
  EXPECT_TRUE(writer->append(rows));
  EXPECT_TRUE(writer->commit());
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

class XrayUseTest : public ::testing::Test {
 protected:
  test::TemporaryFolder folder_;
};

TEST_F(XrayUseTest, CountsShotsAndTicksOfScreening) {
  XrayUse use;
  for (const int xray : {0, 1, 0, 2, 2, 3, 2, 0, 1, 1})
    use.add(row_of(0, xray));
  EXPECT_EQ(use.shots, 4U);
  EXPECT_EQ(use.screening_ticks, 4U);
  EXPECT_DOUBLE_EQ(use.screening_s(500), 0.008);
  EXPECT_FALSE(use.is_screening);
}

TEST_F(XrayUseTest, IsTheSameFromTheRecording) {
  const RecordingOrigin origin{{{"program", "x"}, {kOriginXray, "counted"}}};
  std::vector<RecordingRow> rows;
  rows.reserve(20);
  for (int i = 0; i < 20; ++i)
    rows.push_back(row_of(i * 1e-3, i % 4));
  const std::string csv = recording_of(rows, origin, folder_.path() / "r.csv");
  const auto read = parse_recording(csv, "r.csv");
  ASSERT_TRUE(read) << read.error().message;
  for (std::size_t i = 0; i < rows.size(); ++i)
    EXPECT_EQ((*read)[i].xray, rows[i].xray);
}

TEST_F(XrayUseTest, ColumnIsOnlyInRecordingsThatCount) {
  const std::vector<RecordingRow> rows = {row_of(0, 1)};
  const std::string without = recording_of(rows, {}, folder_.path() / "r.csv");
  EXPECT_EQ(without.find("xray"), std::string::npos);
  const auto read = parse_recording(without, "r.csv");
  ASSERT_TRUE(read);
  EXPECT_EQ(read->front().xray, 0);
}

TEST_F(XrayUseTest, UnknownNumbersAreRefused) {
  const RecordingOrigin origin{{{kOriginXray, "counted"}}};
  std::string csv = recording_of({row_of(0, 3)}, origin, folder_.path() / "r.csv");
  const std::size_t at = csv.rfind(",3,");
  ASSERT_NE(at, std::string::npos);
  csv[at + 1] = '4';
  const auto read = parse_recording(csv, "r.csv");
  ASSERT_FALSE(read);
  EXPECT_NE(read.error().message.find("is an unknown number"), std::string::npos)
      << read.error().message;
}

}  // namespace
}  // namespace trocar
