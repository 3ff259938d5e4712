// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/shared_borders.h"

#include <gtest/gtest.h>

#include "formats/mesh/mesh_validity.h"

namespace trocar {
namespace {

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
  const auto welded = weld_regions(meshes);
  EXPECT_TRUE(welded) << welded.error().message;
  if (!welded) return {};
  const auto outline = check_shared_borders(outlines, outlines);
  EXPECT_TRUE(outline) << outline.error().message;
  const auto ok = check_mesh_against_pslg(welded->mesh, *outline);
  EXPECT_TRUE(ok) << ok.error().message;
  EXPECT_EQ(boundary_rings(welded->mesh).rings, outline->rings);
  EXPECT_EQ(doubled_area(welded->mesh), area);
  EXPECT_EQ(welded->mesh.vertices.size(), vertices);
  for (std::size_t k = 0; k < regions.size(); ++k) {
    for (std::size_t v = 0; v < regions[k].vertices.size(); ++v)
      EXPECT_EQ(welded->mesh.vertices[welded->vertex[k][v]], regions[k].vertices[v]);
  }
  return *welded;
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
