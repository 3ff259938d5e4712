// SPDX-License-Identifier: Apache-2.0
// The contract of runtime/haptics/membrane/region.h.
#include "runtime/haptics/membrane/region.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "formats/mesh/mesh_validity.h"
#include "runtime/haptics/membrane/sheet_law.h"
#include "tests/reference/deformation/region_part.h"
#include "tests/support/deformation_fixture.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/test_lattice.h"

namespace trocar::runtime {
namespace {

using trocar::test::kLattice;
using trocar::test::kMembrane;
constexpr double kStep_m = 1e-3 / 256;

SheetMesh sheet_of(const SliceMesh& mesh) {
  auto sheet = make_sheet_mesh(mesh, 0, 0);
  EXPECT_TRUE(sheet);
  return *sheet;
}

double area_steps2(const SliceMesh& mesh) {
  return static_cast<double>(doubled_area(mesh)) / 2;
}

double distance_to_triangle(const Eigen::Vector2d& p, const SliceMesh& mesh, const Triangle& t) {
  double least = 1e300;
  bool inside = true;
  for (std::size_t k = 0; k < 3; ++k) {
    const LatticePoint from = mesh.vertices[t[k]], to = mesh.vertices[t[(k + 1) % 3]];
    const Eigen::Vector2d a(from.x, from.y), side(to.x - from.x, to.y - from.y);
    const Eigen::Vector2d q = p - a;
    const double s = std::clamp(q.dot(side) / side.squaredNorm(), 0.0, 1.0);
    least = std::min(least, (q - s * side).norm());
    inside = inside && side.x() * q.y() - side.y() * q.x() >= 0;
  }
  return inside ? 0 : least;
}

/// A sheet of 40 mm with a tool of 3 mm somewhere on it.
struct Case {
  SliceMesh mesh = test::square_mesh({-5120, -5120}, 512, 20);
  SheetMesh sheet = sheet_of(mesh);
  Ring tool;
  RegionOptions options;

