// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/mesh/refined_rings.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace trocar::pipeline {
namespace {

struct Edge {
  std::uint32_t from, to;
};

// By vertex: the next one on the boundary, which has the material on its left. The mesh is a
// manifold (a pinch is two vertices), so there is at most one.
std::vector<std::uint32_t> next_on_boundary(const Refined& refined) {
  const auto is_free = [&refined](std::uint32_t v) {
    return refined.origins[v].segment == VertexOrigin::kFree;
  };
  std::vector<Edge> edges;
  for (const Triangle& t : refined.mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      const Edge e{t[i], t[(i + 1) % 3]};
      if (!is_free(e.from) && !is_free(e.to)) edges.push_back(e);
    }
  }
  const auto ends = [](const Edge& e) { return std::minmax(e.from, e.to); };
  std::sort(edges.begin(), edges.end(),
            [&ends](const Edge& e, const Edge& f) { return ends(e) < ends(f); });
  std::vector<std::uint32_t> next(refined.mesh.vertices.size());
  for (std::size_t i = 0; i < edges.size(); ++i) {
    if (i + 1 < edges.size() && ends(edges[i]) == ends(edges[i + 1])) {
      ++i;
    } else {
      next[edges[i].from] = edges[i].to;
    }
  }
  return next;
}

}  // namespace

Pslg refined_rings(const Refined& refined, const Pslg& outline) {
  const std::vector<LatticePoint>& points = refined.mesh.vertices;
  const std::vector<std::uint32_t> next = next_on_boundary(refined);
  // By their ends, which no two segments share.
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
