// SPDX-License-Identifier: Apache-2.0
#include "formats/geometry/edge_table.h"

#include <algorithm>
#include <tuple>

namespace trocar {

std::vector<DirectedEdge> sorted_edges(const SliceMesh& mesh) {
  std::vector<std::uint32_t> first(mesh.vertices.size() + 1, 0);
  const auto for_each = [&mesh](auto f) {
    for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
      const Triangle& v = mesh.triangles[t];
      for (int i = 0; i < 3; ++i)
        f(DirectedEdge{v[i], v[(i + 1) % 3], t});
    }
  };
  for_each([&first](const DirectedEdge& e) { ++first[e.key().first + 1]; });
  for (std::size_t v = 1; v < first.size(); ++v)
    first[v] += first[v - 1];
  std::vector<DirectedEdge> edges(mesh.triangles.size() * 3);
  std::vector<std::uint32_t> next = first;
  for_each([&](const DirectedEdge& e) { edges[next[e.key().first]++] = e; });
  for (std::size_t v = 0; v + 1 < first.size(); ++v) {
    std::sort(edges.begin() + first[v], edges.begin() + first[v + 1],
              [](const DirectedEdge& a, const DirectedEdge& b) {
                const std::uint32_t ah = std::max(a.from, a.to), bh = std::max(b.from, b.to);
                return std::tie(ah, a.from, a.triangle) < std::tie(bh, b.from, b.triangle);
              });
  }
  return edges;
}

}  // namespace trocar