  explicit Case(LatticePoint centre, double turn = 0.2)
      : tool(test::regular_polygon(centre, 768, 6, turn)) {}
  Result<RegionMesh> region() {
    RegionWorkspace workspace;
    return make_region(sheet, find_seeds(sheet, tool), tool, kLattice, options, workspace);
  }
};

TEST(Region, HasAllTrianglesNearTheToolLessTheTool) {
  std::mt19937_64 random(4);
  for (int i = 0; i < 60; ++i) {
    Case c(test::place_in(Case({0, 0}).mesh, random), test::uniform(random));
    c.options.radius_m = (0.2 + 12 * test::uniform(random)) * 1e-3;
    c.options.grading.graded = i % 2 == 0;
    const auto region = c.region();
    ASSERT_TRUE(region) << region.error().message;
    ASSERT_TRUE(check_mesh(region->mesh)) << i;
    ASSERT_EQ(region->kind.size(), region->mesh.vertices.size());
    const Circle circle = circle_around(c.tool);
    const double reach = circle.radius + c.options.radius_m / kStep_m;
    SliceMesh expected;  // from the sheet's triangles by contract 1 alone: the square is convex
    expected.vertices = c.mesh.vertices;
    for (const Triangle& t : c.mesh.triangles) {
      if (distance_to_triangle(circle.centre, c.mesh, t) < reach) expected.triangles.push_back(t);
    }
    double perimeter = 0;
    for (const Ring& ring : boundary_rings(region->mesh).rings) {
      for (std::size_t k = 0; k < ring.size(); ++k)
        perimeter +=
            std::sqrt(static_cast<double>(distance2(ring[k], ring[(k + 1) % ring.size()])));
    }
    EXPECT_NEAR(area_steps2(region->mesh), area_steps2(expected) - region->under_tool.area_steps2,
                c.options.grading.graded ? perimeter : 0.01)
        << i;
    for (std::size_t v = 0; v < region->kind.size(); ++v) {
      const LatticePoint p = region->mesh.vertices[v];
      const double from_tool = std::hypot(p.x - circle.centre.x(), p.y - circle.centre.y());
      if (region->kind[v] == NodeKind::kBorder) {
        EXPECT_GT(from_tool, reach - 4) << i;
      }
      if (region->kind[v] == NodeKind::kTool) {
        EXPECT_LT(from_tool, circle.radius * 1.02 + 3) << i;
      }
    }
  }
}

// Over the sheet's straight border at x = -5120: half of the tool, and the centroid of that half.
TEST(Region, BorneAreaIsTheMaterialUnderAToolOverTheRim) {
  Case c({-5120, 0}, 0);
  const auto region = c.region();
  ASSERT_TRUE(region);
  const double whole = static_cast<double>(doubled_area(c.tool)) / 2;
  EXPECT_NEAR(region->under_tool.area_steps2 / whole, 0.5, 2e-3);
  // The centroid of half a regular hexagon, by quadrature.
  double area = 0, moment = 0;
  for (int k = 0; k < 768; ++k) {
    const double x = k + 0.5,
                 half_height = std::min(std::sqrt(3.0) * 384, std::sqrt(3.0) * (768 - x));
    area += 2 * half_height;
    moment += 2 * half_height * x;
  }
  EXPECT_NEAR(region->under_tool.moment_steps3.x() / region->under_tool.area_steps2, moment / area,
              1);
  EXPECT_NEAR(region->under_tool.moment_steps3.y() / region->under_tool.area_steps2, 0, 1);
}

// Contract 2, for every boundary edge of the mesh.
TEST(Region, BoundaryEdgesAreOnTheToolTheOutlineOrTheRing) {
  std::mt19937_64 random(9);
  for (int i = 0; i < 40; ++i) {
    Case c(test::place_in(Case({0, 0}).mesh, random), test::uniform(random));
    c.options.radius_m = 0.006;
    const auto region = c.region();
    ASSERT_TRUE(region);
    std::set<std::pair<std::uint32_t, std::uint32_t>> sides;
    for (const Triangle& t : region->mesh.triangles) {
      for (std::size_t k = 0; k < 3; ++k)
        sides.emplace(t[k], t[(k + 1) % 3]);
    }
    std::size_t tool_nodes = 0, inner_held = 0;
    std::vector<std::uint8_t> on_boundary(region->kind.size(), 0);
    for (const auto& [from, to] : sides) {
      if (sides.contains({to, from})) continue;
      on_boundary[from] = on_boundary[to] = 1;
      const LatticePoint a = region->mesh.vertices[from], b = region->mesh.vertices[to];
      const bool outline = std::max({std::abs(a.x), std::abs(a.y)}) > 5117 &&
                           std::max({std::abs(b.x), std::abs(b.y)}) > 5117;
      if (outline) continue;
      EXPECT_NE(region->kind[from], NodeKind::kFree) << i;
      EXPECT_NE(region->kind[to], NodeKind::kFree) << i;
    }
    for (std::size_t v = 0; v < region->kind.size(); ++v) {
      if (region->kind[v] == NodeKind::kTool) ++tool_nodes;
      if (region->kind[v] != NodeKind::kFree && on_boundary[v] == 0) ++inner_held;
    }
    EXPECT_GE(tool_nodes, 2U);
    EXPECT_EQ(inner_held, 0U);
  }
}

// Two sheets side by side, less than the radius apart: the region has only the one under the tool,
// and both if the tool is over both.
TEST(Region, GapsAreNotCrossed) {
  SliceMesh two = test::square_mesh({0, 0}, 512, 8);
  const SliceMesh right = test::square_mesh({4096 + 256, 0}, 512, 8);
  const auto shift = static_cast<std::uint32_t>(two.vertices.size());
  two.vertices.insert(two.vertices.end(), right.vertices.begin(), right.vertices.end());
  for (const Triangle& t : right.triangles)
    two.triangles.push_back({t[0] + shift, t[1] + shift, t[2] + shift});
  const SheetMesh sheet = sheet_of(two);
  RegionWorkspace workspace;
  const auto rightmost = [&](LatticePoint centre) {
    const Ring tool = test::regular_polygon(centre, 768, 6);
    const auto region = make_region(sheet, find_seeds(sheet, tool), tool, kLattice, {}, workspace);
    EXPECT_TRUE(region);
    std::int32_t x = 0;
    for (LatticePoint p : region->mesh.vertices)
      x = std::max(x, p.x);
    return x;
  };
  EXPECT_EQ(rightmost({2000, 2000}), 4096);
  EXPECT_EQ(rightmost({4200, 2000}), 4096 + 256 + 4096);
}

TEST(Region, IsEmptyBesideAllMaterial) {
  Case c({-6200, 0});
  const auto region = c.region();
  ASSERT_TRUE(region);
  EXPECT_TRUE(region->mesh.triangles.empty());
  EXPECT_EQ(region->under_tool.area_steps2, 0);
  RegionWorkspace workspace;
  const auto response = prepare_region(c.sheet, {}, c.tool, kLattice, kMembrane, {}, workspace);
  ASSERT_TRUE(response);
  EXPECT_EQ(response->response.stiffness_N_per_m, 0);
}

// A tool larger than the sheet: only the Winkler foundation acts on it, at the sheet's centroid.
TEST(Region, OnlyTheBedActsOnAToolThatCoversTheSheet) {
  const SliceMesh small = test::square_mesh({-200, -100}, 50, 4);
  const SheetMesh sheet = sheet_of(small);
  const Ring tool = test::regular_polygon({0, 0}, 768, 6);
  RegionWorkspace workspace;
  const auto region =
      prepare_region(sheet, find_seeds(sheet, tool), tool, kLattice, kMembrane, {}, workspace);
  ASSERT_TRUE(region) << region.error().message;
  const RegionResponse& r = region->response;
  EXPECT_NEAR(r.stiffness_N_per_m / (kMembrane.foundation_N_per_m3 * 200 * 200 * kStep_m * kStep_m),
              1, 1e-12);
  EXPECT_NEAR(r.centre_steps.x(), -100, 1e-9);
  EXPECT_NEAR(r.centre_steps.y(), 0, 1e-9);
  EXPECT_EQ(r.free_nodes, 0U);
  EXPECT_EQ(r.bounds.force, 0);
}

TEST(Region, RefusesInvalidOutlines) {
  Case c({0, 0});
  c.tool.resize(2);
  EXPECT_FALSE(c.region());
  c.tool = {{0, 0}, {0, 500}, {500, 0}};  // clockwise
  EXPECT_FALSE(c.region());
  c = Case({0, 0});
  c.options.radius_m = 0;
  EXPECT_FALSE(c.region());
  c.options.radius_m = std::nan("");
  EXPECT_FALSE(c.region());
}

// Extra and repeated seeds do not change the region.
TEST(Region, ExtraAndRepeatedSeedsDoNotMatter) {
  Case c({300, 200});
  RegionWorkspace workspace;
  std::vector<std::uint32_t> seeds = find_seeds(c.sheet, c.tool);
  const auto expected = make_region(c.sheet, seeds, c.tool, kLattice, c.options, workspace);
  ASSERT_TRUE(expected);
  const std::vector<std::uint32_t> once = seeds;
  seeds.insert(seeds.end(), once.begin(), once.end());
  seeds.push_back(4000000000U);
  seeds.push_back(0);  // far away
  const auto found = make_region(c.sheet, seeds, c.tool, kLattice, c.options, workspace);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->mesh.triangles, expected->mesh.triangles);
  EXPECT_EQ(found->mesh.vertices, expected->mesh.vertices);
  EXPECT_EQ(found->kind, expected->kind);
}

// If the border passes through a vertex twice, the part has the vertex twice.
TEST(Part, IsAValidMeshWhereItsBorderPinches) {
  std::mt19937_64 random(1);
  const SheetMesh sheet = sheet_of(test::square_mesh({0, 0}, 512, 20));
  std::vector<std::uint32_t> queue;
  int pinched = 0;
  for (int i = 0; i < 300; ++i) {
    Circle circle;
    circle.centre = {10240 * test::uniform(random), 10240 * test::uniform(random)};
    circle.radius = 30;
    // Two seeds apart from each other, whose surroundings touch.
    const auto t = static_cast<std::uint32_t>(random() % 600);
    const std::vector<std::uint32_t> seeds{t, t + 43, t + 86};
    const SheetPart part = part_around(sheet, seeds, circle, 900 * test::uniform(random), queue);
    ASSERT_TRUE(check_mesh(part.mesh)) << i;
    const std::set<std::uint32_t> parents(part.parent.begin(), part.parent.end());
    if (parents.size() < part.parent.size()) ++pinched;
    for (std::size_t v = 0; v < part.parent.size(); ++v)
      EXPECT_EQ(part.mesh.vertices[v], sheet.vertices[part.parent[v]]);
  }
  EXPECT_GT(pinched, 10);
}

// Contract 4: in a sheet a hundred times as large the region is the same, and its search as small.
TEST(Region, DoesNotDependOnTheRestOfTheSheet) {
  const SliceMesh small = test::square_mesh({-10 * 512, -10 * 512}, 512, 20);
  const SliceMesh large = test::square_mesh({-100 * 512, -100 * 512}, 512, 200);
  const Ring tool = test::regular_polygon({100, 50}, 768, 6, 0.3);
  RegionOptions options;
  options.radius_m = 0.01;
  RegionWorkspace workspace;
  std::vector<LatticePoint> vertices[2];
  for (int i = 0; i < 2; ++i) {
    const SheetMesh sheet = sheet_of(i == 0 ? small : large);
    const auto region =
        make_region(sheet, find_seeds(sheet, tool), tool, kLattice, options, workspace);
    ASSERT_TRUE(region);
    vertices[i] = region->mesh.vertices;
    EXPECT_LT(workspace.queue.size(), 2000U);
  }
  EXPECT_EQ(vertices[0], vertices[1]);
}

}  // namespace
}  // namespace trocar::runtime
