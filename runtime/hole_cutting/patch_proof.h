// SPDX-License-Identifier: Apache-2.0
// Fifth stage of a cut: the proof that a valid sheet stays valid with the patch in place of the
// cavity, from the cavity and its neighbourhood alone.
//
// These statements are proved exactly. They imply the validity of formats/geometry/mesh_validity.h:
//  1. Every new triangle is strictly counter-clockwise.
//  2. Beyond every inner edge of a new triangle lies one triangle: a new one with the same edge, or
//     a kept one beyond a rim edge, each of which occurs at most once. So no directed edge occurs
//     twice. (There is one fan at each vertex because of the way in which stitch() numbers them.)
//  3. Edges between two new triangles are locally Delaunay.
//  4. New boundary edges of the sheet cross neither each other nor a boundary edge near them. Old
//     boundary edges, and inner edges that become boundary edges, do not cross in a valid sheet.
//  5. The cavity's area minus the patch's area is that of the hole's rings.
// Tests: tests/runtime/hole_cutting/cut_property_test.cpp
#pragma once

#include <cstdint>
#include <vector>

#include "runtime/hole_cutting/hole_outline.h"

namespace trocar::runtime {

struct ProofSpace {
  struct Segment {
    LatticePoint a, b;
  };
  std::vector<Segment> fresh, old;  ///< edges of the new boundary: new edges, and former ones
  FlatTable rim_at;                 ///< shared rim edges by kept triangle and edge: 1 if matched
  FlatTable boundary_at;            ///< rim edges on the sheet's boundary, by the overlay's points

  void allocate(std::size_t max_edges);
};

struct Proof {
  const char* bug = nullptr;              ///< the violated statement; null if all are proved
  bool capacity_exceeded = false;         ///< the workspace was too small for the proof
  std::int64_t doubled_area_removed = 0;  ///< twice the area of (cavity minus patch), if proved
};
Proof prove(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
            const Overlay& overlay, const Patch& patch, const HoleOutline& hole,
            ProofSpace& space) noexcept;

}  // namespace trocar::runtime
