// SPDX-License-Identifier: Apache-2.0
// Each way in which a mesh can be invalid, one by one. Outlines: outline_sweep_test.cpp.
#include "formats/mesh/mesh_validity.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>
#include <set>
#include <span>
#include <utility>

#include "formats/mesh/edge_table.h"

namespace trocar {
namespace {

SliceMesh square() {
  return {{{0, 0}, {10, 0}, {10, 10}, {0, 10}}, {{0, 1, 2}, {0, 2, 3}}};
}
Pslg square_outline() {
  return {{{{0, 0}, {10, 0}, {10, 10}, {0, 10}}}};
}

void expect_refused(const Result<void>& result, const std::string& why) {
  ASSERT_FALSE(result);
  EXPECT_NE(result.error().message.find(why), std::string::npos) << result.error().message;
}

TEST(CheckMesh, AcceptsASquareAndTheEmptyMesh) {
  EXPECT_TRUE(check_mesh(square()));
  EXPECT_TRUE(check_mesh({}));
  EXPECT_TRUE(check_mesh_against_pslg(square(), square_outline()));
}

TEST(CheckMesh, NamesEachDefect) {
  SliceMesh m = square();
  m.triangles[1] = {0, 2, 4};
  expect_refused(check_mesh(m), "vertex index 4 of 4");
  m = square();
  std::swap(m.triangles[0][0], m.triangles[0][1]);
  expect_refused(check_mesh(m), "without positive area");
  m = square();
  m.vertices.push_back({5, 5});
  expect_refused(check_mesh(m), "unused vertex");
  m = square();
  m.triangles.push_back({0, 1, 2});
  expect_refused(check_mesh(m), "used twice");
  m = square();
  m.vertices[2].x = kMaxCoordinate + 1;
  expect_refused(check_mesh(m), "outside the lattice's range");
}

TEST(CheckMesh, RequiresTwoVerticesAtAPinch) {
  SliceMesh bow_tie{{{0, 0}, {10, 0}, {5, 5}, {10, 10}, {0, 10}}, {{0, 1, 2}, {2, 3, 4}}};
  expect_refused(check_mesh(bow_tie), "share a vertex");
  bow_tie.vertices.push_back({5, 5});
  bow_tie.triangles[1] = {5, 3, 4};
  EXPECT_TRUE(check_mesh(bow_tie));
  EXPECT_EQ(boundary_rings(bow_tie).rings.size(), 2U);
}

TEST(CheckMesh, RefusesOverlappingTriangles) {
  const SliceMesh m{{{0, 0}, {10, 0}, {0, 10}, {1, 1}, {12, 1}, {1, 12}}, {{0, 1, 2}, {3, 4, 5}}};
  expect_refused(check_mesh(m), "boundary edges cross");
}

TEST(CheckMeshAgainstPslg, FindsMissingEdgesAndOverlap) {
  Pslg moved = square_outline();
  moved.rings[0][2] = {10, 11};
  expect_refused(check_mesh_against_pslg(square(), moved), "differ");
  // A small copy on top of the square: no edges cross, but the material is there twice.
  SliceMesh twice = square();
  Pslg outline = square_outline();
  const Ring inner = {{2, 2}, {4, 2}, {4, 4}};
  twice.vertices.insert(twice.vertices.end(), inner.begin(), inner.end());
  twice.triangles.push_back({4, 5, 6});
  outline.rings.push_back(inner);
  EXPECT_TRUE(check_mesh(twice));
  expect_refused(check_mesh_against_pslg(twice, outline), "an outer ring inside material");
}

TEST(BoundaryRings, SplitWhereTheBoundaryTouchesItself) {
  // An annulus whose hole touches the outer boundary in (0, 0): two simple rings.
  const SliceMesh m{{{0, 0}, {8, 0}, {8, 8}, {0, 8}, {2, 4}, {4, 2}, {0, 0}},
                    {{0, 1, 5}, {1, 2, 5}, {5, 2, 4}, {4, 2, 3}, {6, 4, 3}}};
  ASSERT_TRUE(check_mesh(m)) << check_mesh(m).error().message;
  const Pslg rings = boundary_rings(m);
  ASSERT_EQ(rings.rings.size(), 2U);
  EXPECT_TRUE(check_mesh_against_pslg(m, rings));
  EXPECT_EQ(doubled_area(rings), doubled_area(m));
}

// A band wound into a square spiral over the whole lattice. Partial sums of the area exceed 64
// bits; the whole, summed in 128 bits, does not.
TEST(DoubledArea, IsExactForASpiralOverTheWholeLattice) {
  constexpr std::int32_t kTurns = 40, kStep = kMaxCoordinate / kTurns, kWidth = kStep / 2;
  Ring outer, inner;
  for (std::int32_t turn = 0; turn + 1 < kTurns; ++turn) {
    const std::int32_t r = kMaxCoordinate - turn * kStep, s = r - kWidth;
    for (const auto& [ring, h] : {std::pair(&outer, r), std::pair(&inner, s)}) {
      ring->push_back({-h + (turn == 0 ? 0 : kStep), -h});
      ring->push_back({h, -h});
      ring->push_back({h, h});
      ring->push_back({-h, h});
      ring->push_back({-h, -h + kStep});
    }
  }
  Ring spiral = outer;
  spiral.insert(spiral.end(), inner.rbegin(), inner.rend());
  __extension__ using Wide = __int128;
  Wide area = 0, largest = 0;
  for (std::size_t i = 0; i < spiral.size(); ++i) {
    area += orient2d(spiral[0], spiral[i], spiral[(i + 1) % spiral.size()]);
    largest = std::max({largest, area, -area});
  }
  EXPECT_GT(largest, Wide{INT64_MAX});
  ASSERT_TRUE(area > 0 && area < Wide{INT64_MAX});
  EXPECT_EQ(doubled_area(spiral), static_cast<std::int64_t>(area));
  EXPECT_EQ(doubled_area(Pslg{{spiral}}), static_cast<std::int64_t>(area));
  EXPECT_TRUE(check_pslg(Pslg{{spiral}}));
}

TEST(IsConstrainedDelaunay, DetectsAFlippedDiagonal) {
  const std::vector<LatticePoint> kite = {{0, 0}, {10, -1}, {20, 0}, {10, 1}};
  EXPECT_TRUE(is_constrained_delaunay({kite, {{0, 1, 3}, {1, 2, 3}}}));
  EXPECT_FALSE(is_constrained_delaunay({kite, {{0, 1, 2}, {0, 2, 3}}}));
}

TEST(EdgeTable, IsInOrder) {
  std::mt19937_64 rng(3);
  for (std::uint32_t n = 3; n < 60; n += 4) {
    SliceMesh mesh;
    mesh.vertices.resize(n);
    for (std::uint32_t k = 0; k < 3 * n; ++k) {
      const auto a = static_cast<std::uint32_t>(rng() % n);
      mesh.triangles.push_back({a, (a + 1) % n, (a + 2) % n});
      std::shuffle(mesh.triangles.back().begin(), mesh.triangles.back().end(), rng);
    }
    std::vector<std::array<std::uint32_t, 3>> wanted, found;  // lower vertex, higher one, edge
    for (std::uint32_t edge = 0; edge < 9 * n; ++edge) {
      const Triangle& t = mesh.triangles[edge / 3];
      const auto [low, high] = std::minmax({t[edge % 3], t[(edge + 1) % 3]});
      wanted.push_back({low, high, edge});
    }
    std::sort(wanted.begin(), wanted.end());
    edge_table(mesh).for_each_pair(
        [&](std::uint32_t low, std::uint32_t high, std::span<const EdgeTable::Entry> edges) {
          for (const EdgeTable::Entry& e : edges)
            found.push_back({low, e.high == high ? high : n, e.edge});
          return true;
        });
    ASSERT_EQ(found, wanted);
  }
}

}  // namespace
}  // namespace trocar
