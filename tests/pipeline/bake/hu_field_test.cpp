// SPDX-License-Identifier: GPL-3.0-or-later
// The HU field compared with a dense least-squares solution.
#include "pipeline/bake/hu_field.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/refinement.h"
#include "formats/mesh/triangulation.h"
#include "tests/reference/decompositions/decompositions.h"
#include "tests/support/memory_stack.h"
#include "tests/support/take.h"
#include "tests/support/test_lattice.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <random>
#include <set>

namespace trocar::pipeline {
namespace {

using trocar::test::kLattice;

// A star-shaped ring about a place in mm, counter-clockwise, or clockwise as a hole.
Ring star(std::mt19937& random, double x_mm, double y_mm, double radius_mm, int corners,
          bool is_hole = false) {
  std::uniform_real_distribution<double> length(0.6, 1);
  Ring ring;
  for (int i = 0; i < corners; ++i) {
    const double turn = 2 * std::numbers::pi * (is_hole ? corners - i : i) / corners;
    const double r = radius_mm * length(random);
    ring.push_back(
        {kLattice.snap_mm(x_mm + r * std::cos(turn)), kLattice.snap_mm(y_mm + r * std::sin(turn))});
  }
  return ring;
}

SliceMesh meshed(const Pslg& pslg, double max_area_mm2 = 4) {
  EXPECT_TRUE(check_pslg(pslg));
  const auto cdt = triangulate(pslg);
  EXPECT_TRUE(cdt) << cdt.error().message;
  RefinementOptions options;
  options.max_area_mm2 = max_area_mm2;
  return refine(*cdt, kLattice, options).mesh;
}

// A ring with a hole, and an island beside it.
SliceMesh random_mesh(unsigned seed) {
  std::mt19937 random(seed);
  return meshed(
      {{star(random, 10, 10, 9, 12), star(random, 10, 10, 4, 7, true), star(random, 23, 9, 3, 5)}});
}

// The signs of the areas from a triangle's edges to the centre of a pixel: 1 left of the edge.
std::array<int, 3> sides(const SliceMesh& mesh, const PixelGrid& grid, std::uint32_t t, int x,
                         int y) {
  const LatticePoint p{grid.lattice.snap_mm((x + grid.offset_x) * grid.spacing_u_mm),
                       grid.lattice.snap_mm((y + grid.offset_y) * grid.spacing_v_mm)};
  std::array<int, 3> out{};
  for (std::size_t i = 0; i < 3; ++i) {
    const std::int64_t area = orient2d(mesh.vertices[mesh.triangles[t][i]],
                                       mesh.vertices[mesh.triangles[t][(i + 1) % 3]], p);
    out[i] = area > 0 ? 1 : (area < 0 ? -1 : 0);
  }
  return out;
}

// Every pixel against every triangle: exactly one has it if it lies in the mesh, and none if it
// lies outside; on the outline either.
void expect_rows(const SliceMesh& mesh, const PixelGrid& grid, int width, int height) {
  std::map<std::pair<int, int>, std::uint32_t> found;
  for (const PixelRow& row : pixel_rows(mesh, grid, width, height)) {
    ASSERT_TRUE(row.first_x >= 0 && row.first_x < row.end_x && row.end_x <= width && row.y >= 0 &&
                row.y < height);
    for (int x = row.first_x; x < row.end_x; ++x)
      EXPECT_TRUE(found.emplace(std::pair(x, row.y), row.triangle).second) << x << "," << row.y;
  }
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> uses;
  for (const Triangle& t : mesh.triangles)
    for (std::size_t i = 0; i < 3; ++i)
      ++uses[std::minmax(t[i], t[(i + 1) % 3])];
  std::set<std::uint32_t> on_boundary;
  for (const auto& [edge, count] : uses)
    if (count == 1) on_boundary.insert({edge.first, edge.second});

  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      bool is_inside = false, is_on_outline = false;
      std::set<std::uint32_t> candidates;
      for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
        const std::array<int, 3> s = sides(mesh, grid, t, x, y);
        if (*std::min_element(s.begin(), s.end()) < 0) continue;
        candidates.insert(t);
        is_inside = true;
        for (std::size_t i = 0; i < 3; ++i) {
          if (s[i] != 0) continue;
          const std::uint32_t a = mesh.triangles[t][i], b = mesh.triangles[t][(i + 1) % 3];
          const bool at_a = s[(i + 2) % 3] == 0, at_b = s[(i + 1) % 3] == 0;
          if (at_a || at_b) {
            is_on_outline = is_on_outline || on_boundary.contains(at_a ? a : b);
          } else {
            is_on_outline = is_on_outline || uses[std::minmax(a, b)] == 1;
          }
        }
      }
      const auto here = found.find({x, y});
      if (here != found.end()) {
        EXPECT_TRUE(candidates.contains(here->second)) << x << "," << y;
      } else {
        EXPECT_TRUE(!is_inside || is_on_outline) << x << "," << y;
      }
    }
  }
}

