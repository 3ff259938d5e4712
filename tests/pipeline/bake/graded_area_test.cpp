// SPDX-License-Identifier: GPL-3.0-or-later
// --grade: smaller triangles where HU change, and only there.
#include "pipeline/bake/mesh_slice.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "formats/mesh/mesh_quality.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/refinement.h"
#include "pipeline/bake/hu_field.h"
#include "tests/support/memory_stack.h"
#include "tests/support/test_lattice.h"

namespace trocar::pipeline {
namespace {

using trocar::test::kLattice;
constexpr int kFieldSide = 81;
const PixelGrid kGrid{0.5, 0.5, 0, 0, kLattice};

Image field_of(const std::function<double(int x, int y)>& value) {
  return image_of(kFieldSide, kFieldSide, value);
}

// A square of 40 mm, refined without and with the bound.
Refined refined(const GradedArea* graded) {
  const std::int32_t a = 0, b = kLattice.snap_mm(40);
  const auto cdt = triangulate({{{{a, a}, {b, a}, {b, b}, {a, b}}}});
  EXPECT_TRUE(cdt);
  RefinementOptions options;
  if (graded != nullptr) {
    options.area_mm2_at = [graded](LatticePoint p) { return graded->mm2_at(p); };
    options.min_area_mm2 = graded->min_mm2();
  }
  return refine(*cdt, kLattice, options);
}

double centroid_x_mm(const SliceMesh& mesh, const Triangle& t) {
  std::int64_t sum = 0;
  for (const std::uint32_t v : t)
    sum += mesh.vertices[v].x;
  return kLattice.to_mm(sum) / 3;
}

TEST(GradedArea, AreaFollowsTheGradient) {
  // 20 HU/mm everywhere: along an edge of 5 mm 100 HU.
  const GradedArea ramp(field_of([](int x, int) { return 10 * x; }), kGrid, 100);
  const LatticePoint middle{kLattice.snap_mm(20), kLattice.snap_mm(20)};
  EXPECT_NEAR(ramp.mm2_at(middle), std::sqrt(3) / 4 * 25, 0.01);
  // Flat: no bound of its own. A step: one pixel, and from there the edge grows by half the
  // distance.
  EXPECT_GT(GradedArea(field_of([](int, int) { return 7; }), kGrid, 100).mm2_at(middle), 1e9);
  const GradedArea step(field_of([](int x, int) { return x < 40 ? 0 : 1000; }), kGrid, 100);
  EXPECT_DOUBLE_EQ(step.mm2_at(middle), 0.25);
  EXPECT_DOUBLE_EQ(step.min_mm2(), 0.25);
  const double edge =
      std::sqrt(step.mm2_at({kLattice.snap_mm(5), kLattice.snap_mm(20)}) * 4 / std::sqrt(3));
  EXPECT_NEAR(edge, std::sqrt(step.min_mm2() * 4 / std::sqrt(3)) + 0.5 * 14.5, 0.3);
}

// Waves in the right half of the square only.
TEST(GradedArea, RefinesWhereHuChange) {
  const Image hu = field_of([](int x, int y) {
    return 600 + (x > 48 ? 200 * std::sin(0.3 * (x - 48)) * std::cos(0.2 * y) : 0);
  });
  const Refined plain = refined(nullptr);
  const auto in_left = [](const SliceMesh& mesh) {
    return std::count_if(mesh.triangles.begin(), mesh.triangles.end(),
                         [&](const Triangle& t) { return centroid_x_mm(mesh, t) < 12; });
  };
  double rms = fit_hu_field(plain.mesh, hu, kGrid).rms_hu;
  std::size_t triangles = plain.mesh.triangles.size();
  for (const double most_hu : {200.0, 100.0, 50.0}) {
    const GradedArea graded(hu, kGrid, most_hu);
    const Refined finer = refined(&graded);
    ASSERT_TRUE(check_mesh(finer.mesh));
    EXPECT_TRUE(is_constrained_delaunay(finer.mesh));
    EXPECT_EQ(finer.outcome, RefinementOutcome::kRefined);
    EXPECT_GE(measure_quality(finer, kLattice, 30).min_angle_deg, 30);
    for (const Triangle& t : finer.mesh.triangles) {
      const LatticePoint a = finer.mesh.vertices[t[0]], b = finer.mesh.vertices[t[1]],
                         c = finer.mesh.vertices[t[2]];
      const LatticePoint centroid{(a.x + b.x + c.x) / 3, (a.y + b.y + c.y) / 3};
      const double mm2 = 0.5 * static_cast<double>(orient2d(a, b, c)) / 65536;
      EXPECT_LE(mm2, graded.mm2_at(centroid) * (1 + 1e-12));
    }
    const double finer_rms = fit_hu_field(finer.mesh, hu, kGrid).rms_hu;
    EXPECT_LT(finer_rms, rms);
    EXPECT_GT(finer.mesh.triangles.size(), triangles);
    EXPECT_LE(in_left(finer.mesh), 3 * in_left(plain.mesh));
    EXPECT_LT(in_left(finer.mesh), 0.1 * static_cast<double>(finer.mesh.triangles.size()));
    rms = finer_rms, triangles = finer.mesh.triangles.size();
  }
  EXPECT_LT(rms, 0.25 * fit_hu_field(plain.mesh, hu, kGrid).rms_hu);
}

// A step thinner than the triangles that it crosses is not missed between their centroids.
TEST(GradedArea, FindsAThinLine) {
  const Image hu = field_of([](int x, int) { return x == 50 ? 1500 : 500; });
  const GradedArea graded(hu, kGrid, 100);
  const Refined finer = refined(&graded);
  EXPECT_LT(fit_hu_field(finer.mesh, hu, kGrid).rms_hu,
            0.7 * fit_hu_field(refined(nullptr).mesh, hu, kGrid).rms_hu);
}

// Noise without bounds: refinement ends, at a pixel for a triangle.
TEST(GradedArea, EndsOnNoise) {
  std::uint32_t state = 1;
  const Image hu = field_of([&](int, int) {
    state = state * 1664525U + 1013904223U;
    return static_cast<double>(state >> 16U) - 32768;
  });
  const GradedArea graded(hu, kGrid, 1e-6);
  const Refined finer = refined(&graded);
  EXPECT_EQ(finer.outcome, RefinementOutcome::kRefined);
  EXPECT_LT(finer.mesh.triangles.size(), 4 * 80 * 80);
  EXPECT_GT(finer.mesh.triangles.size(), 80 * 80);
}

// Turned by right angles, image and outline give the turned mesh.
TEST(GradedArea, TurnsWithTheImage) {
  const auto at = [](int x, int y) { return 4.0 * x * x - 3.0 * y + (x > 60 && y > 50 ? 900 : 0); };
  const Image hu = field_of(at),
              turned_hu = field_of([&](int x, int y) { return at(y, kFieldSide - 1 - x); });
  const GradedArea graded(hu, kGrid, 80), turned(turned_hu, kGrid, 80);
  const auto mesh_of = [](const Ring& ring, const GradedArea& area) {
    RefinementOptions options;
    options.area_mm2_at = [&area](LatticePoint p) { return area.mm2_at(p); };
    options.min_area_mm2 = area.min_mm2();
    return refine(*triangulate({{ring}}), kLattice, options).mesh;
  };
  const std::int32_t side = kLattice.snap_mm(40);
  const Ring ring{{700, 300}, {9800, 900}, {7000, 9000}, {1500, 8000}};
  Ring turned_ring;
  for (const LatticePoint p : ring)
    turned_ring.push_back({side - p.y, p.x});
  const SliceMesh mesh = mesh_of(ring, graded), mesh_turned = mesh_of(turned_ring, turned);
  ASSERT_EQ(mesh.vertices.size(), mesh_turned.vertices.size());
  EXPECT_EQ(mesh.triangles, mesh_turned.triangles);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v)
    EXPECT_EQ(mesh_turned.vertices[v],
              (LatticePoint{side - mesh.vertices[v].y, mesh.vertices[v].x}));
}

}  // namespace
}  // namespace trocar::pipeline
