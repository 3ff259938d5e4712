// SPDX-License-Identifier: Apache-2.0
// Proves that a valid sheet stays valid when the patch replaces the cavity. The cavity is the set
// of triangles that the tool overlaps or touches, and the patch is the set of new triangles. This
// is the fifth stage of a cut. Triangles outside the cavity are kept. The proof uses only the
// cavity and its neighbourhood.
//
// The following statements are proved exactly. Together with the way in which stitch() numbers
// vertices, they imply that the mesh is valid (formats/geometry/mesh_validity.h):
//  1. Every new triangle is strictly counter-clockwise.
//  2. Each edge of a new triangle becomes a boundary edge of the sheet, or exactly one other
//     triangle has the same edge. The other triangle is new, or it is a kept triangle on the other
//     side of the cavity's boundary. Each edge of a kept triangle is used by at most one new
//     triangle. So at most two triangles share an edge. The proof checks that they have the edge in
//     opposite directions, so no directed edge occurs twice. (In a valid mesh the triangles of each
//     vertex also form one fan, in which each triangle shares an edge with the next. This is not
//     proved here, because stitch() ensures it: it gives each fan a vertex of its own.)
//  3. Edges between two new triangles are locally Delaunay: the two angles opposite the edge add up
//     to at most 180 degrees.
//  4. Boundary edges that the cut creates cross neither each other nor any old boundary edge near
//     them. (Old boundary edges were edges of the valid sheet before the cut, so they do not cross
//     each other.)
//  5. The cavity's area minus the patch's area equals the area of the hole's rings.
#pragma once

#include <cstdint>
#include <vector>

#include "runtime/hole_cutting/hole_outline.h"

namespace trocar::runtime {

/// The scratch memory of the proof.
struct ProofSpace {
  struct Segment {
    LatticePoint a, b;
  };
  /// Boundary edges of the sheet after the cut. The cut creates the `fresh` ones. The `old` ones
  /// were edges of the sheet before the cut.
  std::vector<Segment> fresh, old;
  /// Edges that cavity and kept triangles have in common. Key: kept triangle and number of its
  /// edge; value: 1 if a new triangle has the same edge, else 0.
  FlatTable kept_edge_at;
  /// Edges of the cavity that are boundary edges of the sheet. Key: the edge's two ends, as indices
  /// into Overlay::points.
  FlatTable boundary_at;

  void allocate(std::size_t max_edges);
};

struct Proof {
  const char* bug = nullptr;              ///< the violated statement; null if all are proved
  bool capacity_exceeded = false;         ///< the scratch memory is too small for the proof
  std::int64_t doubled_area_removed = 0;  ///< twice the area of (cavity minus patch), if proved
};
/// Checks the statements 1 to 5. If the result has neither `bug` nor `capacity_exceeded`, all five
/// are proved.
Proof prove(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
            const Overlay& overlay, const Patch& patch, const HoleOutline& hole,
            ProofSpace& space) noexcept;

}  // namespace trocar::runtime
