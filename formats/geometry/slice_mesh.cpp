// SPDX-License-Identifier: Apache-2.0
#include "formats/geometry/slice_mesh.h"

#include <algorithm>
#include <map>
#include <utility>

#include "formats/geometry/edge_table.h"

namespace trocar {

void split_at_pinches(const Ring& ring, std::vector<Ring>& out) {
  Ring sorted = ring;
  std::sort(sorted.begin(), sorted.end());
  if (std::adjacent_find(sorted.begin(), sorted.end()) == sorted.end()) {
    out.push_back(ring);
    return;
  }
  Ring path;
  std::map<LatticePoint, std::size_t> position;  // in path
  for (const LatticePoint p : ring) {
    if (const auto it = position.find(p); it != position.end()) {
      const auto first = path.begin() + static_cast<std::ptrdiff_t>(it->second);
      out.emplace_back(first, path.end());
      for (const LatticePoint q : out.back())
        position.erase(q);
      path.erase(first, path.end());
    }
    position[p] = path.size();
    path.push_back(p);
  }
  out.push_back(std::move(path));
}

// The sums are modulo 2^64: partial sums of a ring's area may leave the range of 64 bits although
// the whole does not (a spiral over the whole lattice).

std::int64_t doubled_area(const Ring& ring) {
  std::uint64_t sum = 0;
  for (std::size_t i = 0, n = ring.size(); i < n; ++i) {
    sum += static_cast<std::uint64_t>(orient2d(ring[0], ring[i], ring[i + 1 == n ? 0 : i + 1]));
  }
  return static_cast<std::int64_t>(sum);
}

std::int64_t doubled_area(const Pslg& pslg) {
  std::uint64_t sum = 0;
  for (const Ring& ring : pslg.rings)
    sum += static_cast<std::uint64_t>(doubled_area(ring));
  return static_cast<std::int64_t>(sum);
}

std::int64_t doubled_area(const SliceMesh& mesh) {
  std::uint64_t sum = 0;
  for (const Triangle& t : mesh.triangles) {
    sum += static_cast<std::uint64_t>(
        orient2d(mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]));
  }
  return static_cast<std::int64_t>(sum);
}

Pslg boundary_rings(const SliceMesh& mesh) {
  // An edge without its opposite is boundary.
  const std::vector<DirectedEdge> edges = sorted_edges(mesh);
  constexpr std::uint32_t kNone = 0xffffffff;
  std::vector<std::uint32_t> next(mesh.vertices.size(), kNone);
  for (std::size_t i = 0; i < edges.size();) {
    if (i + 1 < edges.size() && edges[i].key() == edges[i + 1].key()) {
      i += 2;
    } else {
      next[edges[i].from] = edges[i].to;
      ++i;
    }
  }
  Pslg out;
  for (std::uint32_t v = 0; v < next.size(); ++v) {
    if (next[v] == kNone) continue;
    Ring ring;
    for (std::uint32_t u = v; next[u] != kNone;) {
      ring.push_back(mesh.vertices[u]);
      const std::uint32_t w = next[u];
      next[u] = kNone;
      u = w;
    }
    split_at_pinches(ring, out.rings);
  }
  for (Ring& ring : out.rings) {
    std::rotate(ring.begin(), std::min_element(ring.begin(), ring.end()), ring.end());
  }
  std::sort(out.rings.begin(), out.rings.end());
  return out;
}

}  // namespace trocar
