// SPDX-License-Identifier: Apache-2.0
// The cut on small meshes: every position of a tool on a sheet, with hand-computed results.
#include "formats/mesh/cut.h"

#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <set>

#include "tests/support/cut_checks.h"
#include "tests/support/take.h"
#include "tests/support/whole_cut.h"

namespace trocar::runtime {
namespace {

// Cells of `size` steps, columns x rows, each two triangles; cells for which
// `solid` is false are left out.
SliceMesh grid(
    int columns, int rows, int size,
    const std::function<bool(int, int)>& solid = [](int, int) { return true; }) {
  SliceMesh mesh;
  std::map<std::pair<int, int>, std::uint32_t> index;
  auto vertex = [&](int i, int j) {
    const auto [at, is_new] =
        index.try_emplace({i, j}, static_cast<std::uint32_t>(mesh.vertices.size()));
    if (is_new) mesh.vertices.push_back({i * size, j * size});
    return at->second;
  };
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      if (!solid(i, j)) continue;
      const std::uint32_t a = vertex(i, j), b = vertex(i + 1, j), c = vertex(i + 1, j + 1),
                          d = vertex(i, j + 1);
      mesh.triangles.push_back({a, b, c});
      mesh.triangles.push_back({a, c, d});
    }
  }
  return mesh;
}

SliceMesh one_triangle() {
  return {{{0, 0}, {100, 0}, {0, 100}}, {{0, 1, 2}}};
}

Ring box(int x0, int y0, int x1, int y1) {
  return {{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}};
}

Ring hexagon_at(int x, int y, int r) {
  const int h = static_cast<int>((std::int64_t{r} * 866 + 500) / 1000);
  return {{x + r, y}, {x + r / 2, y + h}, {x - r / 2, y + h},
          {x - r, y}, {x - r / 2, y - h}, {x + r / 2, y - h}};
}

std::vector<Ring> rings(std::vector<Ring> in) {
  for (Ring& r : in)
    r = from_smallest(r);
  std::sort(in.begin(), in.end());
  return in;
}

std::size_t fans_at(const SliceMesh& mesh, LatticePoint p) {
  return static_cast<std::size_t>(std::count(mesh.vertices.begin(), mesh.vertices.end(), p));
}

// Cuts, checks the result and returns it.
CutResult good_cut(const SliceMesh& sheet, const Ring& tool) {
  EXPECT_TRUE(check_mesh(sheet)) << "the test's sheet is not valid";
  CutResult result = test::take(cut(sheet, tool));
  EXPECT_EQ(contract_violation(sheet, result), "");
  EXPECT_EQ(outline_violation(result), "");
  return result;
}

// The tool lies wholly over material: the hole is exactly the tool.
CutResult whole_cut(const SliceMesh& sheet, const Ring& tool) {
  CutResult result = good_cut(sheet, tool);
  EXPECT_EQ(result.hole, rings({tool}));
  EXPECT_EQ(result.doubled_area_removed, doubled_area(tool));
  return result;
}

TEST(Cut, KeepsVerticesInTheCavityThatAreNotUnderTheTool) {
  // A U around the middle vertex overlaps all of its triangles and does not cover it.
  const Ring u = {{30, 30}, {70, 30}, {70, 70}, {60, 70}, {60, 40}, {40, 40}, {40, 70}, {30, 70}};
  const CutResult r = whole_cut(grid(2, 2, 50), u);
  EXPECT_EQ(r.triangles_removed, 6U);  // all of its triangles, not the two that it lacks
  EXPECT_EQ(fans_at(r.mesh, {50, 50}), 1U);
}

TEST(Cut, EdgeThroughAVertex) {
  const SliceMesh sheet = grid(2, 2, 20);  // a vertex at (20, 20)
  const CutResult r = whole_cut(sheet, {{12, 12}, {28, 12}, {28, 28}});
  EXPECT_EQ(fans_at(r.mesh, {20, 20}), 0U);  // covered by the tool's edge, and not needed
}

TEST(Cut, LeavesTheSheetUnchangedWhereTheToolOnlyTouches) {
  const SliceMesh sheet = grid(3, 3, 10);
  // Along an edge, at a corner, with a vertex inside a boundary edge.
  for (const Ring& tool :
       {box(30, 5, 40, 15), box(30, 30, 40, 40), Ring{{30, 14}, {40, 10}, {40, 20}}}) {
    const CutResult r = good_cut(sheet, tool);
    EXPECT_EQ(r.mesh.triangles, sheet.triangles);
    EXPECT_TRUE(r.hole.empty());
  }
  // In a hole of the sheet, whose rim it fills exactly.
  const SliceMesh frame = grid(3, 3, 10, [](int i, int j) { return i != 1 || j != 1; });
  const CutResult r = good_cut(frame, box(10, 10, 20, 20));
  EXPECT_EQ(r.mesh.triangles, frame.triangles);
}

TEST(Cut, RemovesASheetUnderTheTool) {
  for (const Ring& tool : {box(-5, -5, 35, 35), box(0, 0, 30, 30), hexagon_at(15, 15, 100)}) {
    const CutResult r = good_cut(grid(3, 3, 10), tool);
    EXPECT_TRUE(r.mesh.triangles.empty());
    EXPECT_TRUE(r.mesh.vertices.empty());
    EXPECT_EQ(r.doubled_area_removed, 1800);
    // The outline is the sheet's, with the vertices that the sheet's has.
    ASSERT_EQ(r.hole.size(), 1U);
    EXPECT_EQ(r.hole[0], boundary_rings(grid(3, 3, 10)).rings[0]);
  }
}

