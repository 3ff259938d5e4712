// SPDX-License-Identifier: GPL-3.0-or-later
// The cut and its triangulation on thousands of random sheets and tools, compared with CGAL's
// constrained Delaunay triangulation and with clipping in floating point. The seeds are fixed;
// small coordinates make every degenerate case common.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "formats/mesh/cut.h"
#include "formats/mesh/local_delaunay.h"
#include "tests/support/cgal_sheets.h"
#include "tests/support/cut_checks.h"
#include "tests/support/random_geometry.h"
#include "tests/support/whole_cut.h"

namespace trocar::runtime {
namespace {

// A sheet of radius about `size`: an outline, up to three holes, inner points.
SliceMesh sheet_of_points(Random& random, int size, int points) {
  while (true) {
    std::vector<Ring> outline = {star(random, {0, 0}, 0.6 * size, size, random.between(8, 20))};
    const int holes = random.between(0, 3);
    for (int h = 0; h < holes; ++h) {
      const double a = 2.1 * h + random.unit();
      const LatticePoint c{static_cast<int>(0.33 * size * std::cos(a)),
                           static_cast<int>(0.33 * size * std::sin(a))};
      outline.push_back(star(random, c, 0.08 * size, 0.16 * size, random.between(4, 8)));
    }
    if (!check_pslg({outline})) continue;
    std::vector<LatticePoint> inner;
    inner.reserve(static_cast<std::size_t>(points));
    for (int i = 0; i < points; ++i)
      inner.push_back(random.point(-size, size));
    SliceMesh mesh = mesh_of(outline, inner);
    if (check_mesh(mesh)) return mesh;
  }
}

// --- independent areas and memberships -------------------------------------

// Twice the area that sheet and tool have in common, triangle by triangle.
Real common_area(const SliceMesh& sheet, const Ring& tool) {
  const SliceMesh parts = mesh_of({tool}, {});
  Real sum = 0;
  for (std::size_t t = 0; t < sheet.triangles.size(); ++t)
    sum += runtime::common_area(corners_of(sheet, t), parts);
  return sum;
}

struct Count {
  int cuts = 0, inside = 0, crossing = 0, outline_broken = 0;
};

// Outlines cross themselves only where bent boundaries crossed, which is rare.
void expect_simple_outlines(const Count& n) {
  EXPECT_LE(n.outline_broken * 50, n.cuts);
}

// One cut, with all checks that do not need the code under test.
void checked_cut(const SliceMesh& sheet, const Ring& tool, Random& random, Count& n,
                 SliceMesh* after = nullptr) {
  const Result<CutResult> r = cut(sheet, tool);
  ASSERT_TRUE(r) << r.error().message;
  ASSERT_EQ(contract_violation(sheet, *r), "");
  ASSERT_EQ(outline_violation(*r), "");
  ++n.cuts;
  const std::vector<Ring> old_rings = boundary_rings(sheet).rings;
  const std::vector<Ring> new_rings = boundary_rings(r->mesh).rings;

  // The area, by clipping.
  const Real common = common_area(sheet, tool), bound = rounding_bound(old_rings, tool);
  ASSERT_NEAR(static_cast<double>(r->doubled_area_removed), static_cast<double>(common),
              static_cast<double>(bound) + 1e-6);
  if (common < 1e-6L) {
    ASSERT_EQ(r->mesh.triangles, sheet.triangles);
  } else if (bound == 0 && std::abs(common - static_cast<Real>(doubled_area(tool))) < 1e-6L) {
    ++n.inside;
    ASSERT_EQ(r->hole, std::vector<Ring>{from_smallest(tool)});
  } else {
    ++n.crossing;
  }

  // Membership of points farther from all outlines than bends reach.
  for (int i = 0; i < 20; ++i) {
    const LatticePoint near = random.pick(tool);
    const Real x = near.x + 60 * (random.unit() - 0.5), y = near.y + 60 * (random.unit() - 0.5);
    if (nearest_edge(x, y, old_rings) < 3 || nearest_edge(x, y, {tool}) < 3) continue;
    const int expected = winding(x, y, old_rings) == 1 && winding(x, y, {tool}) == 0 ? 1 : 0;
    ASSERT_EQ(winding(x, y, new_rings), expected) << "at " << x << ", " << y;
  }
  if (after != nullptr) *after = r->mesh;
}

// A cut where rounding decides everything: checks only the contract, and that the mesh winds around
// every point at most once (areas alone would not show overlaps).
void small_cut(SliceMesh& sheet, const Ring& tool, int size, Random& random, Count& n) {
  const Result<CutResult> r = cut(sheet, tool);
  ASSERT_TRUE(r) << r.error().message;
  ASSERT_EQ(contract_violation(sheet, *r), "");
  if (!outline_violation(*r).empty()) ++n.outline_broken;
  ++n.cuts;
  const std::vector<Ring> rings = boundary_rings(r->mesh).rings;
  for (int i = 0; i < 4; ++i) {
    const Real x = (2 * random.unit() - 1) * size, y = (2 * random.unit() - 1) * size;
    if (nearest_edge(x, y, rings) < 1e-9L) continue;
    const int w = winding(x, y, rings);
    ASSERT_TRUE(w == 0 || w == 1) << w;
  }
  sheet = r->mesh;
}

#define OR_RETURN \
  if (HasFatalFailure()) return

TEST(CutProperty, RandomToolsOnRandomSheets) {
  Random random(1);
  Count n;
  for (int s = 0; s < 60; ++s) {
    const int size = random.between(300, 3000);
    const SliceMesh sheet = sheet_of_points(random, size, random.between(0, 200));
    for (int k = 0; k < 40; ++k) {
      SCOPED_TRACE(testing::Message() << "sheet " << s << ", tool " << k);
      const Ring tool = any_tool(random, random.point(-size, size),
                                 random.between(10, k % 10 == 0 ? size : size / 4));
      checked_cut(sheet, tool, random, n);
      OR_RETURN;
    }
  }
  EXPECT_GT(n.inside, 200);
  EXPECT_GT(n.crossing, 200);
}

TEST(CutProperty, ManyCutsInOneSheet) {
  Count n;
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    Random random(100 + seed);
    SliceMesh sheet = sheet_of_points(random, 3000, 150);
    for (int k = 0; k < 100; ++k) {
      SCOPED_TRACE(testing::Message() << "seed " << seed << ", cut " << k);
      const Ring tool = any_tool(random, random.point(-2000, 2000), random.between(50, 500));
      checked_cut(SliceMesh(sheet), tool, random, n, &sheet);
      OR_RETURN;
    }
  }
}

TEST(CutProperty, ToolsMovedByOneStep) {
  // The same hexagon, moved by one step each time: it crosses the outline at grazing angles, where
  // rounding errors are largest.
  Count n;
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    Random random(200 + seed);
    SliceMesh sheet = sheet_of_points(random, 1000, 60);
    LatticePoint at = random.point(-500, 500);
    const Ring tool = star(random, {0, 0}, 60, 64, 6);
    for (int k = 0; k < 100; ++k) {
      SCOPED_TRACE(testing::Message() << "seed " << seed << ", cut " << k);
      at.x += random.between(-1, 1);
      at.y += random.between(-1, 1);
      Ring moved = tool;
      for (LatticePoint& p : moved)
        p = {p.x + at.x, p.y + at.y};
      small_cut(sheet, moved, 1000, random, n);
      OR_RETURN;
    }
  }
  expect_simple_outlines(n);
}

