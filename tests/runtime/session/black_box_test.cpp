// SPDX-License-Identifier: Apache-2.0
// The black box alone: files hold the last rows unchanged while the haptic thread goes on writing;
// if it overwrites rows before they are copied, there is an error and no file.
#include "runtime/session/recorder.h"
#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <thread>

namespace trocar::runtime {
namespace {

namespace fs = std::filesystem;

class BlackBoxTest : public testing::Test {
 protected:
  static RecordingRow row(std::uint64_t i) {
    RecordingRow row;
    // The row's number in its first and last columns.
    row.t_s = static_cast<double>(i);
    row.cuts_published = static_cast<std::int64_t>(i);
    row.motor_heat_max = static_cast<double>(i);
    return row;
  }
  static void expect_rows(const BlackBoxFile& file, std::uint64_t first, std::uint64_t end) {
    ASSERT_FALSE(file.error) << file.error->message;
    const auto rows = read_recording(file.file);
    ASSERT_TRUE(rows) << rows.error().message;
    ASSERT_EQ(rows->size(), end - first);
    for (std::uint64_t i = first; i < end; ++i) {
      const RecordingRow& got = (*rows)[i - first];
      ASSERT_EQ(got.t_s, static_cast<double>(i));
      ASSERT_EQ(got.cuts_published, static_cast<std::int64_t>(i));
      ASSERT_EQ(got.motor_heat_max, static_cast<double>(i));
    }
  }
  test::TemporaryFolder temporary_;
  fs::path folder_ = temporary_.path();
};

TEST_F(BlackBoxTest, HoldsTheLastFourSecondsOrTheWholeSession) {
  auto box = std::move(*BlackBox::make(folder_, 100));
  std::uint64_t i = 0;
  for (; i < 50; ++i)
    box->push(row(i));
  ASSERT_TRUE(box->save(Fault::kSpeed, 0.49));
  box->serve();
  for (; i < 1234; ++i)
    box->push(row(i));
  ASSERT_TRUE(box->save(Fault::kSpeed, 12.33));
  ASSERT_TRUE(box->save(Fault::kSpeed, 12.33));  // the same name again
  for (; i < 1500; ++i)
    box->push(row(i));  // later rows are not in the files
  box->stop();
  ASSERT_EQ(box->files().size(), 3U);
  expect_rows(box->files()[0], 0, 50);
  expect_rows(box->files()[1], 834, 1234);
  expect_rows(box->files()[2], 834, 1234);
  EXPECT_NE(box->files()[1].file, box->files()[2].file);
  const std::string name = box->files()[1].file.filename().string();
  EXPECT_EQ(name.rfind("black_box_2", 0), 0U) << name;
  EXPECT_NE(name.find("Z_t12.3300s_speed.csv"), std::string::npos) << name;
}

TEST_F(BlackBoxTest, OverwrittenRowsAreAnErrorWithoutAFile) {
  for (const std::uint64_t more : {400U, 399U}) {
    auto box = std::move(*BlackBox::make(folder_, 100));
    for (std::uint64_t i = 0; i < 1000 + more; ++i) {
      if (i == 1000) {
        ASSERT_TRUE(box->save(Fault::kNoData, 10));
      }
      box->push(row(i));
    }
    box->stop();
    ASSERT_EQ(box->files().size(), 1U);
    if (more == 399) {
      expect_rows(box->files()[0], 600, 1000);
    } else {
      EXPECT_TRUE(box->files()[0].error);
      EXPECT_FALSE(fs::exists(box->files()[0].file));
    }
  }
}

TEST_F(BlackBoxTest, ManyFaultsWhileRowsArrive) {
  auto box = std::move(*BlackBox::make(folder_, 500));
  box->start();
  std::uint64_t i = 0;
  for (int fault = 0; fault < 20; ++fault) {
    for (int k = 0; k < 150; ++k)
      box->push(row(i++));
    ASSERT_TRUE(box->save(static_cast<Fault>(1 + fault % (kFaults - 1)), static_cast<double>(i)));
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  box->stop();
  ASSERT_EQ(box->files().size(), 20U);
  EXPECT_EQ(box->lost(), 0U);
  for (std::uint64_t fault = 0; fault < 20; ++fault) {
    const std::uint64_t end = 150 * (fault + 1);
    expect_rows(box->files()[fault], end - std::min<std::uint64_t>(end, 2000), end);
  }
}

TEST_F(BlackBoxTest, AnUnwritableFolderIsAnErrorOfMake) {
  const auto none = BlackBox::make(folder_ / "no", 1000);
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ExitCode::kUnwritable);
  auto box = std::move(*BlackBox::make(folder_, 1000));
  box->push(row(0));
  fs::remove_all(folder_);
  ASSERT_TRUE(box->save(Fault::kSpeed, 0));
  box->stop();
  ASSERT_TRUE(box->files()[0].error) << "the folder was removed during the session";
}

}  // namespace
}  // namespace trocar::runtime
