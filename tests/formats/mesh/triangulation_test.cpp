// SPDX-License-Identifier: GPL-3.0-or-later
// The constrained Delaunay triangulation compared with CGAL's, triangle by triangle.
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/triangulation.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/simplification.h"
#include "tests/support/cgal_sheets.h"
#include "tests/support/cut_checks.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/test_lattice.h"

namespace trocar::pipeline {
namespace {

// Equal except where four points lie on one circle and both diagonals are Delaunay.
void expect_as_cgal(const Pslg& pslg, const std::string& what) {
  const auto triangulation = triangulate(pslg);
  ASSERT_TRUE(triangulation) << what << ": " << triangulation.error().message;
  const SliceMesh* mesh = &triangulation->mesh;
  const auto ok = check_mesh_against_pslg(*mesh, pslg);
  ASSERT_TRUE(ok) << what << ": " << ok.error().message;
  ASSERT_TRUE(is_constrained_delaunay(*mesh)) << what;
  const auto by_cgal = runtime::triangles_of(runtime::mesh_of(pslg.rings, {}));
  const std::set<runtime::Corners> theirs(by_cgal.begin(), by_cgal.end());
  EXPECT_EQ(mesh->triangles.size(), theirs.size()) << what;
  const Neighbours beyond = neighbours(*mesh);
  EXPECT_EQ(triangulation->beyond, beyond) << what;
  for (std::size_t t = 0; t < mesh->triangles.size(); ++t) {
    const Triangle& v = mesh->triangles[t];
    if (theirs.contains(runtime::corners_of(*mesh, t))) continue;
    const bool cocircular = std::any_of(beyond[t].begin(), beyond[t].end(), [&](EdgeId e) {
      return e != kNoEdge && runtime::is_tie(mesh->vertices, v, mesh->triangles[triangle_of(e)]);
    });
    EXPECT_TRUE(cocircular) << what << ": a triangle that CGAL does not have";
  }
}

TEST(Triangulation, AgreesWithCgalOnNoise) {
  for (const double pixel_mm : {0.5, 0.3711}) {
    const PixelGrid grid{pixel_mm, pixel_mm, 0, 0, test::kLattice};
    for (const ContourKind kind : {ContourKind::kSubpixel, ContourKind::kPixel}) {
      for (const int passes : {1, 2, 5}) {
        for (std::uint64_t seed = 0; seed < 12; ++seed) {
          const Pslg full = contours(noise_field(48, passes, seed), grid, kind);
          expect_as_cgal(full, "full, seed " + std::to_string(seed));
          expect_as_cgal(simplify(full, test::kLattice, {0.4}),
                         "simple, seed " + std::to_string(seed));
        }
      }
    }
  }
}

TEST(Triangulation, AgreesWithCgalOnVerticalsTouchesAndCocircularPoints) {
  // A comb of verticals, with holes that touch its teeth and each other.
  Ring comb = {{0, 0}, {900, 0}, {900, 500}};
  for (std::int32_t x = 800; x > 0; x -= 200)
    comb.insert(comb.end(), {{x, 500}, {x, 200}, {x - 100, 200}, {x - 100, 500}});
  comb.push_back({0, 500});
  expect_as_cgal({{comb}}, "comb");
  expect_as_cgal(
      {{comb, {{100, 100}, {200, 200}, {200, 100}}, {{200, 100}, {300, 150}, {300, 100}}}},
      "comb with touching holes");
  expect_as_cgal({{{{0, 0}, {10, 0}, {10, 10}, {0, 10}}, {{4, 4}, {4, 6}, {6, 6}, {6, 4}}}},
                 "square in square");
  expect_as_cgal({{{{-5, 0}, {0, -5}, {5, 0}, {0, 5}}, {{-5, 0}, {0, 4}, {5, 0}, {0, -4}}}},
                 "hole that touches twice");
  const std::int32_t m = kMaxCoordinate;
  expect_as_cgal({{{{-m, -m}, {m, -m}, {m, m}, {-m, m}}, {{-1, 0}, {0, 1}, {1, 0}, {0, -1}}}},
                 "the lattice's corners");
}

TEST(Triangulation, RefusesInvalidOutlines) {
  EXPECT_FALSE(triangulate({{{{0, 0}, {10, 10}, {10, 0}, {0, 10}}}}));  // crosses itself
  EXPECT_FALSE(triangulate({{{{0, 0}, {0, 10}, {10, 10}, {10, 0}}}}));  // clockwise
  EXPECT_FALSE(triangulate(
      {{{{0, 0}, {10, 0}, {10, 10}, {0, 10}}, {{5, 5}, {15, 5}, {15, 8}}}}));  // rings cross
  EXPECT_FALSE(triangulate({{{{0, 0}, {10, 0}, {10, 10}, {0, 10}},
                             {{4, 4}, {6, 4}, {6, 6}, {4, 6}}}}));  // island in material
}

}  // namespace
}  // namespace trocar::pipeline
