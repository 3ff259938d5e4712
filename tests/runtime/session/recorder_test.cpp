// SPDX-License-Identifier: Apache-2.0
// The recorder alone: what it does when rows come faster than the disk takes them, and what it says
// about the space that is left. tests/e2e/console_trouble_test.py has a full disk.
#include "runtime/session/recorder.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <limits>
#include <string>
#include <thread>

#include "tests/support/file_size_limit.h"
#include "tests/support/temporary_folder.h"

namespace trocar::runtime {
namespace {

void tick(Recorder& recorder, std::size_t i) {
  TickResult result;
  result.row.t_s = static_cast<double>(i) / 1000;
  const LoopState state;
  const TickTiming timing{};
  const LateTicks::Counts late{};
  recorder.on_tick({result, state, {}, timing, late});
}

TEST(Recorder, RowsThatTheDiskIsTooSlowForAreAFailureAndTheRowsBeforeAreKept) {
  const test::TemporaryFolder folder;
  auto recorder = std::move(*Recorder::make(folder / "r.csv", {}, 1000));
  std::size_t i = 0;
  for (; i < Recorder::kCapacity; ++i)
    tick(*recorder, i);
  EXPECT_FALSE(recorder->has_failed());
  tick(*recorder, i++);
  EXPECT_TRUE(recorder->has_failed());
  recorder->serve();
  tick(*recorder, i++);  // after a gap
  const Result<void> finished = recorder->finish();
  ASSERT_FALSE(finished);
  EXPECT_EQ(finished.error().code, ExitCode::kUnwritable);
  const std::string file = (folder / "r.csv").string();
  EXPECT_EQ(finished.error().message,
            file + ": the disk is too slow for the rows; the first 8192 rows are in " + file);
  EXPECT_EQ(read_recording(file)->size(), Recorder::kCapacity);
}

TEST(Recorder, StatesHowMuchFitsOnceItHasRows) {
  const test::TemporaryFolder folder;
  auto recorder = std::move(*Recorder::make(folder / "r.csv", {}, 1000));
  recorder->serve();
  EXPECT_EQ(recorder->left_s(), std::numeric_limits<double>::infinity());
  tick(*recorder, 0);
  recorder->serve();
  EXPECT_GT(recorder->left_s(), 0);
  EXPECT_TRUE(std::isfinite(recorder->left_s()));
  EXPECT_TRUE(recorder->finish());
  EXPECT_EQ(folder.files(), 1U) << "the space that was held has no name";
}

TEST(Recorder, AFailureIsToldOnceAndStays) {
  const test::TemporaryFolder folder;
  auto recorder = std::move(*Recorder::make(folder / "r.csv", {}, 1000));
  {
    const test::FileSizeLimit limit(20'000);
    for (std::size_t i = 0; i < 500; ++i)
      tick(*recorder, i);
    recorder->serve();
    EXPECT_TRUE(recorder->has_failed());
  }
  // There is space again, so no row is missing at the end.
  const Result<void> finished = recorder->finish();
  ASSERT_FALSE(finished);
  const std::string file = (folder / "r.csv").string();
  EXPECT_EQ(finished.error().message, file + ": File too large; the first 500 rows are in " + file);
  EXPECT_EQ(read_recording(file)->size(), 500U);
}

// The black box alone: files hold the last rows unchanged while the haptic thread goes on writing; if it overwrites
// rows before they are copied, there is an error and no file.

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
