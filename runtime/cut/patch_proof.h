// SPDX-License-Identifier: Apache-2.0
// Fifth stage of a cut: the proof that a valid sheet will be valid with the patch in place of the
// cavity, by looking at nothing but the cavity and what lies beside it.
//
// What is proved, exactly, and what of formats/geometry/mesh_validity.h follows from it:
//  1. Every new triangle is strictly counter-clockwise.
//  2. Every side of a new triangle has one partner: a new triangle with the same side, or the
//     triangle that stays beyond a rim edge, each of these at most once. So no directed edge occurs
//     twice. (One fan at each vertex holds by the way in which stitch() numbers them.)
//  3. Sides between two new triangles are locally Delaunay.
//  4. New edges of the sheet's boundary cross neither each other nor an edge of the boundary near
//     them; edges that were there already and the sides laid bare do not, since the sheet was
//     valid.
//  5. The cavity's area less the patch's is that of the hole's rings.
#pragma once

#include <cstdint>
#include <vector>

#include "runtime/cut/hole_outline.h"

namespace trocar::runtime {

struct ProofSpace {
  struct Segment {
    LatticePoint a, b;
  };
  std::vector<Segment> fresh, old;  ///< edges of the boundary to be
  FlatTable rim_at;                 ///< of shared rim edges, by kept triangle and side; 1: used
  FlatTable boundary_at;            ///< rim edges on the sheet's boundary, by the overlay's points

  void allocate(std::size_t max_edges);
};

struct Proof {
  const char* bug = nullptr;              ///< null if all holds; else what does not, in words
  bool full = false;                      ///< the workspace was too small to tell
  std::int64_t doubled_area_removed = 0;  ///< of (cavity minus patch); only if all holds
};
Proof prove(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
            const Overlay& overlay, const Patch& patch, const HoleOutline& hole,
            ProofSpace& space) noexcept;

}  // namespace trocar::runtime
