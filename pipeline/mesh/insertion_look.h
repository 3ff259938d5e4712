// SPDX-License-Identifier: GPL-3.0-or-later
// What an insertion would change, before it is made: by the triangles between the rim of a cavity
// and the new point, four at a time.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>

#include "pipeline/mesh/refinement_mesh.h"
#include "pipeline/mesh/rim_view.h"
#include "pipeline/mesh/triangle_bounds.h"

namespace trocar::pipeline {

/// A new point, and the mesh with it.
struct Candidate {
  LatticePoint p;
  InsertionCavity cavity;
  int growth = 0;  ///< of the number of bad triangles and encroached edges, or kImpossible
  int flaws = 0;   ///< the number of these around the new point
};
inline constexpr int kImpossible = std::numeric_limits<int>::max();

class InsertionLook {
 public:
  /// Of a mesh that may grow, by these bounds; both are used as long as this is.
  InsertionLook(const RefinementMesh& mesh, const TriangleBounds& bounds)
      : mesh_(mesh), bounds_(bounds), anywhere_(bounds.anywhere()) {}

  /// What is found in all triangles between a rim and a point together.
  struct Tally {
    int flaws = 0;            ///< bad triangles, and encroached edges where an edge is split
    bool is_turned = false;   ///< the point is not on the left of an edge
    bool is_near = false;     ///< it is too near to a vertex
    bool is_blocked = false;  ///< it encroaches upon an edge of the outline
  };
  enum class Of { kFree, kSplit };
  /// The mesh with the candidate, whose cavity has been found: counts its flaws and its growth, and
  /// marks the edges of the rim (RimQuad::is_bad, is_blocked).
  template <Of kOf>
  [[gnu::always_inline]] Tally ahead(Candidate& candidate, double min_distance2) const {
    InsertionCavity& cavity = candidate.cavity;
    const Clearance clearance(min_distance2);
    Four flaws{}, is_turned{}, is_near{}, is_blocked{};
    const std::span<RimQuad> quads = cavity.quads();
    for (std::size_t k = 0; k < quads.size(); ++k) {
      RimQuad& r = quads[k];
      const FourPoints origin{};  // is the point
      const Look seen = look(cavity.is_in_reach(), r.a, r.b, origin, clearance, [&] {
        const InsertionCavity::Rim* const rim = cavity.rim_of_quad(k);
        FourTriangles out;
        for (std::size_t i = 0; i < 4; ++i)
          out[i] = {at(rim[i].a), at(rim[i].b), candidate.p};
        return out;
      });
      r.is_bad = seen.is_bad & r.is_edge;
      if (kOf == Of::kSplit) {
        const Four here = r.is_outline & r.is_edge & seen.is_obtuse_at_p,
                   before = r.is_before & seen.is_obtuse_at_a,
                   after = r.is_after & seen.is_obtuse_at_b;
        r.is_blocked = here | before | after;
        flaws += r.is_bad + here + before + after;
      } else {
        r.is_blocked = r.is_outline & r.is_edge & (seen.is_turned | seen.is_obtuse_at_p);
        flaws += r.is_bad;
      }
      is_blocked |= r.is_blocked;
      is_turned |= seen.is_turned;
      is_near |= seen.is_near;
    }
    const Tally out{count_of(flaws), is_any(is_turned), is_any(is_near), is_any(is_blocked)};
    candidate.flaws = out.flaws;
    candidate.growth = out.flaws - cavity.bad_triangles();
    return out;
  }

  /// Places close to each other have nearly the same cavity, so four are compared by the cavity of
  /// another. (All four, even if the first is good enough: that cannot be predicted.)
  using Places = std::array<LatticePoint, 4>;

