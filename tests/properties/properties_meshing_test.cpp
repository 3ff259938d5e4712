// SPDX-License-Identifier: GPL-3.0-or-later
// Properties of the outline's and the mesh's stages on random outlines and pictures: bounds of
// simplification, motions of the lattice, and the order in which things were given.
#include <cmath>
#include <cstdio>
#include <map>
#include <numbers>
#include <set>

#include "formats/geometry/mesh_validity.h"
#include "pipeline/contour/contour.h"
#include "formats/geometry/canonical_rotation.h"
#include "pipeline/mesh/refinement.h"
#include "pipeline/contour/simplification.h"
#include "pipeline/mesh/triangulation.h"
#include "tests/cases/picture_checks.h"
#include "tests/properties/property_fixture.h"
#include "tests/properties/property_outlines.h"
#include "tests/support/random_geometry.h"
#include "tests/support/synthetic_fields.h"

namespace trocar::pipeline {
namespace {

using test::any_outline;
using test::canonical;
using test::has_ties;
using test::Motion;

constexpr Lattice kLattice{8};

struct Shape {
  bool is_needle = false, has_near_points = false;
};
Shape shape_of(const Pslg& pslg) {
  Shape out;
  std::set<LatticePoint> points;
  for (const Ring& ring : pslg.rings) {
    points.insert(ring.begin(), ring.end());
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const LatticePoint a = ring[i], b = ring[(i + 1) % ring.size()],
                         c = ring[(i + 2) % ring.size()];
      const double angle = std::atan2(static_cast<double>(orient2d(a, b, c)),
                                      static_cast<double>(diametral_dot(a, c, b)));
      out.is_needle = out.is_needle || (angle > 0 && angle < std::numbers::pi / 180);
    }
  }
  for (const LatticePoint p : points) {
    for (const LatticePoint d : {LatticePoint{1, 0}, {0, 1}, {1, 1}, {1, -1}})
      out.has_near_points = out.has_near_points || points.contains({p.x + d.x, p.y + d.y});
  }
  return out;
}

// Of four hundred outlines each kind is some, and what is degenerate is there by measure too.
TEST(AnyOutline, IsDegenerateInEveryWayOftenEnough) {
  int needles = 0, near = 0, tied = 0, drawn = 0;
  const auto outlines = rc::gen::resize(rc::kNominalSize, rc::gen::exec(any_outline));
  for (std::uint64_t seed = 0; seed < 400; ++seed, ++drawn) {
    const Pslg pslg = outlines(rc::Random(seed), rc::kNominalSize).value();
    const Shape shape = shape_of(pslg);
    needles += shape.is_needle ? 1 : 0;
    near += shape.has_near_points ? 1 : 0;
    tied += has_ties(triangulate(pslg)->mesh) ? 1 : 0;
  }
  std::printf(
      "  of %d: %d with an angle below 1 degree, %d with corners a step apart, %d with four "
      "corners on one circle\n",
      drawn, needles, near, tied);
  EXPECT_GE(needles, drawn / 10);
  EXPECT_GE(near, drawn / 10);
  EXPECT_GE(tied, drawn / 10);
}

double any_tolerance_mm() {
  return test::any_in(0, 40) / 20.0;
}

// ---- simplification ----

double distance_to(double x, double y, const Ring& ring) {
  double best = 1e300;
  for (std::size_t i = 0; i < ring.size(); ++i)
    best = std::min(
        best, static_cast<double>(runtime::distance(x, y, ring[i], ring[(i + 1) % ring.size()])));
  return best;
}

// The largest distance of a ring's points from another, sampled a few times an edge: from below.
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

// How often the other rings wind around each: what is inside what.
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

RC_GTEST_PROP(Simplification, KeepsBoundsCrossingsAndNesting, ()) {
  const Pslg full = any_outline();
  const double tolerance_mm = any_tolerance_mm();
  const Pslg simple = simplify(full, kLattice, {tolerance_mm});
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

// Only what lies on the line between its neighbours goes, and all of that at once. (With a
// tolerance a second time may take more: it is counted from the ring that is given.)
RC_GTEST_PROP(Simplification, WithoutToleranceOnceIsEnough, ()) {
  const Pslg full = any_outline();
  const Pslg once = simplify(full, kLattice, {0});
  for (std::size_t r = 0; r < full.rings.size(); ++r)
    RC_ASSERT(doubled_area(once.rings[r]) == doubled_area(full.rings[r]));
  RC_ASSERT(canonical(simplify(once, kLattice, {0}).rings) == canonical(once.rings));
  RC_CLASSIFY(canonical(once.rings) != canonical(full.rings), "something went");
}

RC_GTEST_PROP(Simplification, MovesWithItsOutline, ()) {
  const Pslg full = any_outline();
  const double tolerance_mm = any_tolerance_mm();
  const Motion m = *rc::gen::arbitrary<bool>() ? test::any_translation() : test::any_motion();
  RC_ASSERT(canonical(simplify(m(full), kLattice, {tolerance_mm}).rings) ==
            canonical(m(simplify(full, kLattice, {tolerance_mm})).rings));
}

// Rings in another order, each from another vertex.
Pslg given_otherwise(Pslg pslg) {
  for (Ring& ring : pslg.rings) {
    const auto by = test::any_in<std::size_t>(0, ring.size());
    std::rotate(ring.begin(), ring.begin() + static_cast<std::ptrdiff_t>(by), ring.end());
  }
  std::mt19937_64 random(test::any_seed());
  for (std::size_t i = pslg.rings.size(); i > 1; --i)
    std::swap(pslg.rings[i - 1], pslg.rings[random() % i]);
  return pslg;
}

RC_GTEST_PROP(Simplification, DoesNotDependOnTheOrder, ()) {
  const Pslg full = any_outline();
  const double tolerance_mm = any_tolerance_mm();
  RC_ASSERT(canonical(simplify(given_otherwise(full), kLattice, {tolerance_mm}).rings) ==
            canonical(simplify(full, kLattice, {tolerance_mm}).rings));
}

// ---- triangulation and refinement ----

RefinementOptions any_refinement() {
  RefinementOptions out;
  out.min_angle_deg = *rc::gen::element(20.0, 30.0, 33.0);
  out.max_area_mm2 = *rc::gen::element(1.0, 10.0, 1e9);
  out.max_vertices = 20'000;
  return out;
}

// Where ties must be broken or points be rounded, no rule can be the same after a turn that brings
// the outline onto itself: a square's diagonals change places. Those are moved only.
Motion any_motion_of(const Pslg& outline, bool has_choices) {
  CentroidOffset sum;
  for (const Ring& ring : outline.rings) {
    for (const LatticePoint p : ring)
      sum.add(p);
  }
  const bool is_even = sum.x() == 0 && sum.y() == 0;
  RC_TAG(std::string(is_even ? "even" : has_choices ? "with choices" : "without choices"));
  return has_choices && is_even ? test::any_translation() : test::any_motion();
}

RC_GTEST_PROP(Triangulation, MovesWithItsOutline, ()) {
  const Pslg outline = any_outline();
  const auto here = triangulate(outline);
  RC_ASSERT(static_cast<bool>(here));
  const Motion m = any_motion_of(outline, has_ties(here->mesh));
  RC_ASSERT(canonical(triangulate(m(outline))->mesh) == canonical(m(here->mesh)));
}

RC_GTEST_PROP(Triangulation, DoesNotDependOnTheOrder, ()) {
  const Pslg outline = any_outline();
  RC_ASSERT(canonical(triangulate(given_otherwise(outline))->mesh) ==
            canonical(triangulate(outline)->mesh));
}

RC_GTEST_PROP(Refinement, MovesWithItsOutline, ()) {
  const Pslg outline = any_outline();
  const auto here = triangulate(outline);
  const RefinementOptions options = any_refinement();
  const Motion m = any_motion_of(outline, true);
  RC_ASSERT(canonical(refine(*triangulate(m(outline)), kLattice, options).mesh) ==
            canonical(m(refine(*here, kLattice, options).mesh)));
}

RC_GTEST_PROP(Refinement, DoesNotDependOnTheOrder, ()) {
  const Pslg outline = any_outline();
  const RefinementOptions options = any_refinement();
  RC_ASSERT(canonical(refine(*triangulate(given_otherwise(outline)), kLattice, options).mesh) ==
            canonical(refine(*triangulate(outline), kLattice, options).mesh));
}

// Every proof of the lattice (formats/geometry/mesh_validity.h), and the size that Euler gives.
RC_GTEST_PROP(Triangulation, KeepsTheInvariantsOfTheLattice, ()) {
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

RC_GTEST_PROP(Refinement, KeepsTheInvariantsOfTheLattice, ()) {
  const Pslg outline = any_outline();
  const RefinementOptions options = any_refinement();
  const Refined refined = refine(*triangulate(outline), kLattice, options);
  const auto valid = check_mesh_against_pslg(refined.mesh, boundary_rings(refined.mesh));
  RC_ASSERT(static_cast<bool>(valid));
  RC_ASSERT(is_constrained_delaunay(refined.mesh));
  // The outline's vertices stay, and its boundary recedes by less than three steps.
  const std::set<LatticePoint> points(refined.mesh.vertices.begin(), refined.mesh.vertices.end());
  for (const Ring& ring : outline.rings) {
    for (const LatticePoint p : ring)
      RC_ASSERT(points.contains(p));
  }
  const Pslg boundary = boundary_rings(refined.mesh);
  RC_ASSERT(doubled_area(boundary) <= doubled_area(outline));
  for (const Ring& ring : boundary.rings) {
    for (const LatticePoint p : ring)
      RC_ASSERT(runtime::nearest_edge(p.x, p.y, outline.rings) < 3);
  }
  if (refined.outcome != RefinementOutcome::kRefined) return;
  const double steps2 = 2 * options.max_area_mm2 / (kLattice.step_mm() * kLattice.step_mm());
  for (const Triangle& t : refined.mesh.triangles) {
    const auto& at = refined.mesh.vertices;
    RC_ASSERT(static_cast<double>(orient2d(at[t[0]], at[t[1]], at[t[2]])) <= steps2);
  }
}

// ---- contours: what is inside; a picture moved by whole pixels, or turned ----

// Any noise, as grey values or as a mask.
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

RC_GTEST_PROP(Contours, HaveTheirPixelsInside, ()) {
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

// In a cell with two material corners across from each other, whether they are joined is whether
// the bilinear interpolant has material in its saddle.
RC_GTEST_PROP(Contours, JoinAcrossASaddleAsTheInterpolantDoes, ()) {
  // a . / . b, with so much void around that all else is known.
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

RC_GTEST_PROP(Contours, MoveWithTheirPicture, ()) {
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
Field turned(const Field& field) {
  const int width = field.image.height, height = field.image.width;
  Field out{{width, height, field.image.values}, field.iso, field.is_mask};
  for (int y = 0; y < field.image.height; ++y) {
    for (int x = 0; x < field.image.width; ++x)
      out.image.values[static_cast<std::size_t>(x) * width + (width - 1 - y)] =
          field.image.at(x, y);
  }
  return out;
}

// Pixels that are no squares, in pictures that are none.
RC_GTEST_PROP(Contours, TurnWithTheirPicture, ()) {
  const int size = test::any_in(8, 32);
  Field field = any_field(size);
  field.image.height = test::any_in(1, size + 1);
  field.image.values.resize(static_cast<std::size_t>(size) * field.image.height);
  const ContourKind kind = *rc::gen::element(ContourKind::kSubpixel, ContourKind::kPixel);
  const double u_mm = *rc::gen::element(0.0625, 0.25, 0.5), v_mm = *rc::gen::element(0.25, 0.5);
  const Motion quarter{1, {(field.image.height - 1) * kLattice.snap_mm(v_mm), 0}};
  RC_ASSERT(canonical(contours(turned(field), {v_mm, u_mm, 0, 0, kLattice}, kind).rings) ==
            canonical(quarter(contours(field, {u_mm, v_mm, 0, 0, kLattice}, kind)).rings));
}

}  // namespace
}  // namespace trocar::pipeline
