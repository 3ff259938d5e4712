// SPDX-License-Identifier: Apache-2.0
// Each way in which a mesh or an outline can be invalid, one by one.
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

TEST(CheckPslg, NamesEachDefect) {
  EXPECT_TRUE(check_pslg({}));
  expect_refused(check_pslg({{{{0, 0}, {1, 0}}}}), "fewer than three");
  expect_refused(check_pslg({{{{0, 0}, {4, 0}, {0, 4}, {0, 0}}}}), "vertex twice");
  expect_refused(check_pslg({{{{0, 0}, {4, 4}, {4, 0}, {0, 4}}}}), "cross");
  expect_refused(check_pslg({{{{0, 0}, {4, 0}, {4, 4}}, {{4, 4}, {4, 0}, {8, 0}}}}),
                 "cross");  // shared edge
  expect_refused(check_pslg({{{{0, 0}, {0, 4}, {4, 0}}}}), "a hole outside material");
}

TEST(CheckPslg, AcceptsNestingAndTouching) {
  Pslg nested;
  for (std::int32_t k = 0; k < 6; ++k) {  // six deep, alternating
    Ring ring = {{k, k}, {40 - k, k}, {40 - k, 40 - k}, {k, 40 - k}};
    if (k % 2 == 1) std::reverse(ring.begin(), ring.end());
    nested.rings.push_back(ring);
  }
  EXPECT_TRUE(check_pslg(nested));
  std::reverse(nested.rings[3].begin(), nested.rings[3].end());
  EXPECT_FALSE(check_pslg(nested));
  EXPECT_TRUE(check_pslg({{{{0, 0}, {4, 0}, {4, 4}, {0, 4}}, {{4, 4}, {8, 4}, {8, 8}, {4, 8}}}}));
  EXPECT_TRUE(
      check_pslg({{{{0, 0}, {8, 0}, {8, 8}, {0, 8}}, {{0, 0}, {2, 4}, {4, 2}}}}));  // hole touching
}

// A box within `low` and `high`, and in each quarter of it, perhaps, others. Touching is allowed.
void add_boxes(LatticePoint low, LatticePoint high, bool hole, std::mt19937_64& rng, Pslg& out) {
  if (high.x - low.x < 8 || high.y - low.y < 8 || out.rings.size() > 300) return;
  const auto inset = [&rng] { return static_cast<std::int32_t>(rng() % 3); };
  low = {low.x + inset(), low.y + inset()};
  high = {high.x - inset(), high.y - inset()};
  Ring ring = {low, {high.x, low.y}, high, {low.x, high.y}};
  if (hole) std::reverse(ring.begin(), ring.end());
  std::rotate(ring.begin(), ring.begin() + static_cast<std::ptrdiff_t>(rng() % 4), ring.end());
  out.rings.push_back(ring);
  const LatticePoint middle{(low.x + high.x) / 2, (low.y + high.y) / 2};
  // One step away from the box, so that no two edges coincide.
  for (const auto& [a, b] : {std::pair{LatticePoint{low.x + 1, low.y + 1}, middle},
                             {{middle.x + 1, low.y + 1}, {high.x - 1, middle.y}},
                             {{low.x + 1, middle.y + 1}, {middle.x, high.y - 1}},
                             {{middle.x + 1, middle.y + 1}, {high.x - 1, high.y - 1}}}) {
    if (rng() % 4 != 0) add_boxes(a, b, !hole, rng, out);
  }
}

TEST(CheckPslg, ChecksNestingInAnyOrderOfTheRings) {
  std::mt19937_64 rng(3);
  std::size_t most = 0;
  for (int i = 0; i < 200; ++i) {
    Pslg boxes;
    for (std::int32_t k = 0; k < 3; ++k)
      add_boxes({300 * k, 40 * k}, {300 * k + 290, 40 * k + 250}, false, rng, boxes);
    std::shuffle(boxes.rings.begin(), boxes.rings.end(), rng);
    most = std::max(most, boxes.rings.size());
    const auto ok = check_pslg(boxes);
    ASSERT_TRUE(ok) << i << ' ' << ok.error().message;
    Ring& turned = boxes.rings[rng() % boxes.rings.size()];
    std::reverse(turned.begin(), turned.end());
    EXPECT_FALSE(check_pslg(boxes)) << i;
  }
  EXPECT_GT(most, 100U);
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
// A grid with the triangles of random cells left out: holes, several pieces, any order of vertices.
SliceMesh random_grid(std::mt19937_64& rng) {
  constexpr std::int32_t kCells = 9;
  std::vector<std::uint32_t> number((kCells + 1) * (kCells + 1));
  for (std::uint32_t i = 0; i < number.size(); ++i)
    number[i] = i;
  std::shuffle(number.begin(), number.end(), rng);
  SliceMesh mesh;
  mesh.vertices.resize(number.size());
  const auto at = [&number](std::int32_t x, std::int32_t y) {
    return number[static_cast<std::size_t>(y) * (kCells + 1) + static_cast<std::size_t>(x)];
  };
  for (std::int32_t y = 0; y <= kCells; ++y) {
    for (std::int32_t x = 0; x <= kCells; ++x)
      mesh.vertices[at(x, y)] = {10 * x, 10 * y};
  }
  for (std::int32_t y = 0; y < kCells; ++y) {
    for (std::int32_t x = 0; x < kCells; ++x) {
      if (rng() % 16 == 0) continue;
      mesh.triangles.push_back({at(x, y), at(x + 1, y), at(x + 1, y + 1)});
      mesh.triangles.push_back({at(x + 1, y + 1), at(x, y + 1), at(x, y)});
    }
  }
  return mesh;
}

TEST(BoundaryRings, AreTheEdgesWithoutAnOpposite) {
  std::mt19937_64 rng(4);
  int valid = 0;
  for (int i = 0; i < 400; ++i) {
    const SliceMesh mesh = random_grid(rng);
    if (!check_mesh(mesh)) continue;  // a pinch
    ++valid;
    using EdgeEnds = std::pair<LatticePoint, LatticePoint>;
    std::set<EdgeEnds> expected, found;
    for (const Triangle& t : mesh.triangles) {
      for (std::size_t k = 0; k < 3; ++k) {
        const LatticePoint a = mesh.vertices[t[k]], b = mesh.vertices[t[(k + 1) % 3]];
        if (expected.erase({b, a}) == 0) expected.insert({a, b});
      }
    }
    for (const Ring& ring : boundary_rings(mesh).rings) {
      for (std::size_t k = 0; k < ring.size(); ++k)
        EXPECT_TRUE(found.insert({ring[k], ring[(k + 1) % ring.size()]}).second);
    }
    EXPECT_EQ(found, expected);
  }
  EXPECT_GT(valid, 100);
}

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