TEST(CutProperty, CoarseLattice) {
  Count n;
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    Random random(1000 + seed);
    const int size = random.between(4, 40);
    SliceMesh sheet = sheet_of_points(random, size, random.between(0, 30));
    for (int k = 0; k < 30 && !sheet.triangles.empty(); ++k) {
      SCOPED_TRACE(testing::Message() << "seed " << seed << ", cut " << k);
      const int radius = random.between(1, std::max(2, size / 3));
      small_cut(sheet, any_tool(random, random.point(-size, size), std::max(radius, 3)), size,
                random, n);
      OR_RETURN;
    }
  }
  expect_simple_outlines(n);
}

TEST(CutProperty, NeedlesInNeedles) {
  // Long thin tools in long thin sheets: crossings far from where they round to.
  Count n;
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    Random random(5000 + seed);
    Ring outline;
    do {
      outline = {random.point(-100, -90), random.point(-5, 5), random.point(90, 100),
                 random.point(-5, 5)};
      for (LatticePoint& p : outline)
        p.y = random.between(-6, 6);
    } while (!is_tool(outline));
    SliceMesh sheet = mesh_of({outline}, {});
    for (int k = 0; k < 25 && !sheet.triangles.empty(); ++k) {
      SCOPED_TRACE(testing::Message() << "seed " << seed << ", cut " << k);
      Ring tool;
      do {
        tool.clear();
        for (int i = random.between(3, 4); i > 0; --i) {
          tool.push_back({random.between(-110, 110), random.between(-7, 7)});
        }
      } while (!is_tool(tool));
      small_cut(sheet, tool, 100, random, n);
      OR_RETURN;
    }
  }
  expect_simple_outlines(n);
}

