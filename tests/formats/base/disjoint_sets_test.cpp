// SPDX-License-Identifier: Apache-2.0
#include "formats/base/disjoint_sets.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <random>
#include <vector>

namespace trocar {
namespace {

// Random joins against sets kept as the least member of each number, rewritten at every join.
TEST(DisjointSets, AreThoseOfNumbersRenamedAtEachJoin) {
  std::mt19937 random(1);
  for (std::uint32_t size : {1U, 2U, 7U, 60U, 400U}) {
    DisjointSets sets(size);
    ASSERT_EQ(sets.size(), size);
    std::vector<std::uint32_t> least(size);
    for (std::uint32_t i = 0; i < size; ++i)
      least[i] = i;
    std::uniform_int_distribution<std::uint32_t> number(0, size - 1);
    for (std::uint32_t k = 0; k < 2 * size; ++k) {
      const std::uint32_t a = number(random), b = number(random), from = least[a], to = least[b];
      EXPECT_EQ(sets.join(a, b), from != to);
      for (std::uint32_t& l : least) {
        if (l == from || l == to) l = std::min(from, to);
      }
      for (std::uint32_t i = 0; i < size; ++i)
        ASSERT_EQ(sets.root(i), least[i]) << i << " of " << size;
    }
  }
}

TEST(DisjointSets, ARootCanBeChosen) {
  DisjointSets sets(4);
  EXPECT_TRUE(sets.join(0, 1));
  sets.put_under(3, 0);
  for (const std::uint32_t i : {0U, 1U, 3U})
    EXPECT_EQ(sets.root(i), 3U);
  EXPECT_EQ(sets.root(2), 2U);
}

}  // namespace
}  // namespace trocar