TEST(PixelRows, EveryPixelInTheMeshOnce) {
  for (unsigned seed = 0; seed < 8; ++seed) {
    expect_rows(random_mesh(seed), {0.7, 0.9, 0, 0, kLattice}, 40, 24);
    expect_rows(random_mesh(seed), {0.31, 0.5, 20, 11, kLattice}, 31, 17);  // a crop
  }
}

// Pixels whose centres are vertices and lie on edges of every direction.
TEST(PixelRows, CentresOnVerticesAndEdges) {
  const auto mm = [](int c) { return kLattice.snap_mm(c); };
  SliceMesh fan{{{mm(4), mm(4)}}, {}};
  constexpr int kAround[8][2] = {{8, 4}, {8, 8}, {4, 8}, {0, 8}, {0, 4}, {0, 0}, {4, 0}, {8, 0}};
  for (const auto& [x, y] : kAround)
    fan.vertices.push_back({mm(x), mm(y)});
  for (std::uint32_t i = 0; i < 8; ++i)
    fan.triangles.push_back({0, i + 1, (i + 1) % 8 + 1});
  ASSERT_TRUE(check_mesh(fan));
  const PixelGrid grid{1, 1, 0, 0, kLattice};
  expect_rows(fan, grid, 10, 10);
  // Half-open: a square of 8 x 8 pixels has 64 of them.
  std::int64_t pixels = 0;
  for (const PixelRow& row : pixel_rows(fan, grid, 10, 10))
    pixels += row.end_x - row.first_x;
  EXPECT_EQ(pixels, 64);
  expect_rows(meshed({{{{mm(1), mm(1)}, {mm(9), mm(3)}, {mm(7), mm(8)}, {mm(2), mm(7)}}}}, 1), grid,
              10, 10);
}

// All equations, one row for each pixel and each edge, solved by a dense QR decomposition.
Eigen::VectorXd by_dense_qr(const SliceMesh& mesh, const Image& hu, const PixelGrid& grid,
                            double smoothing) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, double> edges;  // 1, on the boundary 0.5
  for (const Triangle& t : mesh.triangles)
    for (std::size_t i = 0; i < 3; ++i)
      edges[std::minmax(t[i], t[(i + 1) % 3])] += 0.5;
  const std::vector<PixelRow> rows = pixel_rows(mesh, grid, hu.width, hu.height);
  Eigen::Index equations = static_cast<Eigen::Index>(edges.size());
  for (const PixelRow& row : rows)
    equations += row.end_x - row.first_x;
  Eigen::MatrixXd a =
      Eigen::MatrixXd::Zero(equations, static_cast<Eigen::Index>(mesh.vertices.size()));
  Eigen::VectorXd b = Eigen::VectorXd::Zero(equations);
  Eigen::Index k = 0;
  for (const PixelRow& row : rows) {
    for (int x = row.first_x; x < row.end_x; ++x, ++k) {
      Eigen::Matrix3d corners;
      for (int i = 0; i < 3; ++i) {
        const LatticePoint p = mesh.vertices[mesh.triangles[row.triangle][static_cast<size_t>(i)]];
        corners.col(i) = Eigen::Vector3d(kLattice.to_mm(p.x), kLattice.to_mm(p.y), 1);
      }
      const Eigen::Vector3d shares = reference::solve(
          corners, Eigen::Vector3d((x + grid.offset_x) * grid.spacing_u_mm,
                                   (row.y + grid.offset_y) * grid.spacing_v_mm, 1));
      for (int i = 0; i < 3; ++i)
        a(k, mesh.triangles[row.triangle][static_cast<size_t>(i)]) += shares[i];
      b[k] = hu.at(x, row.y);
    }
  }
  for (const auto& [edge, count] : edges) {
    a(k, edge.first) = std::sqrt(smoothing * count);
    a(k, edge.second) = -std::sqrt(smoothing * count);
    ++k;
  }
  return reference::least_squares(a, b);
}

