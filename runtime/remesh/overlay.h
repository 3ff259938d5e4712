// SPDX-License-Identifier: Apache-2.0
// Second stage of a cut: the local PSLG of the cavity's rim and the tool's
// outline, on the lattice and without crossings.
//
// Where a tool edge crosses the sheet's boundary, both are bent through a
// lattice point beside the crossing (iterated snap rounding after Hobby 1999 and
// Halperin and Packer 2002, bending only what crosses). Laws:
//  1. A bend goes to the nearest corner of the lattice cell of the crossing that
//     lies on the material's side of the sheet's boundary: the boundary only ever
//     recedes, so that no material is added. Only where two bent pieces of
//     boundary cross each other may no such corner exist (the material is
//     thinner than the lattice there); then the nearest corner is taken.
//  2. It ends: a bend replaces an edge by two in its bounding box whose Manhattan
//     lengths are positive and add up to the edge's, so the sum of the squared
//     lengths, an integer, falls with every bend.
//  3. Edges that triangles outside the cavity share are never bent: where a bend
//     would run into such a triangle, the triangle is named in `absorb`, and the
//     caller repeats the stage with it in the cavity.
//  4. Without a crossing nothing moves.
#pragma once

#include <cstdint>
#include <vector>

#include "runtime/remesh/cavity.h"

namespace trocar::runtime {

/// An edge of the local PSLG between points a < b.
struct PlanarEdge {
  std::uint32_t a, b;  ///< into Overlay::points
  int rim = 0;         ///< times that the cavity's rim runs from a to b, less b to a
  int tool = 0;        ///< likewise the tool's outline
  std::uint32_t kept;  ///< the triangle beyond a shared edge, or kNone
  bool kept_right;     ///< that triangle is on the right of a -> b
};

struct Overlay {
  std::vector<LatticePoint> points;   ///< distinct, ascending; includes vertices worth keeping
  std::vector<PlanarEdge> edges;      ///< no two cross, no point inside one
  std::vector<std::uint32_t> absorb;  ///< not empty: nothing else is valid (law 3)
};

/// O(c^2) for c edges of rim and tool, with c the few dozens of a puncture.
Overlay overlay(const SliceMesh& sheet, const Neighbours& neighbours, const Cavity& cavity,
                const Ring& tool);

}  // namespace trocar::runtime
