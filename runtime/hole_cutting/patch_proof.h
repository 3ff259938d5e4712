// SPDX-License-Identifier: Apache-2.0
// Fifth stage of a cut: proves that a valid sheet stays valid when the patch replaces the cavity.
// The proof uses only the cavity and its neighbourhood.
//
// The following statements are proved exactly. Together they imply that the mesh is
// valid (formats/geometry/mesh_validity.h):
//  1. Every new triangle is strictly counter-clockwise.
//  2. Beyond every inner edge of a new triangle lies exactly one triangle: a new one with the same
//     edge, or a kept one beyond a rim edge. Each rim edge is used at most once. So no directed
//     edge occurs twice. (That each vertex has only one fan of triangles follows from the way in
//     which stitch() numbers the vertices.)
//  3. Edges between two new triangles are locally Delaunay.
//  4. New boundary edges of the sheet cross neither each other nor a boundary edge near them.
//     Old boundary edges, and inner edges that become boundary edges, do not cross each other in
//     a valid sheet.
//  5. The cavity's area minus the patch's area equals the area of the hole's rings.
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
  std::vector<Segment> fresh, old;  ///< edges of the new boundary: new ones, existing ones
  FlatTable rim_at;       ///< shared rim edges, keyed by kept triangle and edge; 1: matched
  FlatTable boundary_at;  ///< rim edges on the sheet's boundary, keyed by overlay points

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