  /// Of each place: the number of bad triangles, and of encroached edges where an edge is split, if
  /// it were inserted into this cavity; many if it cannot have this cavity.
  static constexpr std::int32_t kMany = 1 << 20;
  template <Of kOf>
  [[gnu::always_inline]] Four flaws_of(const Places& places, const InsertionCavity& cavity) const {
    const auto [p, is_in_reach] = from_origin_of(cavity, places);
    const Clearance clearance(0);
    Four flaws{}, is_turned{};
    const std::span<const RimQuad> quads = cavity.quads();
    for (std::size_t k = 0; k < cavity.rim().size(); ++k) {
      const RimQuad& r = quads[k / 4];
      const Look seen =
          look(is_in_reach, four_times(r.a, k % 4), four_times(r.b, k % 4), p, clearance, [&] {
            const InsertionCavity::Rim& edge = cavity.rim()[k];
            FourTriangles out;
            for (std::size_t i = 0; i < 4; ++i)
              out[i] = {at(edge.a), at(edge.b), places[i]};
            return out;
          });
      flaws += seen.is_bad;
      if (kOf == Of::kSplit)
        flaws += (four_of(r.is_outline[k % 4]) & seen.is_obtuse_at_p) +
                 (four_of(r.is_before[k % 4]) & seen.is_obtuse_at_a) +
                 (four_of(r.is_after[k % 4]) & seen.is_obtuse_at_b);
      is_turned |= seen.is_turned;
    }
    return -flaws | (is_turned & four_of(kMany));
  }
  /// Of the places that the mask allows, the first with the fewest.
  struct Fewest {
    std::int32_t flaws;
    std::size_t place;
  };
  static Fewest fewest_of(Four flaws, Four is_place) {
    const Four keys = 4 * (flaws | (~is_place & four_of(kMany))) + Four{0, 1, 2, 3};
    const std::int32_t key = std::min(std::min(keys[0], keys[1]), std::min(keys[2], keys[3]));
    return {key >> 2, static_cast<std::size_t>(key & 3)};
  }
  /// Which of the places are not too near to a vertex and do not encroach, as a mask.
  [[gnu::always_inline]] Four allowed_by(const InsertionCavity& cavity, const Places& places,
                                         double min_distance2) const {
    const auto [p, is_in_reach] = from_origin_of(cavity, places);
    if (!is_in_reach) [[unlikely]]
      return allowed_by_each(cavity, places, min_distance2);
    const Four clearance = four_of(Clearance(min_distance2).whole);
    Four is_excluded{};
    for (const RimQuad& r : cavity.quads()) {
      for (std::size_t k = 0; k < 4; ++k) {
        const FourPoints a = four_times(r.a, k) - p, b = four_times(r.b, k) - p;
        is_excluded |= (dots(a, a) < clearance) | (four_of(r.is_outline[k]) & (dots(a, b) < 0));
      }
    }
    return ~is_excluded;
  }
  /// Calls visit(k) for the edges of the rim for which the mask is set.
  template <typename Visit>
  [[gnu::always_inline]] static void for_each_edge(const InsertionCavity& cavity,
                                                   Four RimQuad::*mask, Visit visit) {
    const std::span<const RimQuad> quads = cavity.quads();
    for (std::size_t k = 0; k < quads.size(); ++k) {
      for (unsigned bits = bits_of(quads[k].*mask); bits != 0; bits &= bits - 1)
        visit(4 * k + static_cast<std::size_t>(std::countr_zero(bits)));
    }
  }

 private:
  LatticePoint at(std::uint32_t v) const { return mesh_.points[v]; }

  // What is found in four triangles between edges of a rim and points, as masks.
  struct Look {
    Four is_bad, is_turned, is_near, is_obtuse_at_p, is_obtuse_at_a, is_obtuse_at_b;
  };
  using FourTriangles = std::array<TriangleCorners, 4>;
  // In any case, but slow.
  [[gnu::noinline]] Look look_at_each(const FourTriangles& triangles, double min_distance2) const {
    Look out{};
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

  // The least distance from other vertices, squared.
  struct Clearance {
    explicit Clearance(double distance2)
        : exact(distance2), whole(static_cast<std::int32_t>(std::min(distance2, 0x1p30))) {
      whole += whole < distance2 ? 1 : 0;
    }
    double exact;
    std::int32_t whole;  // rounded up
  };
  // `triangles` gives the same four as `from`, `to` and `p`.
  template <typename Triangles>
  [[gnu::always_inline]] Look look(bool is_in_reach, FourPoints from, FourPoints to, FourPoints p,
                                   const Clearance& clearance, Triangles triangles) const {
    if (!is_in_reach) [[unlikely]]
      return look_at_each(triangles(), clearance.exact);
    const RimView v = rim_view(from, to, p);
    const Sharpness sharp = sharpness(v, anywhere_);
    if (is_any(sharp.is_unsure)) [[unlikely]]
      return look_at_each(triangles(), clearance.exact);
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

  struct FromOrigin {
    FourPoints p;
    bool is_in_reach;
  };
  [[gnu::always_inline]] static FromOrigin from_origin_of(const InsertionCavity& cavity,
                                                          const Places& p) {
    const LatticePoint o = cavity.origin;
    const FourPoints away = narrowed(from_origin(p[0], p[1], o), from_origin(p[2], p[3], o));
    return {away, cavity.is_in_reach() && !is_any(is_beyond_rim_reach(away))};
  }

  [[gnu::noinline]] Four allowed_by_each(const InsertionCavity& cavity, const Places& places,
                                         double min_distance2) const {
    Four out = four_of(-1);
    for (const InsertionCavity::Rim& r : cavity.rim()) {
      for (std::size_t k = 0; k < 4; ++k) {
        if (static_cast<double>(distance2(at(r.a), places[k])) < min_distance2 ||
            (r.is_outline() && diametral_dot(at(r.a), at(r.b), places[k]) < 0))
          out[k] = 0;
      }
    }
    return out;
  }

  const RefinementMesh& mesh_;
  const TriangleBounds& bounds_;
  RimLimits anywhere_;
};

}  // namespace trocar::pipeline
