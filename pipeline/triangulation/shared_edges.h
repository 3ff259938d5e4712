// SPDX-License-Identifier: GPL-3.0-or-later
// Finds, for an edge that two regions share during refinement, the same edge in the other region.
// Each region has its own vertices, so a shared edge exists twice. SharedEdges therefore records
// which vertices of the two regions are copies of each other. The header also chooses the points at
// which a shared edge is split.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "pipeline/triangulation/refinement_mesh.h"
#include "pipeline/triangulation/refinement_outline.h"

namespace trocar::pipeline {

/// Returns up to two positions at which to split a shared edge ab near the given fraction of the
/// way from a to b. The triangles on the two sides of the edge are (a, b, c) and (b, a, d). The
/// positions are the nearest lattice points on either side of ab at which the edge may be split. A
/// split beside the edge takes area from one region and gives it to the other. `lost` is twice the
/// area, in steps^2, that the region of c has lost along this border so far; it is negative if that
/// region has gained area. The position that leaves the smaller loss or gain comes first.
std::array<std::optional<LatticePoint>, 2> shared_split_points(LatticePoint a, LatticePoint b,
                                                               LatticePoint c, LatticePoint d,
                                                               double fraction, std::int64_t lost);

/// Returns true if an edge of the outline may be split at p. If p lies on the edge or on its
/// inner side, may_split() decides. If p lies beyond the edge, p must lie in the circle whose
/// diameter is the edge, and in the circumcircle of the edge's triangle. (The mesh would
/// otherwise cease to be Delaunay.)
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
  /// Records that a shared edge was split: `here` and `there` are the new vertices on its two
  /// sides. Precondition: here < there.
  void add_copies(std::uint32_t here, std::uint32_t there) {
    copies_.resize(there + 1, 0);
    copies_[here] = there;
    copies_[there] = here;
  }

  /// The edge of the other region that coincides with e; kNoEdge if there is none.
  EdgeId beyond(EdgeId e, const RefinementMesh& mesh, const RefinementOutline& outline) const {
    const std::uint32_t segment = mesh.beyond(e) ^ kOutline, twin = outline.twin(segment);
    if (twin == RefinementOutline::kNoTwin) return kNoEdge;
    const std::uint32_t end = mesh.ends(e).second;
    return leaving_[end == outline.segments()[segment].to ? outline.segments()[twin].from
                                                          : copies_[end]];
  }

 private:
  std::vector<EdgeId> leaving_;  // for each vertex: the outline's edge that starts there
  // The copy, in the other region, of each vertex at which a shared edge was split.
  std::vector<std::uint32_t> copies_;
};

}  // namespace trocar::pipeline
