// SPDX-License-Identifier: Apache-2.0
// Each property of regions that share borders, broken one at a time; and their meshes welded.
#include "formats/mesh/shared_borders.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "formats/mesh/mesh_validity.h"
#include "tests/support/take.h"

namespace trocar {
namespace {

using Regions = std::vector<Pslg>;

Ring box(std::int32_t x0, std::int32_t y0, std::int32_t x1, std::int32_t y1) {
  return {{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}};
}
Ring hole(Ring ring) {
  std::reverse(ring.begin(), ring.end());
  return ring;
}

// Side by side, sharing the edge from (100, 0) to (100, 100).
const Regions kSquares = {{{box(0, 0, 100, 100)}}, {{box(100, 0, 200, 100)}}};

// The squares with these points on the shared edge, from below.
Regions divided(const Ring& left, const Ring& right) {
  Regions out = kSquares;
  Ring& l = out[0].rings[0];
  l.insert(l.begin() + 2, left.begin(), left.end());
  Ring& r = out[1].rings[0];
  r.insert(r.end(), right.rbegin(), right.rend());
  return out;
}

void expect_refused(const Regions& regions, const Regions& stored, const std::string& why) {
  for (const Regions* side : {&regions, &stored}) {
    for (const Pslg& pslg : *side)
      EXPECT_TRUE(check_pslg(pslg)) << "each region by itself is valid";
  }
  const auto outline = check_shared_borders(regions, stored);
  ASSERT_FALSE(outline) << why;
  EXPECT_EQ(outline.error().code, ExitCode::kRefused);
  EXPECT_NE(outline.error().message.find(why), std::string::npos) << outline.error().message;
}

TEST(SharedBorders, GiveTheOutlineOfTheUnion) {
  auto outline = check_shared_borders(kSquares, kSquares);
  ASSERT_TRUE(outline) << outline.error().message;
  ASSERT_EQ(outline->rings.size(), 1U);
  EXPECT_EQ(outline->rings[0],
            (Ring{{0, 0}, {100, 0}, {200, 0}, {200, 100}, {100, 100}, {0, 100}}));
  // Points beside the edge are fine if both have them.
  const Regions bent = divided({{101, 40}, {99, 60}}, {{101, 40}, {99, 60}});
  outline = check_shared_borders(kSquares, bent);
  ASSERT_TRUE(outline) << outline.error().message;
  EXPECT_EQ(doubled_area(*outline), 2 * 200 * 100);
  // One in the hole of another leaves the outer ring; void in a hole stays one.
  const Regions nested = {{{box(0, 0, 90, 90), hole(box(30, 30, 60, 60))}},
                          {{box(30, 30, 60, 60), hole(box(40, 40, 50, 50))}}};
  outline = check_shared_borders(nested, nested);
  ASSERT_TRUE(outline) << outline.error().message;
  EXPECT_EQ(outline->rings,
            (std::vector<Ring>{box(0, 0, 90, 90), {{40, 40}, {40, 50}, {50, 50}, {50, 40}}}));
  EXPECT_TRUE(check_shared_borders({}, {}));
  EXPECT_TRUE(check_shared_borders(Regions(2), Regions(2)));
}

// Four regions around a point, two of which touch only there; and a ring around void that passes
// the same point twice.
TEST(SharedBorders, MayTouchInVertices) {
  const Regions checkers = {{{box(0, 0, 10, 10), box(10, 10, 20, 20)}},
                            {{box(10, 0, 20, 10), box(0, 10, 10, 20)}}};
  auto outline = check_shared_borders(checkers, checkers);
  ASSERT_TRUE(outline) << outline.error().message;
  EXPECT_EQ(doubled_area(*outline), 2 * 20 * 20);
  const Regions corners = {{{box(0, 0, 10, 10)}}, {{box(10, 10, 20, 20)}}, {{box(10, 0, 20, 10)}}};
  outline = check_shared_borders(corners, corners);
  ASSERT_TRUE(outline) << outline.error().message;
  EXPECT_EQ(doubled_area(*outline), 2 * 3 * 10 * 10);
  // Two that touch in two points, with void between: two rings, not one around the other.
  const Regions lips = {{{{{0, 0}, {10, -10}, {20, 0}, {15, 1}}}},
                        {{{{0, 0}, {10, 5}, {20, 0}, {5, 15}}}}};
  outline = check_shared_borders(lips, lips);
  ASSERT_TRUE(outline) << outline.error().message;
  EXPECT_EQ(outline->rings, (std::vector<Ring>{lips[0].rings[0], lips[1].rings[0]}));
}

TEST(SharedBorders, RefuseGaps) {
  const std::string differently = "divide the edge that they share differently";
  expect_refused(kSquares, divided({{99, 50}}, {{100, 50}}), differently);
  expect_refused(kSquares, divided({{100, 50}}, {}), differently);
  expect_refused(kSquares, divided({}, {{100, 50}}), differently);
  expect_refused(kSquares, divided({{100, 40}, {100, 60}}, {{100, 40}}), differently);
  expect_refused(kSquares, divided({{100, 40}}, {{100, 60}}), differently);
}

TEST(SharedBorders, RefuseOverlaps) {
  expect_refused(kSquares, divided({{101, 50}}, {{100, 50}}), "differently");
  Regions regions = kSquares;
  regions.push_back(kSquares[0]);
  expect_refused(regions, regions, "same side of an edge");
  // No edge in common.
  regions = {{{box(0, 0, 100, 100)}}, {{box(50, 50, 150, 150)}}};
  expect_refused(regions, regions, "cross");
  regions = {{{box(0, 0, 100, 100)}}, {{box(40, 40, 60, 60)}}};
  expect_refused(regions, regions, "an outer ring inside material");
  // An edge of one is two edges of the other.
  regions = {{{box(0, 0, 100, 100)}}, {{{{100, 0}, {200, 0}, {200, 100}, {100, 100}, {100, 50}}}}};
  expect_refused(regions, regions, "cross");
  // A free edge that a stored point moves into the other region.
  regions = {{{box(0, 0, 100, 100)}}, {{box(102, 0, 200, 100)}}};
  Regions stored = regions;
  stored[0].rings[0].insert(stored[0].rings[0].begin() + 2, {103, 50});
  expect_refused(regions, stored, "cross");
  // A whole region in another, edge on edge in the other direction all around but for the outside.
  regions = {{{box(0, 0, 90, 90), hole(box(30, 30, 60, 60))}},
             {{box(30, 30, 60, 60)}},
             {{box(40, 40, 50, 50)}}};
  expect_refused(regions, regions, "an outer ring inside material");
}

TEST(SharedBorders, RefuseOutlinesThatDoNotCorrespond) {
  expect_refused(kSquares, {kSquares[0]}, "1 stored outlines of 2 regions");
  Regions stored = kSquares;
  stored[1].rings.push_back(box(300, 0, 400, 100));
  expect_refused(kSquares, stored, "2 stored rings for 1");
  stored = kSquares;
  stored[0].rings[0][2] = {100, 99};
  expect_refused(kSquares, stored, "does not pass an input vertex");
  stored = kSquares;
  std::rotate(stored[0].rings[0].begin(), stored[0].rings[0].begin() + 1, stored[0].rings[0].end());
  expect_refused(kSquares, stored, "does not pass an input vertex");
  stored = kSquares;
  stored[0].rings[0].pop_back();
  expect_refused(kSquares, stored, "does not pass an input vertex");
}

// Two triangles.
SliceMesh square(std::int32_t x, std::int32_t y) {
  return {{{x, y}, {x + 10, y}, {x + 10, y + 10}, {x, y + 10}}, {{0, 1, 2}, {0, 2, 3}}};
}

// Welds them; the result is valid, and its boundary is the outline of all.
WeldedRegions expect_welded(const std::vector<SliceMesh>& regions, std::size_t vertices) {
  std::vector<const SliceMesh*> meshes;
  std::vector<Pslg> outlines;
  std::int64_t area = 0;
  for (const SliceMesh& region : regions) {
    meshes.push_back(&region);
    outlines.push_back(boundary_rings(region));
    area += doubled_area(region);
  }
  WeldedRegions welded = test::take(weld_regions(meshes));
  const Pslg outline = test::take(check_shared_borders(outlines, outlines));
  const auto ok = check_mesh_against_pslg(welded.mesh, outline);
  EXPECT_TRUE(ok) << ok.error().message;
  EXPECT_EQ(boundary_rings(welded.mesh).rings, outline.rings);
  EXPECT_EQ(doubled_area(welded.mesh), area);
  EXPECT_EQ(welded.mesh.vertices.size(), vertices);
  for (std::size_t k = 0; k < regions.size(); ++k) {
    for (std::size_t v = 0; v < regions[k].vertices.size(); ++v)
      EXPECT_EQ(welded.mesh.vertices[welded.vertex[k][v]], regions[k].vertices[v]);
  }
  return welded;
}

TEST(WeldRegions, SharedEdgesBecomeOne) {
  expect_welded({}, 0);
  expect_welded({square(0, 0)}, 4);
  expect_welded({square(0, 0), square(10, 0)}, 6);
  expect_welded({square(0, 0), square(10, 0), square(0, 10), square(10, 10)}, 9);
  expect_welded({square(0, 0), square(30, 0)}, 8);
}

TEST(WeldRegions, VerticesThatTouchStayApart) {
  expect_welded({square(0, 0), square(10, 10)}, 8);
  // A third square joins them, along two edges: then all three meet in the point.
  expect_welded({square(0, 0), square(10, 10), square(10, 0)}, 8);
  // The third and the fourth belong together and touch themselves in the middle.
  SliceMesh both = square(10, 0);
  for (const LatticePoint p : square(0, 10).vertices)
    both.vertices.push_back(p);
  both.triangles.push_back({4, 5, 6});
  both.triangles.push_back({4, 6, 7});
  expect_welded({square(0, 0), square(10, 10), both}, 9);
  expect_welded({square(0, 0), both}, 8);
}

TEST(WeldRegions, TwoOnOneSideAreRefused) {
  const SliceMesh one = square(0, 0), same = square(0, 0);
  const SliceMesh* const twice[] = {&one, &same};
  EXPECT_FALSE(weld_regions(twice));
  const SliceMesh broken{{{0, 0}}, {{0, 1, 2}}};
  const SliceMesh* const out_of_range[] = {&broken};
  EXPECT_FALSE(weld_regions(out_of_range));
}

}  // namespace
}  // namespace trocar
