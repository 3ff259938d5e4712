// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/mesh/mesh_adjacency.h"

namespace trocar::pipeline {

Neighbours neighbours(const SliceMesh& mesh) {
  Neighbours out(mesh.triangles.size(), {kNoSide, kNoSide, kNoSide});
  // The sides that leave each vertex, grouped by counting.
  std::vector<std::uint32_t> first(mesh.vertices.size() + 1, 0);
  for (const Triangle& t : mesh.triangles) {
    for (const std::uint32_t v : t)
      ++first[v + 1];
  }
  for (std::size_t v = 1; v < first.size(); ++v)
    first[v] += first[v - 1];
  struct Leaving {
    std::uint32_t to;
    Side side;
  };
  std::vector<Leaving> leaving(mesh.triangles.size() * 3);
  std::vector<std::uint32_t> end(first.begin(), first.end() - 1);
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const Triangle& v = mesh.triangles[t];
    for (std::uint32_t i = 0; i < 3; ++i) {
      // Its opposite, if it came before, leaves where it ends.
      const std::uint32_t from = v[after(i)], to = v[before(i)];
      leaving[end[from]++] = {to, side_number(t, i)};
      for (std::uint32_t k = first[to]; k < end[to]; ++k) {
        if (leaving[k].to != from) continue;
        const Side side = leaving[k].side;
        out[t][i] = side;
        out[triangle_of(side)][index_of(side)] = side_number(t, i);
        break;
      }
    }
  }
  return out;
}

}  // namespace trocar::pipeline
