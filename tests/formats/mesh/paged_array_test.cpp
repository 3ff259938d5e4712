// SPDX-License-Identifier: Apache-2.0
// The contract of formats/mesh/sheet_mesh.h (PagedArray), compared with std::vector under random writes to copies of
// copies.
#include "formats/mesh/sheet_mesh.h"

#include <gtest/gtest.h>

#include <thread>
#include <vector>

#include "runtime/realtime/realtime_thread.h"
#include "tests/support/counted_allocations.h"
#include "tests/support/random_geometry.h"

namespace trocar::runtime {
namespace {

using Array = PagedArray<int>;

void expect_equal(const Array& array, const std::vector<int>& wanted) {
  ASSERT_EQ(array.size(), wanted.size());
  ASSERT_TRUE(std::equal(array.begin(), array.end(), wanted.begin(), wanted.end()));
}

TEST(PagedArray, CopiesNeverChangeEachOther) {
  Random random(5);
  std::vector<Array> arrays(4);
  std::vector<std::vector<int>> wanted(4);
  const auto one = [&] { return static_cast<std::size_t>(random.between(0, 3)); };
  for (int round = 0; round < 20'000; ++round) {
    const std::size_t k = one(), other = one();
    switch (random.between(0, 5)) {
      case 0: {
        const auto size = static_cast<std::size_t>(random.between(0, 1500));
        arrays[k].resize(size, round);
        wanted[k].resize(size, round);
        break;
      }
      case 1:
        arrays[k] = arrays[other];
        wanted[k] = wanted[other];
        break;
      case 2: {
        Array moved(std::move(arrays[k]));
        arrays[k] = std::move(moved);
        break;
      }
      case 3:
        arrays[k].reserve_pages(static_cast<std::size_t>(random.between(0, 3)));
        break;
      default:
        if (wanted[k].empty()) break;
        const auto at =
            static_cast<std::size_t>(random.between(0, static_cast<int>(wanted[k].size()) - 1));
        arrays[k][at] = round;
        wanted[k][at] = round;
    }
    if (round % 50 == 0)
      for (std::size_t i = 0; i < 4; ++i)
        expect_equal(arrays[i], wanted[i]);
  }
  EXPECT_EQ(Array(wanted[0]) == arrays[0], true);
  EXPECT_EQ(arrays[0] == Array(std::size_t{3}, -1), false);
}

TEST(PagedArray, ACopySharesItsPages) {
  Array first(100'000, 7);
  for (std::size_t i = 0; i < first.size(); ++i)
    first[i] = 7;  // the pages of a new array are one
  std::vector<Array> copies(10, first);
  const Array& read = first;
  const int* const at = &read[50'000];
  for (Array& copy : copies) {
    const Array& its = copy;
    EXPECT_EQ(&its[50'000], at);
    copy[0] = 1;
    EXPECT_EQ(&its[50'000], at) << "a write to another page";
  }
  copies.clear();
  first[50'000] = 8;
  EXPECT_EQ(&read[50'000], at) << "the last owner writes in place";
}

TEST(PagedArray, AWriteToAReservedPageDoesNotAllocate) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  const Array first(2000, 7);
  Array copy = first;
  copy.reserve_pages(3);
  EXPECT_EQ(allocations_of([&] {
              copy[0] = copy[1000] = copy[1999] = 1;
              copy[1] = 2;
            }),
            0U);
  EXPECT_GT(allocations_of([&] { copy[600] = 1; }), 0U) << "the fourth page was not reserved";
}

// A reader of the published array, while the other one is written to. The thread sanitizer sees a race.
TEST(PagedArray, AnArrayIsReadWhileItsCopyIsWrittenTo) {
  const Array published(5000, 3);
  Array other = published;
  std::thread writer([&] {
    for (std::size_t i = 0; i < 5000; ++i)
      other[i] = static_cast<int>(i);
  });
  long sum = 0;
  for (int round = 0; round < 20; ++round)
    for (const int each : published)
      sum += each;
  writer.join();
  EXPECT_EQ(sum, 20L * 5000 * 3);
}

}  // namespace
}  // namespace trocar::runtime
