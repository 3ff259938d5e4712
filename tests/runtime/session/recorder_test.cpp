// SPDX-License-Identifier: Apache-2.0
// The recorder alone: what it does when rows come faster than the disk takes them, and what it says
// about the space that is left. tests/e2e/console_trouble_test.py has a full disk.
#include "runtime/session/recorder.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cmath>
#include <limits>
#include <string>

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

}  // namespace
}  // namespace trocar::runtime
