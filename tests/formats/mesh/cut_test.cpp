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

Ring hexagon(int x, int y, int r) {
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
  const CutResult result = test::take(cut(sheet, tool));
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

TEST(Cut, InsideOneTriangle) {
  const CutResult r = whole_cut(one_triangle(), hexagon(30, 30, 10));
  EXPECT_EQ(r.triangles_removed, 1U);
  EXPECT_EQ(r.triangles_created, 9U);  // 3 + 6 vertices around one hole
  EXPECT_EQ(boundary_rings(r.mesh).rings.size(), 2U);
}

TEST(Cut, OverManyTriangles) {
  const CutResult r = whole_cut(grid(10, 10, 10), hexagon(51, 47, 23));
  EXPECT_GT(r.triangles_removed, 20U);
  EXPECT_LT(r.triangles_removed, 100U);
}

TEST(Cut, KeepsVerticesInTheCavityThatAreNotUnderTheTool) {
  // A U around the middle vertex overlaps all of its triangles and does not cover it.
  const Ring u = {{30, 30}, {70, 30}, {70, 70}, {60, 70}, {60, 40}, {40, 40}, {40, 70}, {30, 70}};
  const CutResult r = whole_cut(grid(2, 2, 50), u);
  EXPECT_EQ(r.triangles_removed, 6U);  // all of its triangles, not the two that it lacks
  EXPECT_EQ(fans_at(r.mesh, {50, 50}), 1U);
}

TEST(Cut, NonConvexTool) {
  const Ring u = {{15, 15}, {85, 15}, {85, 85}, {65, 85}, {65, 35}, {35, 35}, {35, 85}, {15, 85}};
  whole_cut(grid(10, 10, 10), u);
  whole_cut(grid(1, 1, 100), u);
}

TEST(Cut, EdgeThroughAVertex) {
  const SliceMesh sheet = grid(2, 2, 20);  // a vertex at (20, 20)
  const CutResult r = whole_cut(sheet, {{12, 12}, {28, 12}, {28, 28}});
  EXPECT_EQ(fans_at(r.mesh, {20, 20}), 0U);  // covered by the tool's edge, and not needed
}

TEST(Cut, EdgeAlongAnEdge) {
  const CutResult r = whole_cut(grid(4, 4, 10), box(10, 10, 30, 30));
  EXPECT_EQ(fans_at(r.mesh, {10, 10}), 1U);
  whole_cut(grid(4, 4, 10), box(12, 10, 28, 20));
}

TEST(Cut, VertexOnAVertexAndOnAnEdge) {
  const SliceMesh sheet = grid(4, 4, 10);
  whole_cut(sheet, {{20, 20}, {28, 22}, {24, 27}});  // on a vertex, else in one triangle
  whole_cut(sheet, {{20, 24}, {28, 21}, {28, 26}});  // on an edge
}

TEST(Cut, ThinnestTool) {
  const CutResult r = whole_cut(grid(4, 4, 10), {{13, 13}, {14, 13}, {13, 14}});
  EXPECT_EQ(r.doubled_area_removed, 1);
}

TEST(Cut, LeavesTheSheetUnchangedWithoutMaterialUnderTheTool) {
  const SliceMesh sheet = grid(3, 3, 10);
  for (const Ring& tool : {box(100, 100, 110, 110), box(31, 0, 40, 10), box(-20, -20, -1, -1)}) {
    const CutResult r = good_cut(sheet, tool);
    EXPECT_EQ(r.mesh.vertices, sheet.vertices);
    EXPECT_EQ(r.mesh.triangles, sheet.triangles);
    EXPECT_TRUE(r.hole.empty());
    EXPECT_EQ(r.triangles_removed + r.triangles_created, 0U);
  }
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
  for (const Ring& tool : {box(-5, -5, 35, 35), box(0, 0, 30, 30), hexagon(15, 15, 100)}) {
    const CutResult r = good_cut(grid(3, 3, 10), tool);
    EXPECT_TRUE(r.mesh.triangles.empty());
    EXPECT_TRUE(r.mesh.vertices.empty());
    EXPECT_EQ(r.doubled_area_removed, 1800);
    // The outline is the sheet's, with the vertices that the sheet's has.
    ASSERT_EQ(r.hole.size(), 1U);
    EXPECT_EQ(r.hole[0], boundary_rings(grid(3, 3, 10)).rings[0]);
  }
}

TEST(Cut, EmptySheet) {
  const CutResult r = good_cut({}, box(0, 0, 5, 5));
  EXPECT_TRUE(r.mesh.triangles.empty());
  EXPECT_TRUE(r.hole.empty());
}

TEST(Cut, OverTheEdgeOnTheLattice) {
  // The crossings lie on lattice points: nothing bends.
  const CutResult r = good_cut(grid(4, 4, 10), box(-5, 13, 15, 27));
  EXPECT_EQ(r.doubled_area_removed, 2 * 15 * 14);
  EXPECT_EQ(r.hole, rings({{{0, 13}, {15, 13}, {15, 27}, {0, 27}, {0, 20}}}));
  EXPECT_EQ(boundary_rings(r.mesh).rings.size(), 1U);
}

TEST(Cut, OverACorner) {
  const CutResult r = good_cut(grid(4, 4, 10), box(-5, -5, 15, 15));
  EXPECT_EQ(r.doubled_area_removed, 2 * 15 * 15);
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

TEST(Cut, DisconnectsAnIsland) {
  const CutResult r = good_cut(grid(6, 2, 10), box(23, -5, 37, 25));
  EXPECT_EQ(r.doubled_area_removed, 2 * 14 * 20);
  EXPECT_EQ(boundary_rings(r.mesh).rings.size(), 2U);
}

TEST(Cut, AroundAHoleOfTheSheet) {
  const auto frame = [](int i, int j) { return i != 2 || j != 2; };
  const SliceMesh sheet = grid(5, 5, 10, frame);
  const CutResult r = good_cut(sheet, box(15, 15, 35, 35));
  EXPECT_EQ(r.doubled_area_removed, 2 * (20 * 20 - 10 * 10));
  EXPECT_EQ(r.hole, rings({box(15, 15, 35, 35), {{20, 20}, {20, 30}, {30, 30}, {30, 20}}}));
  EXPECT_EQ(boundary_rings(r.mesh).rings.size(), 2U);
}

TEST(Cut, AroundAnIslandInAHole) {
  // Void around one island cell; the tool covers the island and otherwise lies over void.
  const auto island = [](int i, int j) {
    return i == 0 || j == 0 || i == 6 || j == 6 || (i == 3 && j == 3);
  };
  const SliceMesh sheet = grid(7, 7, 10, island);
  CutResult r = good_cut(sheet, box(25, 25, 45, 45));
  EXPECT_EQ(r.doubled_area_removed, 200);
  EXPECT_EQ(r.triangles_removed, 2U);
  EXPECT_EQ(r.triangles_created, 0U);
  r = good_cut(sheet, box(5, 5, 45, 45));  // and the frame's corner with it
  EXPECT_EQ(r.doubled_area_removed, 200 + 2 * (40 * 40 - 35 * 35));
}

TEST(Cut, AcrossAnOlderHole) {
  const CutResult first = whole_cut(grid(10, 10, 10), hexagon(40, 50, 15));
  const CutResult second = good_cut(first.mesh, hexagon(55, 50, 15));
  EXPECT_GT(second.doubled_area_removed, 0);
  EXPECT_LT(second.doubled_area_removed, doubled_area(hexagon(55, 50, 15)));
  EXPECT_EQ(boundary_rings(second.mesh).rings.size(), 2U);
}

TEST(Cut, TheSameHexagonTwice) {
  const CutResult first = whole_cut(grid(10, 10, 10), hexagon(41, 52, 15));
  const CutResult second = good_cut(first.mesh, hexagon(41, 52, 15));
  EXPECT_EQ(second.doubled_area_removed, 0);
  EXPECT_EQ(second.mesh.triangles, first.mesh.triangles);
  EXPECT_TRUE(second.hole.empty());
}

TEST(Cut, ShiftedByOneStep) {
  const CutResult first = whole_cut(grid(10, 10, 10), hexagon(41, 52, 15));
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      const CutResult r = good_cut(first.mesh, hexagon(41 + dx, 52 + dy, 15));
      // A strip of one step along a hexagon of 90 steps' circumference.
      EXPECT_LE(r.doubled_area_removed, 2 * 90);
      EXPECT_EQ(r.doubled_area_removed > 0, dx != 0 || dy != 0);
    }
  }
}

