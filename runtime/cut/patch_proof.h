// SPDX-License-Identifier: Apache-2.0
// Fifth stage of a cut: the proof that a valid sheet stays valid with the patch in place of the
// cavity, from the cavity and its neighbourhood alone.
//
// What is proved, exactly, and what of formats/geometry/mesh_validity.h follows from it:
//  1. Every new triangle is strictly counter-clockwise.
//  2. Beyond every inner edge of a new triangle lies one triangle: a new one with the same edge, or
//     one that stays beyond a rim edge, each of these at most once. So no directed edge occurs
//     twice. (One fan at each vertex follows from how stitch() numbers them.)
//  3. Edges between two new triangles are locally Delaunay.
//  4. New boundary edges of the sheet cross neither each other nor a boundary edge near them. Old
//     boundary edges, and inner edges that become boundary, do not cross since the sheet was valid.
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
  std::vector<Segment> fresh, old;  ///< edges of the new boundary: new ones, and former edges
  FlatTable rim_at;                 ///< shared rim edges, by kept triangle and edge; 1: used
  FlatTable boundary_at;            ///< rim edges on the sheet's boundary, by the overlay's points

  void allocate(std::size_t max_edges);
};

struct Proof {
  const char* bug = nullptr;              ///< null if all is proved; else what does not hold
  bool capacity_exceeded = false;         ///< the workspace was too small for the proof
  std::int64_t doubled_area_removed = 0;  ///< of (cavity minus patch); only if all is proved
};
Proof prove(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
            const Overlay& overlay, const Patch& patch, const HoleOutline& hole,
            ProofSpace& space) noexcept;

}  // namespace trocar::runtime
