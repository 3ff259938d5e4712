// SPDX-License-Identifier: Apache-2.0
// Second stage of a cut: the local PSLG of the cavity's rim and the tool's
// outline, on the lattice and without crossings.
//
// Where a tool edge crosses the sheet's boundary, both are bent through a
// lattice point beside the crossing (iterated snap rounding after Hobby 1999 and
// Halperin and Packer 2002, bending only what crosses). Contract:
//  1. A bend goes to the nearest corner of the crossing's lattice cell that lies on the material's
//     side of the sheet's boundary: the boundary only recedes, so no material is added. Only where
//     two bent pieces of boundary cross each other may no such corner exist (the material is
//     thinner than the lattice there); then the nearest corner is taken.
//  2. It ends: a bend replaces an edge by two in its bounding box whose Manhattan lengths are
//     positive and add up to the edge's, so the sum of the squared lengths, an integer, falls with
//     every bend.
//  3. Edges that triangles outside the cavity share are never bent: where a bend would reach such a
//     triangle, the triangle is listed in `absorb`, and the caller repeats the stage with it in the
//     cavity.
//  4. Without a crossing nothing moves.
//  5. Sheet and tool moved by lattice steps, rotated by right angles or listed in another order
//     give the same overlay, moved and rotated: the order of strands and ties between corners are
//     decided in the canonical orientation of rim and tool (rotation_by_moments). This does not
//     hold where that is undecided, as where a rotation maps them onto themselves.
#pragma once

#include <cstdint>
#include <vector>

#include "formats/geometry/canonical_rotation.h"
#include "runtime/cut/cavity.h"

namespace trocar::runtime {

/// A straight edge of the local PSLG from point `a` to point `b`, of which the first is the
/// smaller, and what runs along it.
struct Strand {
  LatticePoint first, second;  ///< points[a] < points[b]
  std::uint32_t a, b;          ///< into Overlay::points
  std::int32_t rim = 0;        ///< times that the cavity's rim runs from a to b, less b to a
  std::int32_t tool = 0;       ///< the same of the tool's outline
  std::uint32_t kept = kNone;  ///< the triangle beyond a shared edge, or kNone
  bool kept_right = false;     ///< that triangle is on the right of a -> b
  bool gone = false;           ///< split: its pieces are elsewhere in the list
};

struct Overlay {
  std::vector<LatticePoint> points;  ///< distinct: rim, tool, bends, and inner vertices that stay
  std::vector<Strand> strands;  ///< of those not gone no two cross, and no point lies inside one
  CanonicalRotation rotation;   ///< contract 5
  std::vector<std::uint32_t> absorb;   ///< kAgain: triangles to add to the cavity (contract 3)
  FlatTable point_at;                  ///< a point's index, by its coordinates
  FlatTable strand_at;                 ///< the latest strand between two points, the smaller first
  std::vector<std::uint32_t> pending;  ///< scratch: strands to be compared with the others

  std::vector<std::uint32_t> rim_point;   ///< of Cavity::rim_vertices
  std::vector<std::uint32_t> rim_strand;  ///< of Cavity::rim: its first strand

  void allocate(std::size_t max_triangles, std::size_t max_points, std::size_t max_strands);
  static std::uint64_t key(LatticePoint p) noexcept {
    return pair_key(static_cast<std::uint32_t>(p.x), static_cast<std::uint32_t>(p.y));
  }
};

/// O(c^2) for c edges of rim and tool, with c the few dozens of a puncture. kAgain: only `absorb`
/// is valid.
StageOutcome build_overlay(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
                           Overlay& out) noexcept;

}  // namespace trocar::runtime
