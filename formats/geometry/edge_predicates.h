// SPDX-License-Identifier: Apache-2.0
// Exact predicates on the edges of a mesh: where a point lies with respect to an edge ab, and
// whether an edge is Delaunay.
#pragma once

#include "formats/geometry/lattice.h"

namespace trocar {

/// Returns true if p lies in the interior of the segment ab.
inline bool is_inside_segment(LatticePoint a, LatticePoint b, LatticePoint p) noexcept {
  return orient2d(a, b, p) == 0 && diametral_dot(a, b, p) < 0;
}

/// Returns true if p lies on the segment ab, its ends included.
inline bool is_on_segment(LatticePoint a, LatticePoint b, LatticePoint p) noexcept {
  return orient2d(a, b, p) == 0 && diametral_dot(a, b, p) <= 0;
}

/// Returns true if p encroaches upon the edge ab, which means that p lies strictly inside the
/// circle whose diameter is ab. In a triangle abp this means that the angle opposite ab is
/// above 90 degrees.
inline bool encroaches(LatticePoint a, LatticePoint b, LatticePoint p) noexcept {
  return diametral_dot(a, b, p) < 0;
}

/// Returns true if the boundary edge ab, with the material on its left, forbids a new vertex p. The
/// edge forbids p if p encroaches upon ab, or if p does not lie strictly on the left of ab.
inline bool blocks(LatticePoint a, LatticePoint b, LatticePoint p) noexcept {
  return diametral_dot(a, b, p) < 0 || orient2d(a, b, p) <= 0;
}

/// Returns true if the edge ab of the counter-clockwise triangle abc may be split at m. This is the
/// case if m lies on ab or on the inner side of ab, and strictly on the inner side of the other two
/// edges. Such a split never moves the boundary outwards, so the boundary cannot cross itself at m.
inline bool may_split(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint m) noexcept {
  return (orient2d(a, b, m) >= 0) & (orient2d(b, c, m) > 0) & (orient2d(c, a, m) > 0);
}

/// Returns true if the edge bc between the triangles abc and dcb is locally Delaunay. This is the
/// case if the sum of the two angles opposite bc is at most 180 degrees, which means that the sine
/// of the sum is at least 0. The function computes this sine times the lengths of the other four
/// edges. The product equals the determinant in in_circle() with the opposite sign, and takes fewer
/// multiplications. The code has no branches, because a processor cannot predict the result.
inline bool is_locally_delaunay(LatticePoint a, LatticePoint b, LatticePoint c,
                                LatticePoint d) noexcept {
  return Int128{orient2d(a, b, c)} * diametral_dot(b, c, d) +
             Int128{orient2d(d, c, b)} * diametral_dot(b, c, a) >=
         0;
}

}  // namespace trocar