TEST(Cut, OverTheEdgeOnTheLattice) {
  // The crossings lie on lattice points: nothing bends.
  const CutResult r = good_cut(grid(4, 4, 10), box(-5, 13, 15, 27));
  EXPECT_EQ(r.doubled_area_removed, 2 * 15 * 14);
  EXPECT_EQ(r.hole, rings({{{0, 13}, {15, 13}, {15, 27}, {0, 27}, {0, 20}}}));
  EXPECT_EQ(boundary_rings(r.mesh).rings.size(), 1U);
}

TEST(Cut, RoundsCrossingsToTheMaterialSide) {
  // The hypotenuse x + y = 100 holds the crossing with y = x + 33 between (33, 67)
  // and (34, 66); the bend must not add material.
  const SliceMesh sheet = one_triangle();
  const Ring tool = {{20, 53}, {60, 93}, {20, 93}};
  const CutResult r = good_cut(sheet, tool);
  // True area of the triangle (20, 53) (33.5, 66.5) (20, 80): 2 A = 27 * 13.5.
  EXPECT_NEAR(static_cast<double>(r.doubled_area_removed), 27 * 13.5, 100);
  for (LatticePoint p : r.mesh.vertices)
    EXPECT_LE(p.x + p.y, 100);
}

TEST(Cut, AroundAHoleOfTheSheet) {
  const auto frame = [](int i, int j) { return i != 2 || j != 2; };
  const SliceMesh sheet = grid(5, 5, 10, frame);
  const CutResult r = good_cut(sheet, box(15, 15, 35, 35));
  EXPECT_EQ(r.doubled_area_removed, 2 * (20 * 20 - 10 * 10));
  EXPECT_EQ(r.hole, rings({box(15, 15, 35, 35), {{20, 20}, {20, 30}, {30, 30}, {30, 20}}}));
  EXPECT_EQ(boundary_rings(r.mesh).rings.size(), 2U);
}

TEST(Cut, PinchesAtTheSheetsEdge) {
  // The tool's vertex touches the sheet's boundary from within.
  const CutResult r = whole_cut(grid(1, 1, 40), {{0, 20}, {20, 10}, {20, 30}});
  EXPECT_EQ(fans_at(r.mesh, {0, 20}), 2U);
  // The tool's edge touches a corner of the sheet's hole.
  const SliceMesh frame = grid(5, 5, 10, [](int i, int j) { return i != 2 || j != 2; });
  const CutResult t = good_cut(frame, {{15, 25}, {25, 35}, {15, 35}});
  EXPECT_EQ(t.doubled_area_removed, 100);
  EXPECT_EQ(fans_at(t.mesh, {20, 30}), 2U);
}

TEST(Cut, AtTheLatticesLimit) {
  const std::int32_t m = kMaxCoordinate;
  const SliceMesh sheet{{{-m, -m}, {m, -m}, {m, m}, {-m, m}}, {{0, 1, 2}, {0, 2, 3}}};
  whole_cut(sheet, hexagon_at(12345, -54321, 100000000));
  const CutResult all = good_cut(sheet, {{-m, -m}, {m, -m}, {m, m}, {-m, m}});
  EXPECT_TRUE(all.mesh.triangles.empty());
  good_cut(sheet, {{-m, -m + 1}, {m, m - 1}, {m, m}});  // a needle from corner to corner
}

TEST(Cut, RefusesInvalidTools) {
  const SliceMesh sheet = grid(3, 3, 10);
  const std::int32_t far = kMaxCoordinate + 1;
  const Ring not_tools[] = {
      {},
      {{1, 1}, {5, 5}},
      {{1, 1}, {5, 1}, {9, 1}},                              // no area
      {{1, 1}, {1, 5}, {5, 1}},                              // clockwise
      {{1, 1}, {1, 1}, {5, 1}, {5, 5}},                      // a vertex twice in a row
      {{0, 0}, {10, 10}, {10, 0}, {0, 10}},                  // crosses itself
      {{0, 0}, {10, 0}, {5, 5}, {10, 10}, {0, 10}, {5, 5}},  // touches itself
      {{0, 0}, {10, 0}, {10, 10}, {10, 5}},                  // a spike
      {{0, 0}, {far, 0}, {0, 5}},                            // off the lattice
  };
  for (const Ring& tool : not_tools) {
    const Result<CutResult> r = cut(sheet, tool);
    ASSERT_FALSE(r);
    EXPECT_EQ(r.error().code, ExitCode::kRefused);
  }
  // At most 32 vertices.
  Ring arch;
  for (std::int32_t i = 0; i < 33; ++i)
    arch.push_back({i, i * i});
  EXPECT_FALSE(cut(sheet, arch));
  arch.pop_back();
  EXPECT_TRUE(cut(sheet, arch));
}

TEST(Cut, RefusesASheetWithInvalidIndices) {
  SliceMesh sheet = grid(2, 2, 10);
  sheet.triangles[3][1] = 4000000000U;
  EXPECT_EQ(cut(sheet, box(1, 1, 5, 5)).error().code, ExitCode::kRefused);
  sheet = grid(2, 2, 10);
  sheet.triangles.push_back(sheet.triangles[0]);
  EXPECT_EQ(cut(sheet, box(1, 1, 5, 5)).error().code, ExitCode::kRefused);
}

}  // namespace
}  // namespace trocar::runtime
