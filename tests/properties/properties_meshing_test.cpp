// SPDX-License-Identifier: GPL-3.0-or-later
// Properties of contours, simplification, triangulation and refinement on random outlines and
// pictures: bounds, equivariance under motions of the lattice, independence of the input order.
#include <cmath>
#include <cstdio>
#include <map>
#include <numbers>
#include <set>

#include "formats/mesh/canonical_rotation.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/refinement.h"
#include "formats/mesh/refinement_outline.h"
#include "formats/mesh/triangulation.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/simplification.h"
#include "tests/cases/picture_checks.h"
#include "tests/properties/property_fixture.h"
#include "tests/properties/property_outlines.h"
#include "tests/support/random_geometry.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/test_lattice.h"

namespace trocar::pipeline {
namespace {

using test::any_outline;
using test::canonical;
using test::has_ties;
using test::Motion;

using trocar::test::kLattice;

double any_tolerance_mm() {
  return test::any_in(0, 40) / 20.0;
}

SimplificationOptions any_simplification() {
  return {any_tolerance_mm(),
          *rc::gen::element(SimplificationMethod::kArea, SimplificationMethod::kDouglasPeucker)};
}

// ---- simplification ----

double distance_to(double x, double y, const Ring& ring) {
  double best = 1e300;
  for (std::size_t i = 0; i < ring.size(); ++i)
    best = std::min(
        best, static_cast<double>(runtime::distance(x, y, ring[i], ring[(i + 1) % ring.size()])));
  return best;
}

// A lower bound of the Hausdorff distance from one ring to another, by 8 samples per edge.
double sampled_hausdorff(const Ring& from, const Ring& to) {
  double worst = 0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const LatticePoint a = from[i], b = from[(i + 1) % from.size()];
    for (int k = 0; k < 8; ++k) {
      const double t = k / 8.0;
      worst = std::max(worst, distance_to(a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), to));
    }
  }
  return worst;
}

// Winding numbers of all rings around each ring: their nesting.
std::vector<std::vector<int>> nesting(const Pslg& pslg) {
  std::vector<std::vector<int>> out;
  for (const Ring& q : pslg.rings) {
    out.emplace_back();
    // The middle of an edge lies on no other ring.
    const double x = (q[0].x + q[1].x) / 2.0, y = (q[0].y + q[1].y) / 2.0;
    for (const Ring& r : pslg.rings)
      out.back().push_back(&q == &r ? 0 : runtime::winding(x, y, {r}));
  }
  return out;
}

RC_GTEST_PROP(Simplification, KeepsToleranceValidityAndNesting, ()) {
  const Pslg full = any_outline();
  const SimplificationOptions options = any_simplification();
  const double tolerance_mm = options.tolerance_mm;
  const Pslg simple = simplify(full, kLattice, options);
  const auto valid = check_pslg(simple);
  RC_ASSERT(static_cast<bool>(valid));
  RC_ASSERT(simple.rings.size() == full.rings.size());
  const double reported_mm = hausdorff_mm(full, simple, kLattice);
  RC_ASSERT(reported_mm <= tolerance_mm * (1 + 1e-12));
  for (std::size_t r = 0; r < full.rings.size(); ++r) {
    const double sampled = std::max(sampled_hausdorff(full.rings[r], simple.rings[r]),
                                    sampled_hausdorff(simple.rings[r], full.rings[r]));
    RC_ASSERT(sampled * kLattice.step_mm() <= reported_mm + 1e-9);
  }
  RC_ASSERT(nesting(simple) == nesting(full));
}

// Without tolerance exactly the vertices on the line between their neighbours are removed, so
// simplification is idempotent. (With a tolerance it is not: the tolerance refers to the input.)
RC_GTEST_PROP(Simplification, WithoutToleranceIsIdempotent, ()) {
  const Pslg full = any_outline();
  const Pslg once = simplify(full, kLattice, {0});
  for (std::size_t r = 0; r < full.rings.size(); ++r)
    RC_ASSERT(doubled_area(once.rings[r]) == doubled_area(full.rings[r]));
  RC_ASSERT(canonical(simplify(once, kLattice, {0}).rings) == canonical(once.rings));
  RC_CLASSIFY(canonical(once.rings) != canonical(full.rings), "vertices were removed");
}

