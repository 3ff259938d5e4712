// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/components.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <numeric>
#include <random>

namespace trocar::pipeline {
namespace {

VoxelGrid random_grid(std::mt19937_64& random) {
  std::uniform_int_distribution<int> side(1, 9);
  std::uniform_real_distribution<double> width(0.5, 3);
  VoxelGrid grid;
  for (auto& at : grid.at_mm) {
    at.assign(1, 0);
    for (int i = side(random); i > 1; --i)
      at.push_back(at.back() + width(random));
  }
  return grid;
}

// Numbers the voxels by relaxation: each takes the least number among its 26 neighbours.
std::vector<std::size_t> relaxed(const VoxelGrid& grid, const std::vector<std::uint8_t>& voxels) {
  const auto nx = static_cast<int>(grid.count(0)), ny = static_cast<int>(grid.count(1)),
             nz = static_cast<int>(grid.count(2));
  std::vector<std::size_t> number(voxels.size());
  std::iota(number.begin(), number.end(), 0U);
  const auto index = [&](int x, int y, int z) {
    return (static_cast<std::size_t>(z) * ny + y) * nx + x;
  };
  for (bool changes = true; changes;) {
    changes = false;
    for (int i = 0; i < nx * ny * nz; ++i) {
      const int x = i % nx, y = i / nx % ny, z = i / (nx * ny);
      for (int n = 0; n < 27; ++n) {
        const int a = x + n % 3 - 1, b = y + n / 3 % 3 - 1, c = z + n / 9 - 1;
        if (a < 0 || b < 0 || c < 0 || a >= nx || b >= ny || c >= nz) continue;
        const std::size_t me = index(x, y, z), other = index(a, b, c);
        if (voxels[me] == 0 || voxels[other] == 0 || number[other] >= number[me]) continue;
        number[me] = number[other];
        changes = true;
      }
    }
  }
  return number;
}

TEST(VoxelComponents, AreThoseOfRelaxation) {
  std::mt19937_64 random(1);
  std::size_t most = 0;
  for (int run = 0; run < 400; ++run) {
    const VoxelGrid grid = random_grid(random);
    std::bernoulli_distribution is_set(run % 2 == 0 ? 0.15 : 0.45);
    std::vector<std::uint8_t> voxels;
    for (std::size_t i = 0; i < grid.size(); ++i)
      voxels.push_back(is_set(random) ? 1 : 0);
    const VoxelComponents pieces = find_components(grid, voxels);
    const std::vector<std::size_t> expected = relaxed(grid, voxels);
    std::vector<std::size_t> first(pieces.volume_mm3.size(), grid.size());
    std::vector<double> volume(pieces.volume_mm3.size(), 0);
    std::vector<std::uint8_t> covered(grid.size(), 0);
    for (const VoxelComponents::Run& piece : pieces.runs) {
      for (std::size_t i = piece.begin; i < piece.end; ++i) {
        covered[i] = 1;
        std::size_t& begin = first[piece.component];
        if (begin == grid.size()) begin = expected[i];
        ASSERT_EQ(begin, expected[i]) << run;
        volume[piece.component] += grid.width_mm(0, i % grid.count(0)) *
                                   grid.width_mm(1, i / grid.count(0) % grid.count(1)) *
                                   grid.width_mm(2, i / (grid.count(0) * grid.count(1)));
      }
    }
    ASSERT_EQ(covered, voxels);
    for (std::size_t p = 0; p < first.size(); ++p) {
      ASSERT_NEAR(pieces.volume_mm3[p], volume[p], 1e-9);
      if (p > 0) {
        ASSERT_LT(first[p - 1], first[p]);
      }  // different pieces, in their order
    }
    most = std::max(most, first.size());
  }
  EXPECT_GT(most, 5U);
}

}  // namespace
}  // namespace trocar::pipeline
