// SPDX-License-Identifier: GPL-3.0-or-later
// The edges that two regions share during refinement. Each region has its own vertices. The same
// edge on the other side is found by the other region's copy of its end.
// Tests: tests/pipeline/triangulation/regions_test.cpp
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "pipeline/triangulation/refinement_mesh.h"
#include "pipeline/triangulation/refinement_outline.h"

namespace trocar::pipeline {

/// The positions at which to split a shared edge ab, with the triangles abc and bad on its sides,
/// at this fraction. These are the nearest lattice point on each side, the one that better keeps
/// the areas first. `lost` is twice the area that the side of c has lost along this border so far.
/// There may be none, one or two positions.
std::array<std::optional<LatticePoint>, 2> shared_split_points(LatticePoint a, LatticePoint b,
                                                               LatticePoint c, LatticePoint d,
                                                               double fraction, std::int64_t lost);

/// Returns true if the edge on the outline may be split at p, which may lie on its inner side or
/// beyond it. If p lies beyond it, the circumcircle of the edge's triangle must contain p, so that
/// the mesh stays Delaunay.
bool may_split_either_way(const RefinementMesh& mesh, EdgeId edge, LatticePoint p);

class SharedEdges {
 public:
  void clear() {
    leaving_.clear();
    copies_.clear();
  }

  /// Records the edges of a new triangle that are on the outline.
  void note(const RefinementMesh& mesh, std::uint32_t t) {
    leaving_.resize(mesh.points.size(), kNoEdge);
    for (std::uint32_t i = 0; i < 3; ++i) {
      if ((mesh.triangles[t].beyond[i] & kOutline) != 0)
        leaving_[mesh.triangles[t].v[i]] = edge_id(t, i);
    }
  }
  /// Records that a shared edge has been split, with its new vertices on the two sides.
  void add_copies(std::uint32_t here, std::uint32_t there) {
    copies_.resize(there + 1, 0);
    copies_[here] = there;
    copies_[there] = here;
  }

  /// The same edge on the other side; kNoEdge if there is none.
  EdgeId beyond(EdgeId e, const RefinementMesh& mesh, const RefinementOutline& outline) const {
    const std::uint32_t segment = mesh.beyond(e) ^ kOutline, twin = outline.twin(segment);
    if (twin == RefinementOutline::kNoTwin) return kNoEdge;
    const std::uint32_t end = mesh.ends(e).second;
    return leaving_[end == outline.segments()[segment].to ? outline.segments()[twin].from
                                                          : copies_[end]];
  }

 private:
  std::vector<EdgeId> leaving_;        // by vertex: the outline's edge that starts there
  std::vector<std::uint32_t> copies_;  // by vertex that splits a shared edge: the other side's
};

}  // namespace trocar::pipeline
