// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/mesh/mesh_adjacency.h"

namespace trocar::pipeline {

Neighbours neighbours(const SliceMesh& mesh) {
  Neighbours out(mesh.triangles.size(), {kNoEdge, kNoEdge, kNoEdge});
  // The edges that leave each vertex, grouped by counting.
  std::vector<std::uint32_t> first(mesh.vertices.size() + 1, 0);
  for (const Triangle& t : mesh.triangles) {
    for (const std::uint32_t v : t)
      ++first[v + 1];
  }
  for (std::size_t v = 1; v < first.size(); ++v)
    first[v] += first[v - 1];
  struct Leaving {
    std::uint32_t to;
    EdgeId edge;
  };
  std::vector<Leaving> leaving(mesh.triangles.size() * 3);
  std::vector<std::uint32_t> end(first.begin(), first.end() - 1);
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const Triangle& v = mesh.triangles[t];
    for (std::uint32_t i = 0; i < 3; ++i) {
      // The same edge of the neighbour, if that came before, leaves where this one ends.
      const std::uint32_t from = v[i], to = v[next_corner(i)];
      leaving[end[from]++] = {to, edge_id(t, i)};
      for (std::uint32_t k = first[to]; k < end[to]; ++k) {
        if (leaving[k].to != from) continue;
        const EdgeId edge = leaving[k].edge;
        out[t][i] = edge;
        out[triangle_of(edge)][index_of(edge)] = edge_id(t, i);
        break;
      }
    }
  }
  return out;
}

}  // namespace trocar::pipeline