TEST(HuField, EqualsDenseLeastSquares) {
  for (unsigned seed = 0; seed < 6; ++seed) {
    const SliceMesh mesh = random_mesh(seed);
    std::mt19937 random(seed + 100);
    std::uniform_real_distribution<double> noise(-300, 1500);
    const PixelGrid grid{0.6, 0.8, 2, 1, kLattice};
    const Image hu = image_of(45, 27, [&](int, int) { return noise(random); });
    for (const double smoothing : {0.01, 1.0}) {
      const Eigen::VectorXd expected = by_dense_qr(mesh, hu, grid, smoothing);
      const HuField fit = fit_hu_field(mesh, hu, grid, {smoothing, 0});
      ASSERT_EQ(fit.values.size(), mesh.vertices.size());
      for (std::size_t v = 0; v < fit.values.size(); ++v)
        ASSERT_NEAR(fit.values[v], expected[static_cast<Eigen::Index>(v)], 2e-3) << v;
      EXPECT_NEAR(fit.bias_hu, 0, 1e-3);

      // Rounded: to either neighbouring step, and without bias.
      const HuField field = fit_hu_field(mesh, hu, grid, {smoothing, kHuStep});
      for (std::size_t v = 0; v < fit.values.size(); ++v) {
        EXPECT_EQ(std::remainder(field.values[v], kHuStep), 0);
        EXPECT_LT(std::abs(field.values[v] - fit.values[v]), kHuStep);
      }
      EXPECT_LT(std::abs(field.bias_hu), 0.25 + 1e-3);
      EXPECT_LT(field.rms_hu, fit.rms_hu + kHuStep);
    }
  }
}

// Each connected part of a mesh as if it were alone, also where they are fitted in several groups
// (with one part that is larger than a group), whatever the order of vertices and triangles.
TEST(HuField, PartsDoNotDependOnEachOther) {
  constexpr int kAcross = 70;
  std::mt19937 random(11);
  std::uniform_real_distribution<double> noise(-300, 1500);
  const PixelGrid grid{0.5, 0.5, 0, 0, kLattice};
  const Image hu = image_of(960, 560, [&](int, int) { return noise(random); });
  const SliceMesh large = meshed({{star(random, 100, 100, 90, 40)}}, 0.25);
  ASSERT_GT(large.vertices.size(), 40'000U);
  std::vector<SliceMesh> parts{large};
  for (int i = 0; i < kAcross * kAcross; ++i) {
    const int column = i % kAcross, row = i / kAcross;
    parts.push_back(meshed({{star(random, 4 * column + 202, 4 * row + 2, 1.9, 9)}}));
  }
  std::vector<std::pair<std::size_t, std::size_t>> all;  // part, and vertex of it
  for (std::size_t k = 0; k < parts.size(); ++k)
    for (std::size_t v = 0; v < parts[k].vertices.size(); ++v)
      all.emplace_back(k, v);
  std::shuffle(all.begin(), all.end(), random);
  SliceMesh mesh;
  std::map<std::pair<std::size_t, std::size_t>, std::uint32_t> number;
  for (const auto& [k, v] : all) {
    number[{k, v}] = static_cast<std::uint32_t>(mesh.vertices.size());
    mesh.vertices.push_back(parts[k].vertices[v]);
  }
  for (std::size_t k = 0; k < parts.size(); ++k)
    for (const Triangle& t : parts[k].triangles)
      mesh.triangles.push_back({number[{k, t[0]}], number[{k, t[1]}], number[{k, t[2]}]});
  std::shuffle(mesh.triangles.begin(), mesh.triangles.end(), random);

  const HuField field = fit_hu_field(mesh, hu, grid, {0.01, 0});
  std::int64_t pixels = 0;
  for (std::size_t k = 0; k < parts.size(); ++k) {
    const HuField alone = fit_hu_field(parts[k], hu, grid, {0.01, 0});
    pixels += alone.pixels;
    for (std::size_t v = 0; v < parts[k].vertices.size(); ++v) {
      const float value = field.values[number[{k, v}]];
      ASSERT_NEAR(value, alone.values[v], 1e-3) << k << " " << v;
    }
  }
  EXPECT_EQ(field.pixels, pixels);
  EXPECT_NEAR(field.bias_hu, 0, 1e-3);
}

// The stated bias and error are those of the values over the pixels.
TEST(HuField, StatesItsError) {
  const SliceMesh mesh = random_mesh(3);
  std::mt19937 random(7);
  std::normal_distribution<double> noise(400, 200);
  const PixelGrid grid{0.5, 0.5, 0, 0, kLattice};
  const Image hu = image_of(56, 40, [&](int, int) { return noise(random); });
  const HuField field = fit_hu_field(mesh, hu, grid);
  double sum = 0, sum2 = 0, count = 0;
  for (const PixelRow& row : pixel_rows(mesh, grid, hu.width, hu.height)) {
    for (int x = row.first_x; x < row.end_x; ++x) {
      std::array<Eigen::Vector2d, 3> p;
      for (std::size_t i = 0; i < 3; ++i) {
        const LatticePoint q = mesh.vertices[mesh.triangles[row.triangle][i]];
        p[i] = {kLattice.to_mm(q.x), kLattice.to_mm(q.y)};
      }
      Eigen::Matrix2d sides;
      sides << p[1] - p[0], p[2] - p[0];
      const Eigen::Vector2d s = sides.inverse() * (Eigen::Vector2d(x * 0.5, row.y * 0.5) - p[0]);
      const Triangle& t = mesh.triangles[row.triangle];
      const double value = (1 - s[0] - s[1]) * field.values[t[0]] + s[0] * field.values[t[1]] +
                           s[1] * field.values[t[2]];
      const double error = value - hu.at(x, row.y);
      sum += error, sum2 += error * error, ++count;
    }
  }
  EXPECT_EQ(static_cast<double>(field.pixels), count);
  EXPECT_NEAR(field.bias_hu, sum / count, 1e-6);
  EXPECT_NEAR(field.rms_hu, std::sqrt(sum2 / count), 1e-6);
}

// Parts of the mesh with one pixel's centre or none.
TEST(HuField, TinyIslands) {
  const auto square = [](double x_mm, double y_mm, double side_mm) {
    const std::int32_t x0 = kLattice.snap_mm(x_mm), x1 = kLattice.snap_mm(x_mm + side_mm);
    const std::int32_t y0 = kLattice.snap_mm(y_mm), y1 = kLattice.snap_mm(y_mm + side_mm);
    return Ring{{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}};
  };
  const PixelGrid grid{2, 2, 0, 0, kLattice};
  const Image hu = image_of(10, 10, [](int x, int y) { return 8 * (10 * y + x); });
  // About the pixel (1, 1) alone, between pixels but near (3, 1), and about (1, 4) to (4, 7).
  const SliceMesh mesh = meshed({{square(1.5, 1.5, 1), square(6.1, 2.1, 0.7), square(1, 7, 8)}});
  const HuField field = fit_hu_field(mesh, hu, grid);
  EXPECT_EQ(field.pixels, 1 + 16);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const LatticePoint p = mesh.vertices[v];
    if (p.y > kLattice.snap_mm(5)) continue;
    EXPECT_EQ(field.values[v], p.x < kLattice.snap_mm(5) ? 88 : 104) << v;
  }

  // No pixel at all; and a mesh beyond the image's border.
  const SliceMesh between = meshed({{square(4.2, 4.2, 0.5)}});
  const HuField nearest = fit_hu_field(between, hu, grid);
  EXPECT_EQ(nearest.pixels, 0);
  EXPECT_EQ(nearest.bias_hu, 0);
  EXPECT_EQ(nearest.rms_hu, 0);
  for (const float value : nearest.values)
    EXPECT_EQ(value, 176);
  const HuField outside = fit_hu_field(meshed({{square(18.4, 18.4, 0.5)}}), hu, grid);
  for (const float value : outside.values)
    EXPECT_EQ(value, 792);
  EXPECT_TRUE(fit_hu_field({}, hu, grid).values.empty());
}

