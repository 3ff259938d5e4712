// SPDX-License-Identifier: GPL-3.0-or-later
// The tight spots of an outline: edges shorter than a clearance, and pairs of edges without a
// common end that are nearer to each other than the clearance. Precondition of all functions: edges
// do not cross. Distances are in lattice steps.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "formats/geometry/lattice_box.h"
#include "formats/geometry/slice_mesh.h"
#include "pipeline/contour/segment_distance.h"
#include "pipeline/contour/segment_grid.h"

namespace trocar::pipeline {

/// The clearance, rounded up to whole lattice steps.
inline std::int32_t margin_of(double clearance) {
  return static_cast<std::int32_t>(std::ceil(clearance));
}

inline LatticeBox widened(LatticeBox box, std::int32_t margin) {
  return {{box.low.x - margin, box.low.y - margin}, {box.high.x + margin, box.high.y + margin}};
}

inline bool is_short(const LatticeSegment& s, double clearance) {
  return static_cast<double>(distance2(s.a, s.b)) < clearance * clearance;
}

/// Returns true if the edges have no common end and are nearer to each other than the clearance.
inline bool is_tight(const LatticeSegment& s, const LatticeSegment& t, double clearance) {
  if (s.a == t.a || s.a == t.b || s.b == t.a || s.b == t.b ||
      apart(widened(box_around(s.a, s.b), margin_of(clearance)), box_around(t.a, t.b)))
    return false;
  const Point a = point(s.a), b = point(s.b), c = point(t.a), d = point(t.b);
  return std::min({segment_distance2(a, b, c), segment_distance2(a, b, d),
                   segment_distance2(c, d, a), segment_distance2(c, d, b)}) < clearance * clearance;
}

/// The edges of an outline, ring by ring: one for each vertex, to the next vertex. If is_open[r] is
/// true, ring r is a line, and the edge of its last vertex has length 0. If there are no lines,
/// `is_open` may be empty.
std::vector<LatticeSegment> edges_of(const Pslg& outline, const std::vector<bool>& is_open);

/// Calls visit(i, j) for each tight spot, where i and j are indices of edges. For a short edge
/// i = j. For a pair of edges, visit(i, j) may be called repeatedly. Precondition: `grid` was made
/// of `edges` with margin_of(clearance).
template <typename Visit>
void for_tight_spots(const std::vector<LatticeSegment>& edges, const SegmentGrid& grid,
                     double clearance, const Visit& visit) {
  for (std::uint32_t i = 0; i < edges.size(); ++i)
    if (edges[i].a != edges[i].b && is_short(edges[i], clearance)) visit(i, i);
  grid.for_each_pair([&](std::uint32_t i, std::uint32_t j) {
    if (is_tight(edges[i], edges[j], clearance)) visit(i, j);
  });
}

/// Returns true if there is a tight spot. O(n log n) typically.
bool has_tight_spots(const std::vector<LatticeSegment>& edges, double clearance);

}  // namespace trocar::pipeline