TEST(Cut, BesideAnOlderHole) {
  const CutResult first = whole_cut(grid(4, 4, 10), box(8, 8, 20, 20));
  // Sharing a whole edge, a part of one, and a corner only.
  EXPECT_EQ(good_cut(first.mesh, box(20, 8, 30, 20)).doubled_area_removed, 240);
  EXPECT_EQ(good_cut(first.mesh, box(20, 11, 30, 17)).doubled_area_removed, 120);
  const CutResult corner = good_cut(first.mesh, box(20, 20, 30, 30));
  EXPECT_EQ(corner.doubled_area_removed, 200);
  EXPECT_EQ(fans_at(corner.mesh, {20, 20}), 2U);  // a pinch: two vertices
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

TEST(Cut, LeavesSliversAtTwoCorners) {
  // All of a square but two slivers at opposite corners.
  const CutResult r = good_cut(grid(1, 1, 50), {{1, -1}, {51, 49}, {49, 51}, {-1, 1}});
  EXPECT_GT(doubled_area(r.mesh), 0);
}

TEST(Cut, AtTheLatticesLimit) {
  const std::int32_t m = kMaxCoordinate;
  const SliceMesh sheet{{{-m, -m}, {m, -m}, {m, m}, {-m, m}}, {{0, 1, 2}, {0, 2, 3}}};
  whole_cut(sheet, hexagon(12345, -54321, 100000000));
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
