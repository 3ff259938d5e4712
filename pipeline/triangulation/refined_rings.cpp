// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/triangulation/refined_rings.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "formats/geometry/edge_table.h"

namespace trocar::pipeline {
namespace {

// Finds the next vertex on the boundary, which has the material on its left, for each vertex. The
// mesh is a manifold (a pinch is two vertices), so there is at most one.
std::vector<std::uint32_t> next_on_boundary(const SliceMesh& mesh) {
  std::vector<std::uint32_t> next(mesh.vertices.size());
  edge_table(mesh).for_each_pair([&](std::uint32_t low, std::uint32_t high, const auto& edges) {
    if (edges.size() == 1) {
      const std::uint32_t edge = edges[0].edge, from = mesh.triangles[edge / 3][edge % 3];
      next[from] = from == low ? high : low;
    }
    return true;
  });
  return next;
}

}  // namespace

Pslg refined_rings(const Refined& refined, const Pslg& outline) {
  const std::vector<LatticePoint>& points = refined.mesh.vertices;
  const std::vector<std::uint32_t> next = next_on_boundary(refined.mesh);
  // Segments are looked up by their two ends, which no two segments share.
  const auto ends = [&points](const Refined::Segment& s) {
    return std::pair{points[s.from], points[s.to]};
  };
  std::vector<Refined::Segment> segments = refined.segments;
  std::sort(segments.begin(), segments.end(),
            [&ends](const auto& s, const auto& t) { return ends(s) < ends(t); });
  Pslg out;
  for (const Ring& ring : outline.rings) {
    Ring& stored = out.rings.emplace_back();
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const std::pair wanted{ring[i], ring[(i + 1) % ring.size()]};
      const auto s =
          std::lower_bound(segments.begin(), segments.end(), wanted,
                           [&ends](const auto& t, const auto& w) { return ends(t) < w; });
      for (std::uint32_t v = s->from; v != s->to; v = next[v])
        stored.push_back(points[v]);
    }
  }
  return out;
}

}  // namespace trocar::pipeline