// The rings in a random order, each starting at a random vertex.
Pslg permuted(Pslg pslg) {
  for (Ring& ring : pslg.rings) {
    const auto by = test::any_in<std::size_t>(0, ring.size());
    std::rotate(ring.begin(), ring.begin() + static_cast<std::ptrdiff_t>(by), ring.end());
  }
  std::mt19937_64 random(test::any_seed());
  for (std::size_t i = pslg.rings.size(); i > 1; --i)
    std::swap(pslg.rings[i - 1], pslg.rings[random() % i]);
  return pslg;
}

RC_GTEST_PROP(Simplification, DoesNotDependOnTheInputOrder, ()) {
  const Pslg full = any_outline();
  const SimplificationOptions options = any_simplification();
  RC_ASSERT(canonical(simplify(permuted(full), kLattice, options).rings) ==
            canonical(simplify(full, kLattice, options).rings));
}

// ---- triangulation and refinement ----

RefinementOptions any_refinement() {
  RefinementOptions out;
  out.min_angle_deg = *rc::gen::element(20.0, 30.0, 33.0);
  out.max_area_mm2 = *rc::gen::element(1.0, 10.0, 1e9);
  out.max_vertices = 20'000;
  out.keep_area = *rc::gen::arbitrary<bool>();
  return out;
}

// If a rotation may map the outline to itself, no rule for ties or rounding is equivariant: the two
// diagonals of a square change places. Such outlines are translated only.
Motion any_motion_of(const Pslg& outline, bool has_choices) {
  CentroidOffset sum;
  for (const Ring& ring : outline.rings) {
    for (const LatticePoint p : ring)
      sum.add(p);
  }
  const bool is_symmetric = sum.x() == 0 && sum.y() == 0;
  RC_TAG(std::string(is_symmetric  ? "symmetric"
                     : has_choices ? "with choices"
                                   : "without choices"));
  return has_choices && is_symmetric ? test::any_translation() : test::any_motion();
}

// Douglas-Peucker has no ties to break and nothing to round.
RC_GTEST_PROP(Simplification, IsEquivariantUnderMotions, ()) {
  const Pslg full = any_outline();
  const SimplificationOptions options = any_simplification();
  const Motion m = any_motion_of(full, options.method == SimplificationMethod::kArea);
  RC_ASSERT(canonical(simplify(m(full), kLattice, options).rings) ==
            canonical(m(simplify(full, kLattice, options)).rings));
}

RC_GTEST_PROP(Triangulation, IsEquivariantUnderMotions, ()) {
  const Pslg outline = any_outline();
  const auto here = triangulate(outline);
  RC_ASSERT(static_cast<bool>(here));
  const Motion m = any_motion_of(outline, has_ties(here->mesh));
  RC_ASSERT(canonical(triangulate(m(outline))->mesh) == canonical(m(here->mesh)));
}

RC_GTEST_PROP(Triangulation, DoesNotDependOnTheInputOrder, ()) {
  const Pslg outline = any_outline();
  RC_ASSERT(canonical(triangulate(permuted(outline))->mesh) ==
            canonical(triangulate(outline)->mesh));
}

RC_GTEST_PROP(Refinement, IsEquivariantUnderMotions, ()) {
  const Pslg outline = any_outline();
  const auto here = triangulate(outline);
  const RefinementOptions options = any_refinement();
  const Motion m = any_motion_of(outline, true);
  RC_ASSERT(canonical(refine(*triangulate(m(outline)), kLattice, options).mesh) ==
            canonical(m(refine(*here, kLattice, options).mesh)));
}

RC_GTEST_PROP(Refinement, DoesNotDependOnTheInputOrder, ()) {
  const Pslg outline = any_outline();
  const RefinementOptions options = any_refinement();
  RC_ASSERT(canonical(refine(*triangulate(permuted(outline)), kLattice, options).mesh) ==
            canonical(refine(*triangulate(outline), kLattice, options).mesh));
}

