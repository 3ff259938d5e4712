// SPDX-License-Identifier: GPL-3.0-or-later
// Triangulation and refinement of random outlines and of difficult ones; the constrained Delaunay
// triangulation compared with CGAL's, triangle by triangle.
#include "formats/mesh/mesh_quality.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <set>
#include <utility>
#include <vector>

#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/refinement.h"
#include "formats/mesh/regions.h"
#include "formats/mesh/triangulation.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/simplification.h"
#include "tests/support/cgal_sheets.h"
#include "tests/support/cut_checks.h"
#include "tests/support/motions.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/take.h"
#include "tests/support/test_lattice.h"

namespace trocar::pipeline {
namespace {

using trocar::test::kLattice;
constexpr PixelGrid kGrid{0.5, 0.5, 0, 0, kLattice};

// The mesh of every outline is valid, conforming and Delaunay, with exact area.
void expect_valid_refinement(const Pslg& pslg, const RefinementOptions& options,
                             const std::string& what) {
  const auto cdt = triangulate(pslg);
  ASSERT_TRUE(cdt) << what << ": " << cdt.error().message;
  auto ok = check_mesh_against_pslg(cdt->mesh, pslg);
  ASSERT_TRUE(ok) << what << ": " << ok.error().message;
  ASSERT_TRUE(is_constrained_delaunay(cdt->mesh)) << what;
  const Refined refined = refine(*cdt, kLattice, options);
  ok = check_mesh_against_pslg(refined.mesh, boundary_rings(refined.mesh));
  ASSERT_TRUE(ok) << what << ": " << ok.error().message;
  EXPECT_TRUE(is_constrained_delaunay(refined.mesh)) << what;
  EXPECT_NE(refined.outcome, RefinementOutcome::kVertexBudget) << what;
  const MeshQuality quality = measure_quality(refined, kLattice, options.min_angle_deg);
  double smallest_deg = 180;
  for (const Triangle& t : refined.mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      const LatticePoint at = refined.mesh.vertices[t[i]],
                         p = refined.mesh.vertices[t[(i + 1) % 3]],
                         q = refined.mesh.vertices[t[(i + 2) % 3]];
      smallest_deg =
          std::min(smallest_deg, std::atan2(static_cast<double>(orient2d(at, p, q)),
                                            static_cast<double>(diametral_dot(p, q, at))) *
                                     180 / std::numbers::pi);
    }
  }
  if (!refined.mesh.triangles.empty()) {
    EXPECT_NEAR(quality.min_angle_deg, smallest_deg, 1e-9) << what;
  }
  EXPECT_EQ(quality.below_unexplained, 0U) << what;
  EXPECT_EQ(quality.negative_stiffness_edges, 0U) << what;
  EXPECT_EQ(quality.below_min_angle, quality.below_at_small_input_angle) << what;
  if (quality.below_min_angle == 0 && !refined.mesh.triangles.empty()) {
    EXPECT_GE(quality.min_angle_deg, options.min_angle_deg - 1e-9) << what;
  }
  // A boundary vertex stays within three steps of the segment it splits.
  for (std::size_t v = 0; v < refined.mesh.vertices.size(); ++v) {
    const std::int32_t s = refined.origins[v].segment;
    if (s < 0) continue;
    const LatticePoint a =
        refined.mesh.vertices[refined.segments[static_cast<std::size_t>(s)].from];
    const LatticePoint b = refined.mesh.vertices[refined.segments[static_cast<std::size_t>(s)].to];
    const double off = static_cast<double>(orient2d(a, b, refined.mesh.vertices[v])) /
                       std::sqrt(static_cast<double>(distance2(a, b)));
    EXPECT_GE(off, 0.0) << what;
    EXPECT_LT(off, 3.0) << what;
  }
}

TEST(Refinement, LeavesNothingAsItIs) {
  for (const double max_area_mm2 : {1e-6, 50.0, 1e12}) {
    RefinementOptions options;
    options.max_area_mm2 = max_area_mm2;
    EXPECT_TRUE(refine(Triangulation{}, Lattice{}, options).mesh.triangles.empty()) << max_area_mm2;
  }
}

TEST(Refinement, ReachesAnglesAndAreasOnSmoothOutlines) {
  for (const double radius : {3.0, 12.0, 25.0}) {
    const Pslg disc =
        simplify(contours(disc_field(64, 31.3, 31.8, radius), kGrid, ContourKind::kSubpixel),
                 kLattice, {0.1});
    for (const double angle : {20.0, 30.0, 33.0}) {
      for (const double area : {0.5, 5.0, 1e9}) {
        RefinementOptions options;
        options.min_angle_deg = angle;
        options.max_area_mm2 = area;
        const Refined refined = refine(*triangulate(disc), kLattice, options);
        const MeshQuality quality = measure_quality(refined, kLattice, angle);
        EXPECT_EQ(quality.below_min_angle, 0U) << radius << ' ' << angle << ' ' << area;
        EXPECT_LE(quality.max_area_mm2, area);
        expect_valid_refinement(disc, options, "disc");
      }
    }
  }
}

// Points of splits are rounded to the lattice, which moves the outline. With keep_area, the areas
// that the splits of a loop add and remove balance.
TEST(Refinement, KeepsTheAreaIfWanted) {
  double kept = 0, rounded = 0;
  for (int k = 0; k < 20; ++k) {
    const Pslg disc =
        simplify(contours(disc_field(64, 31.3, 31.8, 10 + 0.7 * k), kGrid, ContourKind::kSubpixel),
                 kLattice, {0.1});
    for (const bool keep_area : {true, false}) {
      RefinementOptions options;
      options.max_area_mm2 = 0.5;
      options.keep_area = keep_area;
      const Refined refined = refine(*triangulate(disc), kLattice, options);
      (keep_area ? kept : rounded) +=
          std::abs(static_cast<double>(doubled_area(refined.mesh) - doubled_area(disc)));
    }
  }
  EXPECT_LT(kept, 0.02 * rounded);
}

// If only the area bound requires triangles, nearly all are equilateral and of that area.
TEST(Refinement, FillsLargeAreasWithHardlyMoreTrianglesThanTheAreaAsksFor) {
  Pslg pslg = simplify(contours(disc_field(64, 31.3, 31.8, 25), kGrid, ContourKind::kSubpixel),
                       kLattice, {0.1});
  pslg.rings.push_back({{4000, 4000}, {3700, 4500}, {5000, 4700}});
  const double area_mm2 =
      0.5 * static_cast<double>(doubled_area(pslg)) * kLattice.step_mm() * kLattice.step_mm();
  for (const double wanted : {500.0, 2000.0, 8000.0}) {
    RefinementOptions options;
    options.max_area_mm2 = area_mm2 / wanted;
    const Refined refined = refine(*triangulate(pslg), kLattice, options);
    const auto triangles = static_cast<double>(refined.mesh.triangles.size());
    EXPECT_LE(triangles, wanted * (1.05 + 3 / std::sqrt(wanted))) << wanted;
    const MeshQuality quality = measure_quality(refined, kLattice, 30);
    EXPECT_EQ(quality.below_min_angle, 0U) << wanted;
    EXPECT_LE(quality.max_area_mm2, options.max_area_mm2);
    expect_valid_refinement(pslg, options, "filled");
  }
}

// Wider than an asset may be: products of coordinates do not fit into a double.
TEST(Refinement, GivesValidMeshesOnTheWholeLattice) {
  for (const std::int32_t scale : {1, 1 << 13}) {
    Pslg pslg;
    for (const Ring& ring :
         simplify(contours(noise_field(64, 3, 5), kGrid, ContourKind::kSubpixel), kLattice, {0.25})
             .rings) {
      Ring& scaled = pslg.rings.emplace_back();
      for (const LatticePoint p : ring)
        scaled.push_back({p.x * scale, p.y * scale});
    }
    RefinementOptions options;
    options.max_area_mm2 = 1e12;
    expect_valid_refinement(pslg, options, "scaled by " + std::to_string(scale));
  }
}

TEST(Refinement, GivesValidMeshesOnNoise) {
  for (const int passes : {1, 2, 4, 8}) {
    for (std::uint64_t seed = 0; seed < 15; ++seed) {
      const Pslg full = drop_small_rings(
          contours(noise_field(64, passes, seed), kGrid, ContourKind::kSubpixel), 0.25, kLattice);
      expect_valid_refinement(
          simplify(full, kLattice, {0.25, SimplificationMethod::kDouglasPeucker}), {},
          "noise " + std::to_string(passes) + " seed " + std::to_string(seed));
    }
  }
}

// The same triangles, origins and segments under other numbers; neighbours have numbers that are
// near each other.
TEST(PlaceOrder, OnlyNumbersAnew) {
  const Pslg outline =
      simplify(contours(noise_field(128, 2, 1), kGrid, ContourKind::kSubpixel), kLattice, {0.2});
  const Refined before = refine(*triangulate(outline), kLattice, {});
  Refined after = before;
  sort_by_position(after);
  const auto at = [](const Refined& r, std::uint32_t v) { return r.mesh.vertices[v]; };
  EXPECT_EQ(test::canonical(after.mesh), test::canonical(before.mesh));
  const auto origins = [&](const Refined& r) {
    std::vector<std::pair<LatticePoint, std::int32_t>> out;
    for (std::uint32_t v = 0; v < r.origins.size(); ++v)
      out.emplace_back(at(r, v), r.origins[v].segment);
    std::sort(out.begin(), out.end());
    return out;
  };
  EXPECT_EQ(origins(after), origins(before));
  ASSERT_EQ(after.segments.size(), before.segments.size());
  for (std::size_t s = 0; s < before.segments.size(); ++s) {
    EXPECT_EQ(at(after, after.segments[s].from), at(before, before.segments[s].from));
    EXPECT_EQ(at(after, after.segments[s].to), at(before, before.segments[s].to));
  }
  EXPECT_TRUE(check_mesh(after.mesh));
  const auto mean_gap = [](const Refined& r) {
    double sum = 0;
    for (const Triangle& t : r.mesh.triangles)
      sum += std::max({t[0], t[1], t[2]}) - std::min({t[0], t[1], t[2]});
    return sum / static_cast<double>(r.mesh.triangles.size());
  };
  EXPECT_LT(mean_gap(after), 0.2 * mean_gap(before));
  Refined none;
  sort_by_position(none);
  EXPECT_TRUE(none.mesh.vertices.empty());
}

// Up to 33 degrees refinement reaches the wanted angle; beyond, it reports the largest angle that
// it reached within its budget.
TEST(Refinement, EndsForLargeAngles) {
  int unreached = 0;
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    const Pslg full = drop_small_rings(
        contours(noise_field(48, 3, seed), kGrid, ContourKind::kSubpixel), 0.25, kLattice);
    const Pslg pslg = simplify(full, kLattice, {0.25, SimplificationMethod::kDouglasPeucker});
    for (const double angle : {33.0, 36.0, 45.0, 59.0}) {
      RefinementOptions options;
      options.min_angle_deg = angle;
      options.max_vertices = seed % 2 == 0 ? 0 : 20'000;
      const Refined refined = refine(*triangulate(pslg), kLattice, options);
      const auto ok = check_mesh_against_pslg(refined.mesh, boundary_rings(refined.mesh));
      ASSERT_TRUE(ok) << angle << ": " << ok.error().message;
      EXPECT_TRUE(is_constrained_delaunay(refined.mesh));
      ASSERT_NE(refined.outcome, RefinementOutcome::kVertexBudget) << angle;
      if (refined.outcome == RefinementOutcome::kAngleNotReached) {
        ++unreached;
        EXPECT_GT(angle, kSafeAngle_deg);
        EXPECT_LT(refined.angle_deg, angle);
      } else {
        EXPECT_EQ(refined.angle_deg, angle);
      }
      EXPECT_GE(refined.angle_deg, std::min(angle, kSafeAngle_deg));
      if (refined.bad_at_lattice_step == 0) {
        EXPECT_EQ(measure_quality(refined, kLattice, refined.angle_deg).below_unexplained, 0U)
            << angle;
      }
    }
  }
  EXPECT_GT(unreached, 0);
}