TEST(HuField, ExtremeValues) {
  const PixelGrid grid{0.7, 0.7, 0, 0, kLattice};
  const auto least = -std::numeric_limits<float>::max(), most = std::numeric_limits<float>::max();
  const std::vector<std::function<double(int, int)>> images = {
      [](int, int) { return 32767; },
      [](int, int) { return -32768; },
      [](int x, int y) { return (x + y) % 2 == 0 ? -32768 : 32767; },
      [](int x, int) { return x < 12 ? -32768 : 32767; },
      [&](int x, int y) { return (x * y) % 3 == 0 ? least : most; },
  };
  for (unsigned seed = 0; seed < 20; ++seed) {
    for (const auto& image : images) {
      const HuField field = fit_hu_field(random_mesh(seed), image_of(45, 35, image), grid);
      for (const float value : field.values) {
        EXPECT_EQ(value, stored_hu(value));
      }
      EXPECT_TRUE(std::isfinite(field.bias_hu) && std::isfinite(field.rms_hu));
    }
    // Far beyond what CT has, but within what is stored.
    const Image steep = image_of(45, 35, [](int x, int) { return x < 12 ? -1024 : 4096; });
    EXPECT_LT(std::abs(fit_hu_field(random_mesh(seed), steep, grid).bias_hu), 0.3);
  }
}

}  // namespace
}  // namespace trocar::pipeline
