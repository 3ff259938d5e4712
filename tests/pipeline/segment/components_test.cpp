// SPDX-License-Identifier: GPL-3.0-or-later
// Components, nearest seeds and floods compared with their definitions by brute force.
#include "pipeline/segment/components.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
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

using Bytes = std::vector<std::uint8_t>;

struct Case {
  std::vector<double> u_mm, v_mm;
  Bytes solid;
  PlaneGrid grid() const { return {u_mm, v_mm}; }
  double apart2(std::size_t a, std::size_t b) const {
    const double u = u_mm[a % u_mm.size()] - u_mm[b % u_mm.size()];
    const double v = v_mm[a / u_mm.size()] - v_mm[b / u_mm.size()];
    return u * u + v * v;
  }
};

std::vector<double> positions(std::mt19937_64& random, std::size_t n, bool even) {
  std::uniform_real_distribution<double> width(0.4, 2.5);
  const double same = width(random);
  std::vector<double> at{0};
  while (at.size() < n)
    at.push_back(at.back() + (even ? same : width(random)));
  return at;
}

Case random_case(std::mt19937_64& random, double share) {
  std::uniform_int_distribution<std::size_t> side(1, 24);
  Case out;
  out.u_mm = positions(random, side(random), random() % 2 == 0);
  out.v_mm = positions(random, side(random), random() % 2 == 0);
  std::bernoulli_distribution is_solid(share);
  for (std::size_t i = 0; i < out.grid().size(); ++i)
    out.solid.push_back(is_solid(random) ? 1 : 0);
  return out;
}

// Every pair of pixels.
double nearest2(const Case& c, const Bytes& set, std::size_t from) {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < set.size(); ++i)
    if (set[i] != 0) least = std::min(least, c.apart2(from, i));
  return least;
}

// Grows `seed` through `open` by edges until nothing changes.
Bytes grown(const Case& c, Bytes seed, const Bytes& open) {
  const std::size_t width = c.u_mm.size();
  for (bool changes = true; changes;) {
    changes = false;
    for (std::size_t i = 0; i < seed.size(); ++i) {
      if (seed[i] != 0 || open[i] == 0) continue;
      const bool touches =
          (i % width > 0 && seed[i - 1] != 0) || (i % width + 1 < width && seed[i + 1] != 0) ||
          (i >= width && seed[i - width] != 0) || (i + width < seed.size() && seed[i + width] != 0);
      if (touches) seed[i] = 1, changes = true;
    }
  }
  return seed;
}

// The definition in plane_flood.h, by brute force: the Enclosure of each pixel.
Bytes enclosed_by_definition(const Case& c, double radius_mm, double largest_mm2) {
  const std::size_t width = c.u_mm.size(), height = c.v_mm.size(), n = c.solid.size();
  const double radius2 = radius_mm * radius_mm * (1 + 2e-6);
  Bytes open(n), border(n, 0), rest(n), out(n, 0);
  for (std::size_t i = 0; i < n; ++i) {
    open[i] = nearest2(c, c.solid, i) > radius2 ? 1 : 0;
    const std::size_t x = i % width, y = i / width;
    border[i] = open[i] != 0 && (x == 0 || y == 0 || x + 1 == width || y + 1 == height) ? 1 : 0;
  }
  const Bytes outside = grown(c, border, open);
  Bytes free(n), free_border(n);
  for (std::size_t i = 0; i < n; ++i) {
    free[i] = c.solid[i] == 0 ? 1 : 0;
    const std::size_t x = i % width, y = i / width;
    const bool is_border = x == 0 || y == 0 || x + 1 == width || y + 1 == height;
    free_border[i] = is_border ? free[i] : 0;
  }
  const Bytes connected = grown(c, free_border, free);
  for (std::size_t i = 0; i < n; ++i)
    rest[i] = c.solid[i] == 0 && nearest2(c, outside, i) > radius2 ? 1 : 0;
  const auto cell = [](const std::vector<double>& at, std::size_t i) {
    if (at.size() < 2) return 1.0;
    if (i == 0) return at[1] - at[0];
    if (i + 1 == at.size()) return at[i] - at[i - 1];
    return 0.5 * (at[i + 1] - at[i - 1]);
  };
  for (std::size_t i = 0; i < n; ++i) {
    if (rest[i] == 0) continue;
    Bytes seed(n, 0);
    seed[i] = 1;
    const Bytes patch = grown(c, seed, rest);
    double area = 0;
    bool fits = false;
    for (std::size_t k = 0; k < n; ++k) {
      if (patch[k] == 0) continue;
      area += cell(c.u_mm, k % width) * cell(c.v_mm, k / width);
      fits = fits || open[k] != 0;
    }
    if (area <= largest_mm2)
      out[i] = connected[i] == 0 ? kSurrounded : fits ? kBehindGap : kInCrevice;
  }
  return out;
}

TEST(PlaneFlood, DistancesAreThoseOfAllPairs) {
  std::mt19937_64 random(1);
  for (int run = 0; run < 300; ++run) {
    const Case c = random_case(random, run % 3 == 0 ? 0.01 : 0.2);
    std::vector<float> squared;
    squared_distances(c.grid(), c.solid, squared);
    for (std::size_t i = 0; i < squared.size(); ++i) {
      const double expected = nearest2(c, c.solid, i);
      if (std::isinf(expected)) {
        ASSERT_TRUE(std::isinf(squared[i]));
      } else {
        ASSERT_NEAR(squared[i], expected, 1e-6 * (1 + expected));
      }
    }
  }
}

TEST(PlaneFlood, EnclosedIsWhatItsDefinitionSays) {
  std::mt19937_64 random(2);
  std::array<int, 4> found{};  // by Enclosure
  for (int run = 0; run < 300; ++run) {
    const Case c = random_case(random, run % 2 == 0 ? 0.45 : 0.15);
    const double radius = run % 3 == 0 ? 0 : std::uniform_real_distribution<double>(0.3, 4)(random);
    const double largest = run % 5 == 0 ? 6 : 1e9;
    Bytes enclosed;
    find_enclosed(c.grid(), c.solid, radius, largest, enclosed);
    ASSERT_EQ(enclosed, enclosed_by_definition(c, radius, largest)) << run;
    for (const std::uint8_t how : enclosed)
      ++found[how];
  }
  for (const int count : found)
    EXPECT_GT(count, 500);
}

TEST(PlaneFlood, DistancesOfAFloodAreRightAsFarAsTheyAreAskedFor) {
  std::mt19937_64 random(3);
  for (int run = 0; run < 200; ++run) {
    const Case c = random_case(random, 0.1);
    // Above some radius the flood measures by envelopes.
    const double radius = run % 4 == 0 ? 200 : std::uniform_real_distribution<double>(0, 4)(random);
    const double near_mm = std::uniform_real_distribution<double>(0, 6)(random);
    Bytes enclosed;
    std::vector<float> squared;
    find_enclosed(c.grid(), c.solid, radius, 1e9, enclosed, near_mm, &squared);
    for (std::size_t i = 0; i < squared.size(); ++i) {
      const double expected = nearest2(c, c.solid, i);
      if (expected <= near_mm * near_mm) {
        ASSERT_NEAR(squared[i], expected, 1e-6 * (1 + expected));
      } else {
        ASSERT_GT(squared[i], near_mm * near_mm);
      }
    }
  }
}

}  // namespace
}  // namespace trocar::pipeline
