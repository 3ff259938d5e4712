// SPDX-License-Identifier: GPL-3.0-or-later
// Evaluates what the insertion of a vertex would change, without inserting it. The insertion would
// replace the triangles of a cavity by new triangles between the cavity's boundary and the point.
// This header evaluates the new triangles, four at a time.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>

#include "pipeline/triangulation/cavity_boundary.h"
#include "pipeline/triangulation/refinement_mesh.h"
#include "pipeline/triangulation/triangle_bounds.h"

namespace trocar::pipeline {

/// A point that may be inserted, and the effect of its insertion.
struct Candidate {
  LatticePoint p;
  InsertionCavity cavity;
  /// `flaws` minus the number of bad triangles that the insertion removes. kImpossible: the point
  /// cannot be inserted.
  int growth = 0;
  /// Number of bad triangles that the insertion creates. If the point splits an edge, the number
  /// includes the edges that are encroached upon after the split.
  int flaws = 0;
};
/// A value of Candidate::growth: the point cannot be inserted.
inline constexpr int kImpossible = std::numeric_limits<int>::max();

/// Evaluates insertions of points.
class InsertionTrial {
 public:
  /// Evaluates insertions into `mesh` by the limits in `bounds`. The mesh may grow between two
  /// evaluations. Both objects must outlive this object.
  InsertionTrial(const RefinementMesh& mesh, const TriangleBounds& bounds)
      : mesh_(mesh), bounds_(bounds), anywhere_(bounds.anywhere()) {}

  /// Results for all triangles between a cavity's boundary and a point.
  struct Tally {
    int flaws = 0;            ///< see Candidate::flaws
    bool is_turned = false;   ///< the point lies on or beyond an edge of the boundary: not allowed
    bool is_near = false;     ///< the point is too near to a vertex of the boundary
    bool is_blocked = false;  ///< an edge is blocked (BoundaryQuad::is_blocked)
  };
  enum class PointKind {
    kFree,   ///< a point in the material
    kSplit,  ///< a point that splits an edge of the outline
  };
  /// Evaluates the insertion of the candidate. Precondition: the candidate's cavity has been
  /// found. `min_distance2` is the square of the smallest distance that is allowed between the
  /// point and other vertices. Sets the candidate's flaws and growth, and marks edges of the
  /// boundary (BoundaryQuad::is_bad, is_blocked).
  template <PointKind kKind>
  [[gnu::always_inline]] Tally evaluate(Candidate& candidate, double min_distance2) const {
    InsertionCavity& cavity = candidate.cavity;
    const Clearance clearance(min_distance2);
    Four flaws{}, is_turned{}, is_near{}, is_blocked{};
    const std::span<BoundaryQuad> quads = cavity.quads();
    for (std::size_t k = 0; k < quads.size(); ++k) {
      BoundaryQuad& r = quads[k];
      const FourPoints origin{};  // coordinates are relative to the point
      const FourResults result =
          evaluate_four(cavity.is_near_origin(), r.a, r.b, origin, clearance, [&] {
            const InsertionCavity::BoundaryEdge* const boundary = cavity.edges_of_quad(k);
            FourTriangles out;
            for (std::size_t i = 0; i < 4; ++i)
              out[i] = {at(boundary[i].a), at(boundary[i].b), candidate.p};
            return out;
          });
      r.is_bad = result.is_bad & r.is_edge;
      if (kKind == PointKind::kSplit) {
        const Four here = r.is_outline & r.is_edge & result.is_obtuse_at_p,
                   before = r.is_before & result.is_obtuse_at_a,
                   after = r.is_after & result.is_obtuse_at_b;
        r.is_blocked = here | before | after;
        flaws += r.is_bad + here + before + after;
      } else {
        r.is_blocked = r.is_outline & r.is_edge & (result.is_turned | result.is_obtuse_at_p);
        flaws += r.is_bad;
      }
      is_blocked |= r.is_blocked;
      is_turned |= result.is_turned;
      is_near |= result.is_near;
    }
    const Tally out{count_of(flaws), is_any(is_turned), is_any(is_near), is_any(is_blocked)};
    candidate.flaws = out.flaws;
    candidate.growth = out.flaws - cavity.bad_triangles();
    return out;
  }

  /// Four alternative positions for one new point. They are evaluated with the cavity of another
  /// position nearby, because positions close to each other have nearly the same cavity. (All four
  /// are evaluated even if the first is good enough, because a processor could not predict a branch
  /// on this condition.)
  using Positions = std::array<LatticePoint, 4>;

