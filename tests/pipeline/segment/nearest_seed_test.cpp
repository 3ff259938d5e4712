// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/components.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <random>

namespace trocar::pipeline {
namespace {

struct Volume {
  VoxelGrid grid;
  std::vector<std::uint8_t> material;
};

Volume random_volume(std::mt19937_64& random, double share) {
  std::uniform_int_distribution<int> side(1, 8);
  Volume out;
  for (auto& at : out.grid.at_mm) {
    at.assign(1, 0);
    // Widths of eighths of a millimetre, so that the lengths of paths are exact.
    for (int i = side(random); i > 1; --i)
      at.push_back(at.back() + 0.125 * static_cast<double>(1 + random() % 24));
  }
  std::bernoulli_distribution is_set(share);
  for (std::size_t i = 0; i < out.grid.size(); ++i)
    out.material.push_back(is_set(random) ? 1 : 0);
  return out;
}

std::array<double, 3> place(const VoxelGrid& grid, std::size_t i) {
  const std::size_t nx = grid.count(0), ny = grid.count(1);
  return {grid.at_mm[0][i % nx], grid.at_mm[1][i / nx % ny], grid.at_mm[2][i / (nx * ny)]};
}

TEST(NearestSeed, KeepNearIsThatOfAllPairs) {
  std::mt19937_64 random(1);
  for (int run = 0; run < 200; ++run) {
    Volume v = random_volume(random, 0.7);
    const double margin = std::uniform_real_distribution<double>(0.2, 4)(random);
    std::vector<std::uint8_t> near, expected = v.material;
    for (std::size_t i = 0; i < v.grid.size(); ++i)
      near.push_back(random() % 20 == 0 ? 1 : 0);
    for (std::size_t i = 0; i < v.grid.size(); ++i) {
      bool stays = false;
      const auto a = place(v.grid, i);
      for (std::size_t k = 0; k < v.grid.size() && !stays; ++k) {
        const auto b = place(v.grid, k);
        stays = near[k] != 0 && std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]) <= margin;
      }
      if (!stays) expected[i] = 0;
    }
    keep_near(v.grid, near, margin, v.material);
    ASSERT_EQ(v.material, expected) << run;
  }
}

// Lengths of shortest paths by relaxation until nothing changes (Bellman and Ford).
std::vector<double> lengths(const Volume& v, std::size_t seed) {
  std::vector<double> out(v.grid.size(), std::numeric_limits<double>::infinity());
  out[seed] = 0;
  for (bool changes = true; changes;) {
    changes = false;
    for (std::size_t i = 0; i < out.size(); ++i) {
      if (v.material[i] == 0) continue;
      std::size_t stride = 1;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto& at = v.grid.at_mm[axis];
        const std::size_t k = i / stride % at.size();
        if (k + 1 < at.size() && v.material[i + stride] != 0) {
          const double step = at[k + 1] - at[k];
          if (out[i] + step < out[i + stride]) out[i + stride] = out[i] + step, changes = true;
          if (out[i + stride] + step < out[i]) out[i] = out[i + stride] + step, changes = true;
        }
        stride *= at.size();
      }
    }
  }
  return out;
}

TEST(NearestSeed, TheNearestSeedAlongPathsWins) {
  std::mt19937_64 random(2);
  int kept = 0, dropped = 0;
  for (int run = 0; run < 300; ++run) {
    Volume v = random_volume(random, 0.75);
    std::vector<std::size_t> material, seeds;
    for (std::size_t i = 0; i < v.material.size(); ++i)
      if (v.material[i] != 0) material.push_back(i);
    if (material.empty()) continue;
    for (std::size_t k = 1 + random() % 3; k > 0; --k)
      seeds.push_back(material[random() % material.size()]);
    std::vector<std::vector<double>> length;
    length.reserve(seeds.size());
    for (const std::size_t seed : seeds)
      length.push_back(lengths(v, seed));
    std::vector<std::uint8_t> expected(v.material.size(), 0);
    for (std::size_t i = 0; i < expected.size(); ++i) {
      bool first = std::isfinite(length[0][i]);
      for (const auto& other : length)
        first = first && length[0][i] <= other[i];
      expected[i] = first ? 1 : 0;
      ++(first ? kept : dropped);
    }
    keep_nearest_to_first(v.grid, seeds, v.material);
    ASSERT_EQ(v.material, expected) << run;
  }
  EXPECT_GT(kept, 1000);
  EXPECT_GT(dropped, 1000);
}

}  // namespace
}  // namespace trocar::pipeline