TEST(CutProperty, SheetsOverTheWholeLattice) {
  Count n;
  Random random(7000);
  for (int s = 0; s < 20; ++s) {
    const int size = kMaxCoordinate - 1;
    SliceMesh sheet = sheet_of_points(random, size, 60);
    for (int k = 0; k < 20; ++k) {
      SCOPED_TRACE(testing::Message() << "sheet " << s << ", cut " << k);
      const Ring tool = convex(random, random.point(-size / 2, size / 2), size / 2, 8);
      const Real common = common_area(sheet, tool);
      const std::int64_t before = doubled_area(sheet);
      small_cut(sheet, tool, size, random, n);
      OR_RETURN;
      // Floating point and rounding together stay far below a millionth here.
      ASSERT_NEAR(static_cast<double>(before - doubled_area(sheet)), static_cast<double>(common),
                  1e-6 * static_cast<double>(doubled_area(tool)));
    }
  }
  expect_simple_outlines(n);
}

// --- the triangulation by itself ---------------------------------------------

using Status = LocalTriangulation::Status;

Status triangulated(const std::vector<LatticePoint>& points,
                    const std::vector<std::array<std::uint32_t, 2>>& constraints,
                    LocalTriangulation& out) {
  out.allocate(points.size());
  Status status = out.triangulate(points);
  for (std::uint32_t i = 0; i < constraints.size() && status == Status::kDone; ++i)
    status = out.constrain(constraints[i][0], constraints[i][1], i);
  return status;
}

TEST(LocalDelaunayProperty, AgreesWithCgal) {
  int constraints_seen = 0;
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    SCOPED_TRACE(testing::Message() << "seed " << seed);
    Random random(9000 + seed);
    const int size = random.between(3, seed % 2 == 0 ? 12 : 5000);
    std::set<LatticePoint> distinct;
    for (int i = random.between(1, 80); i > 0; --i)
      distinct.insert(random.point(-size, size));
    const std::vector<LatticePoint> points(distinct.begin(), distinct.end());
    const int n = static_cast<int>(points.size());
    std::vector<std::array<std::uint32_t, 2>> constraints;
    for (int i = random.between(0, 2 * n); i > 0; --i) {
      const auto a = static_cast<std::uint32_t>(random.between(0, n - 1));
      const auto b = static_cast<std::uint32_t>(random.between(0, n - 1));
      bool free = a != b;
      for (LatticePoint p : points) {
        free = free && !(orient2d(points[a], points[b], p) == 0 &&
                         diametral_dot(points[a], points[b], p) < 0);
      }
      for (const auto& [c, d] : constraints) {
        free = free && !segments_cross(points[a], points[b], points[c], points[d]);
      }
      if (free) constraints.push_back({a, b});
    }
    constraints_seen += static_cast<int>(constraints.size());

    LocalTriangulation ours;
    ASSERT_EQ(triangulated(points, constraints, ours), Status::kDone);
    Cdt cdt;
    for (LatticePoint p : ours.points())
      cdt.insert(to_cgal(p));
    for (const auto& [a, b] : constraints) {
      cdt.insert_constraint(to_cgal(points[a]), to_cgal(points[b]));
    }
    ASSERT_EQ(ours.cells().size(), cdt.number_of_faces());
    SliceMesh mesh{{ours.points().begin(), ours.points().end()}, {}};
    std::int64_t free = 0;
    for (const Cell& c : ours.cells()) {
      mesh.triangles.push_back(c.vertex);
      free += std::count(c.constraint.begin(), c.constraint.end(), kNoSlot);
    }
    ASSERT_TRUE(check_mesh(mesh));
    ASSERT_EQ(3 * static_cast<std::int64_t>(ours.cells().size()) - free,
              2 * static_cast<std::int64_t>(constraints.size()));
  }
  EXPECT_GT(constraints_seen, 3000);
}