  /// flaws_of() returns at least this number for a position that is not allowed.
  static constexpr std::int32_t kManyFlaws = 1 << 20;
  /// Returns the number of flaws (Candidate::flaws) that a point at each position would have if it
  /// replaced this cavity. For positions that are not allowed, the number is at least kManyFlaws. A
  /// position is not allowed if it lies on or beyond an edge of the boundary, or is too near to a
  /// vertex. For a point in the material, a position that encroaches upon the outline is not
  /// allowed either.
  template <PointKind kKind>
  [[gnu::always_inline]] Four flaws_of(const Positions& positions, const InsertionCavity& cavity,
                                       double min_distance2) const {
    const LatticePoint o = cavity.origin;
    const FourPoints p = narrowed(from_origin(positions[0], positions[1], o),
                                  from_origin(positions[2], positions[3], o));
    const bool is_near_origin = cavity.is_near_origin() && !is_any(is_beyond_max_offset(p));
    const Clearance clearance(min_distance2);
    Four flaws{}, is_excluded{};
    const std::span<const BoundaryQuad> quads = cavity.quads();
    for (std::size_t k = 0; k < cavity.boundary().size(); ++k) {
      const BoundaryQuad& r = quads[k / 4];
      const FourResults result = evaluate_four(
          is_near_origin, four_times(r.a, k % 4), four_times(r.b, k % 4), p, clearance, [&] {
            const InsertionCavity::BoundaryEdge& edge = cavity.boundary()[k];
            FourTriangles out;
            for (std::size_t i = 0; i < 4; ++i)
              out[i] = {at(edge.a), at(edge.b), positions[i]};
            return out;
          });
      flaws += result.is_bad;
      is_excluded |= result.is_turned | result.is_near;
      if (kKind == PointKind::kSplit) {
        flaws += (four_of(r.is_outline[k % 4]) & result.is_obtuse_at_p) +
                 (four_of(r.is_before[k % 4]) & result.is_obtuse_at_a) +
                 (four_of(r.is_after[k % 4]) & result.is_obtuse_at_b);
      } else {
        is_excluded |= four_of(r.is_outline[k % 4]) & result.is_obtuse_at_p;
      }
    }
    return -flaws | (is_excluded & four_of(kManyFlaws));
  }
  /// The result of fewest_of(): among the positions that `is_allowed_position` marks, the one with
  /// the fewest flaws. If several have equally few flaws, it is the first of them.
  struct Fewest {
    std::int32_t flaws;
    std::size_t position;
  };
  static Fewest fewest_of(Four flaws, Four is_allowed_position) {
    const Four keys = 4 * (flaws | (~is_allowed_position & four_of(kManyFlaws))) + Four{0, 1, 2, 3};
    const std::int32_t key = std::min(std::min(keys[0], keys[1]), std::min(keys[2], keys[3]));
    return {key >> 2, static_cast<std::size_t>(key & 3)};
  }
  /// Calls visit(k) for each edge k of the boundary that `mask` marks. `mask` is a member of
  /// BoundaryQuad, for example is_bad.
  template <typename Visit>
  [[gnu::always_inline]] static void for_each_edge(const InsertionCavity& cavity,
                                                   Four BoundaryQuad::*mask, Visit visit) {
    const std::span<const BoundaryQuad> quads = cavity.quads();
    for (std::size_t k = 0; k < quads.size(); ++k) {
      for (unsigned bits = bits_of(quads[k].*mask); bits != 0; bits &= bits - 1)
        visit(4 * k + static_cast<std::size_t>(std::countr_zero(bits)));
    }
  }

 private:
  LatticePoint at(std::uint32_t v) const { return mesh_.points[v]; }

  // Results for four triangles between edges of the boundary and points, as masks.
  struct FourResults {
    Four is_bad, is_turned, is_near, is_obtuse_at_p, is_obtuse_at_a, is_obtuse_at_b;
  };
  using FourTriangles = std::array<TriangleCorners, 4>;
  // Evaluates triangles one by one. This is slow, but sets no limit on the coordinates.
  [[gnu::noinline]] FourResults evaluate_each(const FourTriangles& triangles,
                                              double min_distance2) const {
    FourResults out{};
    for (std::size_t k = 0; k < 4; ++k) {
      const auto [a, b, p] = triangles[k];
      const TriangleShape shape = bounds_.shape(a, b, p);
      const auto mask = [](bool is) { return is ? -1 : 0; };
      out.is_bad[k] = mask(shape.is_bad());
      out.is_turned[k] = mask(shape.doubled_area <= 0);
      out.is_near[k] = mask(static_cast<double>(distance2(a, p)) < min_distance2);
      out.is_obtuse_at_p[k] = mask(diametral_dot(a, b, p) < 0);
      out.is_obtuse_at_a[k] = mask(diametral_dot(b, p, a) < 0);
      out.is_obtuse_at_b[k] = mask(diametral_dot(p, a, b) < 0);
    }
    return out;
  }
  [[gnu::noinline]] Four is_each_large(const FourTriangles& triangles) const {
    Four out{};
    for (std::size_t k = 0; k < 4; ++k)
      out[k] = bounds_.shape(triangles[k][0], triangles[k][1], triangles[k][2]).is_large ? -1 : 0;
    return out;
  }

  // The square of the least allowed distance from other vertices.
  struct Clearance {
    explicit Clearance(double distance2)
        : exact(distance2), whole(static_cast<std::int32_t>(std::min(distance2, 0x1p30))) {
      whole += whole < distance2 ? 1 : 0;
    }
    double exact;
    std::int32_t whole;  // `exact`, rounded up
  };
  // Evaluates the four triangles from[k], to[k], p[k]. `triangles` returns the same four triangles
  // with full coordinates. It is called only if 16-bit coordinates or floats do not suffice, or if
  // the bound on the area depends on the position and may be violated.
  template <typename Triangles>
  [[gnu::always_inline]] FourResults evaluate_four(bool is_near_origin, FourPoints from,
                                                   FourPoints to, FourPoints p,
                                                   const Clearance& clearance,
                                                   Triangles triangles) const {
    if (!is_near_origin) [[unlikely]]
      return evaluate_each(triangles(), clearance.exact);
    const BoundaryTriangles v = boundary_triangles(from, to, p);
    const Sharpness sharp = sharpness(v, anywhere_);
    if (is_any(sharp.is_unsure)) [[unlikely]]
      return evaluate_each(triangles(), clearance.exact);
    Four is_large = v.doubled_area > anywhere_.doubled_area;
    if (bounds_.has_area_at() && is_any(is_large)) [[unlikely]]
      is_large = is_each_large(triangles());
    return {sharp.is_sharp | is_large,
            v.doubled_area <= 0,
            v.pa2 < four_of(clearance.whole),
            v.at_p < 0,
            v.at_a < 0,
            v.at_b < 0};
  }

  const RefinementMesh& mesh_;
  const TriangleBounds& bounds_;
  QuickShapeLimits anywhere_;
};

}  // namespace trocar::pipeline
