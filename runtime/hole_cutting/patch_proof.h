// SPDX-License-Identifier: Apache-2.0
// Fifth stage of a cut: proves that a valid sheet stays valid when the patch (the new triangles)
// replaces the cavity. Triangles outside the cavity are kept. The proof uses only the cavity and
// its neighbourhood.
//
// The following statements are proved exactly. Together they imply that the mesh is
// valid (formats/geometry/mesh_validity.h):
//  1. Every new triangle is strictly counter-clockwise.
//  2. An edge of a new triangle either becomes a boundary edge of the sheet, or exactly one other
//     triangle has the same edge. That triangle is a new one, or it is a kept one on the other side
//     of the cavity's boundary. Each edge of the cavity's boundary belongs to at most one new
//     triangle. So no directed edge occurs twice. (That the triangles of each vertex are connected
//     across edges follows from the way in which stitch() numbers the vertices.)
//  3. Edges between two new triangles are locally Delaunay.
//  4. Boundary edges that the cut creates cross neither each other nor any other boundary edge near
//     them. (The other boundary edges were edges of the valid sheet before the cut, so they do not
//     cross each other.)
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
  /// Boundary edges of the sheet after the cut: `fresh` are created by the cut, `old` existed
  /// before.
  std::vector<Segment> fresh, old;
  /// Edges that cavity and kept triangles have in common. Key: kept triangle and number of its
  /// edge; value: 1 if a new triangle has the same edge, else 0.
  FlatTable rim_at;
  /// Edges of the cavity that are boundary edges of the sheet. Key: the edge's ends in
  /// Overlay::points.
  FlatTable boundary_at;

  void allocate(std::size_t max_edges);
};

struct Proof {
  const char* bug = nullptr;              ///< the violated statement; null if all are proved
  bool capacity_exceeded = false;         ///< the scratch memory is too small for the proof
  std::int64_t doubled_area_removed = 0;  ///< twice the area of (cavity minus patch), if proved
};
/// Proves the statements 1 to 5.
Proof prove(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
            const Overlay& overlay, const Patch& patch, const HoleOutline& hole,
            ProofSpace& space) noexcept;

}  // namespace trocar::runtime