// The checks of formats/mesh/mesh_validity.h, and the number of triangles by Euler.
RC_GTEST_PROP(Triangulation, GivesAValidMesh, ()) {
  const Pslg outline = any_outline();
  const auto cdt = triangulate(outline);
  RC_ASSERT(static_cast<bool>(cdt));
  const auto valid = check_mesh_against_pslg(cdt->mesh, outline);
  RC_ASSERT(static_cast<bool>(valid));
  RC_ASSERT(is_constrained_delaunay(cdt->mesh));
  std::int64_t corners = 0, outer = 0, holes = 0;
  for (const Ring& ring : outline.rings) {
    corners += static_cast<std::int64_t>(ring.size());
    ++(doubled_area(ring) > 0 ? outer : holes);
  }
  std::set<LatticePoint> points;
  for (const Ring& ring : outline.rings)
    points.insert(ring.begin(), ring.end());
  RC_TAG(std::string(static_cast<std::int64_t>(points.size()) == corners ? "apart" : "touching"));
  if (static_cast<std::int64_t>(points.size()) == corners)
    RC_ASSERT(static_cast<std::int64_t>(cdt->mesh.triangles.size()) ==
              corners + 2 * holes - 2 * outer);
}

std::multiset<std::pair<LatticePoint, LatticePoint>> edges_of(const Pslg& pslg) {
  std::multiset<std::pair<LatticePoint, LatticePoint>> out;
  for (const Ring& ring : pslg.rings) {
    for (std::size_t i = 0; i < ring.size(); ++i)
      out.emplace(ring[i], ring[(i + 1) % ring.size()]);
  }
  return out;
}

RC_GTEST_PROP(Refinement, GivesAValidMesh, ()) {
  const Pslg outline = any_outline();
  const RefinementOptions options = any_refinement();
  const Refined refined = refine(*triangulate(outline), kLattice, options);
  const auto valid = check_mesh_against_pslg(refined.mesh, boundary_rings(refined.mesh));
  RC_ASSERT(static_cast<bool>(valid));
  RC_ASSERT(is_constrained_delaunay(refined.mesh));
  // The outline's vertices are kept, and the boundary moves by less than three steps: only to the
  // material's side, unless the area is kept.
  const std::set<LatticePoint> points(refined.mesh.vertices.begin(), refined.mesh.vertices.end());
  for (const Ring& ring : outline.rings) {
    for (const LatticePoint p : ring)
      RC_ASSERT(points.contains(p));
  }
  const Pslg boundary = boundary_rings(refined.mesh);
  if (!options.keep_area) RC_ASSERT(doubled_area(boundary) <= doubled_area(outline));
  const Pslg rings = refined_rings(refined, outline);
  RC_ASSERT(doubled_area(rings) == doubled_area(boundary));
  RC_ASSERT(rings.rings.size() == outline.rings.size());
  // Rings that meet in pinches may be joined in another way in `boundary`.
  RC_ASSERT(edges_of(rings) == edges_of(boundary));
  for (const Ring& ring : boundary.rings) {
    for (const LatticePoint p : ring)
      RC_ASSERT(runtime::nearest_edge(p.x, p.y, outline.rings) < 3);
  }
  if (refined.outcome != RefinementOutcome::kRefined) return;
  const double steps2 = std::ldexp(options.max_area_mm2, 2 * kLattice.bits + 1);
  for (const Triangle& t : refined.mesh.triangles) {
    const auto& at = refined.mesh.vertices;
    RC_ASSERT(static_cast<double>(orient2d(at[t[0]], at[t[1]], at[t[2]])) <= steps2);
  }
}

// ---- contours: pixels inside; pictures moved by whole pixels or rotated ----

// Noise, as grey values or as a mask.
Field any_field(int size) {
  Field field =
      noise_field(size, test::any_in(0, 6), test::any_seed(), *rc::gen::arbitrary<bool>());
  if (*rc::gen::arbitrary<bool>()) return field;
  for (float& v : field.image.values)
    v = v >= field.iso ? 1 : 0;
  field.iso = 0.5;
  field.is_mask = true;
  return field;
}

RC_GTEST_PROP(Contours, HaveThePixelsOfMaterialInside, ()) {
  const Field field = any_field(test::any_in(2, 32));
  const ContourKind kind = *rc::gen::element(ContourKind::kSubpixel, ContourKind::kPixel);
  const PixelGrid grid{0.5, 0.25, test::any_in(-50, 50), test::any_in(-50, 50), kLattice};
  const Pslg outline = contours(field, grid, kind);
  const auto valid = check_pslg(outline);
  RC_ASSERT(static_cast<bool>(valid));
  test::PixelTruth truth{field.image.width, field.image.height, {}, 128, 64,
                         grid.offset_x,     grid.offset_y};
  truth.as_chains = kind == ContourKind::kPixel;
  truth.half_way = field.is_mask;
  for (const float v : field.image.values)
    truth.material.push_back(v >= field.iso);
  RC_ASSERT(test::wrong_pixel(truth, outline) == "");
  const auto area = test::exact_doubled_area(truth);
  if (area) RC_ASSERT(doubled_area(outline) == *area);
}