// If the vertex budget is too small, the mesh is valid and the outcome says that it is incomplete.
TEST(Refinement, StopsAtItsVertexBudget) {
  const Pslg disc = simplify(
      contours(disc_field(64, 31.3, 31.8, 25), kGrid, ContourKind::kSubpixel), kLattice, {0.1});
  RefinementOptions options;
  options.max_area_mm2 = 0.5;
  options.max_vertices = 300;
  for (const double angle : {30.0, 40.0}) {
    options.min_angle_deg = angle;
    const Refined refined = refine(*triangulate(disc), kLattice, options);
    EXPECT_EQ(refined.outcome, RefinementOutcome::kVertexBudget);
    EXPECT_EQ(refined.mesh.vertices.size(), options.max_vertices);
    EXPECT_TRUE(check_mesh_against_pslg(refined.mesh, boundary_rings(refined.mesh)));
    EXPECT_TRUE(is_constrained_delaunay(refined.mesh));
  }
}

// Compared with cotangents in floating point; an unrefined mesh has such edges.
TEST(MeshQuality, CountsEdgesOfNegativeStiffness) {
  EXPECT_EQ(count_negative_stiffness_edges({{{0, 0}, {8, 0}, {4, 3}}, {{0, 1, 2}}}), 1U);
  EXPECT_EQ(count_negative_stiffness_edges({{{0, 0}, {8, 0}, {4, 4}}, {{0, 1, 2}}}), 0U);
  std::uint32_t in_all = 0;
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const auto cdt = test::take(triangulate(simplify(
        contours(noise_field(64, 3, seed), kGrid, ContourKind::kSubpixel), kLattice, {0.2})));
    std::map<std::pair<std::uint32_t, std::uint32_t>, double> stiffness;
    for (const Triangle& t : cdt.mesh.triangles) {
      for (std::size_t i = 0; i < 3; ++i) {
        const std::uint32_t p = t[(i + 1) % 3], q = t[(i + 2) % 3];
        const LatticePoint a = cdt.mesh.vertices[t[i]], b = cdt.mesh.vertices[p],
                           c = cdt.mesh.vertices[q];
        stiffness[std::minmax(p, q)] +=
            static_cast<double>(diametral_dot(b, c, a)) / static_cast<double>(orient2d(a, b, c));
      }
    }
    const auto below = [&](double bound) {
      return static_cast<std::uint32_t>(
          std::count_if(stiffness.begin(), stiffness.end(),
                        [bound](const auto& edge) { return edge.second < bound; }));
    };
    const std::uint32_t count = count_negative_stiffness_edges(cdt.mesh);
    EXPECT_GE(count, below(-1e-9)) << seed;  // four points on a circle leave a zero
    EXPECT_LE(count, below(1e-9)) << seed;
    in_all += count;
  }
  EXPECT_GT(in_all, 100U);
}

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

}  // namespace
}  // namespace trocar::pipeline