TEST(LocalDelaunayProperty, RestoredPartsAgreeWithCgalExceptForCocircularPoints) {
  // The inside of a random ring is one part: its edges are CGAL's, or ties between diagonals.
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE(testing::Message() << "seed " << seed);
    Random random(20000 + seed);
    const int size = random.between(20, 4000);
    const Ring ring = star(random, {0, 0}, 0.2 * size, size, random.between(5, 60));
    Ring points = ring;
    std::sort(points.begin(), points.end());
    std::vector<std::array<std::uint32_t, 2>> constraints;
    auto index = [&points](LatticePoint p) {
      return static_cast<std::uint32_t>(std::lower_bound(points.begin(), points.end(), p) -
                                        points.begin());
    };
    for (std::size_t i = 0; i < ring.size(); ++i) {
      constraints.push_back({index(ring[i]), index(ring[(i + 1) % ring.size()])});
    }
    LocalTriangulation ours;
    ASSERT_EQ(triangulated(points, constraints, ours), Status::kDone);
    std::vector<std::uint8_t> part(ours.cells().size());
    for (std::size_t c = 0; c < part.size(); ++c) {
      Real x = 0, y = 0;
      for (std::uint32_t v : ours.cells()[c].vertex) {
        x += ours.points()[v].x / Real(3);
        y += ours.points()[v].y / Real(3);
      }
      part[c] = winding(x, y, {ring}) == 1 ? 1 : 0;
    }
    ours.restore_delaunay(part);
    SliceMesh mesh{{ours.points().begin(), ours.points().end()}, {}};
    for (std::size_t c = 0; c < part.size(); ++c) {
      if (part[c] == 1) mesh.triangles.push_back(ours.cells()[c].vertex);
    }
    ASSERT_EQ(doubled_area(mesh), doubled_area(ring));
    ASSERT_TRUE(is_constrained_delaunay(mesh));

    const SliceMesh theirs = mesh_of({ring}, {});
    ASSERT_EQ(theirs.triangles.size(), mesh.triangles.size());
    std::set<std::pair<LatticePoint, LatticePoint>> of_cgal;
    for (std::size_t t = 0; t < theirs.triangles.size(); ++t) {
      const Corners c = corners_of(theirs, t);
      for (std::size_t i = 0; i < 3; ++i)
        of_cgal.insert({c[i], c[(i + 1) % 3]});
    }
    for (std::size_t c = 0; c < part.size(); ++c) {
      if (part[c] == 0) continue;
      const Cell& cell = ours.cells()[c];
      for (std::size_t i = 0; i < 3; ++i) {
        const LatticePoint a = ours.points()[cell.vertex[i]],
                           b = ours.points()[cell.vertex[(i + 1) % 3]];
        if (of_cgal.contains({a, b})) continue;
        const Cell& beyond = ours.cells()[cell.across[i]];
        ASSERT_TRUE(is_tie(ours.points(), cell.vertex, beyond.vertex))
            << "an edge that is neither CGAL's nor a tie";
      }
    }
  }
}

TEST(LocalDelaunayProperty, RefusesInputThatIsNoPslg) {
  LocalTriangulation t;
  EXPECT_EQ(triangulated({{0, 0}, {0, 0}}, {}, t), Status::kNotPlanar);
  EXPECT_EQ(triangulated({{0, 0}, {2, 0}, {4, 0}}, {{0, 2}}, t), Status::kNotPlanar);
  EXPECT_EQ(triangulated({{0, 0}, {4, 4}, {0, 4}, {4, 0}}, {{0, 1}, {2, 3}}, t),
            Status::kNotPlanar);
  LocalTriangulation small;
  small.allocate(2);
  EXPECT_EQ(small.triangulate(std::array<LatticePoint, 3>{{{0, 0}, {4, 4}, {0, 4}}}),
            Status::kCapacity);
}

}  // namespace
}  // namespace trocar::runtime