// In a cell with two diagonally opposite material corners these are joined if and only if the
// bilinear interpolant has material at its saddle.
RC_GTEST_PROP(Contours, JoinAcrossASaddleLikeTheInterpolant, ()) {
  // a . / . b, surrounded by void.
  const auto inside = [] { return static_cast<float>(test::any_in(1, 100)); };
  const auto outside = [] { return static_cast<float>(-test::any_in(1, 100)); };
  const double a = inside(), b = inside(), c = outside(), d = outside();
  Field field{{4, 4, std::vector<float>(16, -100)}, 0};
  const bool mirrored = *rc::gen::arbitrary<bool>();
  const auto at = [&](int x, int y) -> float& {
    const int place = 4 * y + (mirrored ? 3 - x : x);
    return field.image.values[static_cast<std::size_t>(place)];
  };
  at(1, 1) = static_cast<float>(a), at(2, 2) = static_cast<float>(b);
  at(2, 1) = static_cast<float>(c), at(1, 2) = static_cast<float>(d);
  // f(u, v) = a + (c - a) u + (d - a) v + (a + b - c - d) u v; both derivatives vanish in (u, v).
  const double twist = a + b - c - d, u = (a - d) / twist, v = (a - c) / twist;
  const double saddle = a + (c - a) * u + (d - a) * v + twist * u * v;
  RC_PRE(std::abs(saddle) > 1e-9);
  const Pslg outline = contours(field, {1, 1, 0, 0, kLattice}, ContourKind::kSubpixel);
  RC_ASSERT(outline.rings.size() == (saddle > 0 ? 1U : 2U));
}

RC_GTEST_PROP(Contours, AreEquivariantUnderTranslations, ()) {
  const int size = test::any_in(8, 32);
  const Field field = noise_field(size, test::any_in(1, 6), test::any_seed());
  const ContourKind kind = *rc::gen::element(ContourKind::kSubpixel, ContourKind::kPixel);
  const int x = test::any_in(-500, 500), y = test::any_in(-500, 500);
  const PixelGrid here{0.5, 0.25, 0, 0, kLattice}, there{0.5, 0.25, x, y, kLattice};
  const Motion by{0, {x * 128, y * 64}};
  RC_ASSERT(canonical(contours(field, there, kind).rings) ==
            canonical(by(contours(field, here, kind)).rings));
}

// (x, y) -> (height - 1 - y, x)
Field rotated(const Field& field) {
  const int width = field.image.height, height = field.image.width;
  Field out{{width, height, field.image.values}, field.iso, field.is_mask};
  for (int y = 0; y < field.image.height; ++y) {
    for (int x = 0; x < field.image.width; ++x)
      out.image.values[static_cast<std::size_t>(x) * width + (width - 1 - y)] =
          field.image.at(x, y);
  }
  return out;
}

// Pixels and pictures are not square.
RC_GTEST_PROP(Contours, AreEquivariantUnderAQuarterTurn, ()) {
  const int size = test::any_in(8, 32);
  Field field = any_field(size);
  field.image.height = test::any_in(1, size + 1);
  field.image.values.resize(static_cast<std::size_t>(size) * field.image.height);
  const ContourKind kind = *rc::gen::element(ContourKind::kSubpixel, ContourKind::kPixel);
  const double u_mm = *rc::gen::element(0.0625, 0.25, 0.5), v_mm = *rc::gen::element(0.25, 0.5);
  const Motion quarter{1, {(field.image.height - 1) * kLattice.snap_mm(v_mm), 0}};
  RC_ASSERT(canonical(contours(rotated(field), {v_mm, u_mm, 0, 0, kLattice}, kind).rings) ==
            canonical(quarter(contours(field, {u_mm, v_mm, 0, 0, kLattice}, kind)).rings));
}

}  // namespace
}  // namespace trocar::pipeline
