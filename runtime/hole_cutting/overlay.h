// SPDX-License-Identifier: Apache-2.0
// Second stage of a cut: the local PSLG (planar straight-line graph) of the cavity's rim and the
// tool's outline, on the lattice and without crossings.
//
// Where a tool edge crosses the sheet's boundary, both edges are bent through a lattice point next
// to the crossing (iterated snap rounding after Hobby 1999 and Halperin and Packer 2002, but only
// edges that cross are bent). Contract:
//  1. A bend goes to the nearest corner of the crossing's lattice cell that lies on the material's
//     side of the sheet's boundary, so that the boundary only recedes. If two bent boundary edges
//     cross each other, there may be no such corner, because the material is thinner than the
//     lattice there. Then the nearest corner is used.
//  2. The algorithm terminates. A bend replaces an edge by two edges in its bounding box. Their
//     Manhattan lengths are positive and add up to that of the edge, so the sum of the squared
//     lengths, an integer, decreases with every bend.
//  3. Edges shared with triangles outside the cavity are never bent. If a bend would affect such a
//     triangle, `absorb` lists the triangle, and the caller adds it to the cavity and starts again.
//  4. If nothing crosses, no point moves.
//  5. If sheet and tool are moved by lattice steps or rotated by right angles, the overlay moves
//     and rotates with them and is otherwise the same. It is also the same if they are listed in
//     another order. The reason is that the order of strands and ties between corners are decided
//     in the canonical rotation of rim and tool (rotation_by_moments). This does not hold if that
//     rotation is ambiguous, for example because a rotation maps rim and tool onto themselves.
// Tests: tests/runtime/hole_cutting/cut_property_test.cpp
#pragma once

#include <cstdint>
#include <vector>

#include "formats/geometry/canonical_rotation.h"
#include "runtime/hole_cutting/cavity.h"

namespace trocar::runtime {

/// A straight edge of the local PSLG from point `a` to point `b`, and the edges of rim and tool
/// that run along it.
struct Strand {
  LatticePoint first, second;  ///< points[a] < points[b]
  std::uint32_t a, b;          ///< indices into Overlay::points
  std::int32_t rim = 0;        ///< rim edges from a to b minus rim edges from b to a
  std::int32_t tool = 0;       ///< likewise for the edges of the tool's outline
  std::uint32_t kept = kNone;  ///< the kept triangle beyond a shared edge, or kNone
  bool kept_right = false;     ///< that triangle is on the right of a -> b
  bool gone = false;           ///< the strand has been split; its parts are other strands
};

struct Overlay {
  std::vector<LatticePoint> points;  ///< distinct points of rim, tool, bends, kept inner vertices
  /// Strands that are not `gone` do not cross, and no point lies inside one.
  std::vector<Strand> strands;
  CanonicalRotation rotation;          ///< canonical rotation (contract 5)
  std::vector<std::uint32_t> absorb;   ///< after kAgain: triangles to add to the cavity
  FlatTable point_at;                  ///< index of the point with given coordinates
  FlatTable strand_at;                 ///< latest strand between two points, smaller index first
  std::vector<std::uint32_t> pending;  ///< scratch: strands to be compared with the others

  std::vector<std::uint32_t> rim_point;   ///< point of each vertex of Cavity::rim_vertices
  std::vector<std::uint32_t> rim_strand;  ///< first strand of each edge of Cavity::rim

  void allocate(std::size_t max_triangles, std::size_t max_points, std::size_t max_strands);
  static std::uint64_t key(LatticePoint p) noexcept {
    return pair_key(static_cast<std::uint32_t>(p.x), static_cast<std::uint32_t>(p.y));
  }
};

/// Builds the overlay. After kAgain only `absorb` is valid. O(c^2) for c edges of rim and tool; a
/// puncture has a few dozen.
StageOutcome build_overlay(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
                           Overlay& out) noexcept;

}  // namespace trocar::runtime
