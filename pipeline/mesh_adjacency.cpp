// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/mesh_adjacency.h"

namespace trocar::pipeline {

Neighbours neighbours(const SliceMesh& mesh) {
  Neighbours out(mesh.triangles.size(), {kNoTriangle, kNoTriangle, kNoTriangle});
  // The sides that leave each vertex, as 3 * triangle + side, grouped by counting.
  std::vector<std::uint32_t> first(mesh.vertices.size() + 1, 0);
  for (const Triangle& t : mesh.triangles) {
    for (const std::uint32_t v : t)
      ++first[v + 1];
  }
  for (std::size_t v = 1; v < first.size(); ++v)
    first[v] += first[v - 1];
  struct Leaving {
    std::uint32_t to, side;
  };
  std::vector<Leaving> leaving(mesh.triangles.size() * 3);
  std::vector<std::uint32_t> end(first.begin(), first.end() - 1);
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const Triangle& v = mesh.triangles[t];
    for (std::uint32_t i = 0; i < 3; ++i) {
      // Side i runs from v[i + 1] to v[i + 2]. Its opposite, if it came before, leaves v[i + 2].
      const std::uint32_t from = v[i == 2 ? 0 : i + 1], to = v[i == 0 ? 2 : i - 1];
      leaving[end[from]++] = {to, 3 * t + i};
      for (std::uint32_t k = first[to]; k < end[to]; ++k) {
        if (leaving[k].to != from) continue;
        const std::uint32_t side = leaving[k].side;
        out[t][i] = side / 3;
        out[side / 3][side % 3] = t;
        break;
      }
    }
  }
  return out;
}

}  // namespace trocar::pipeline
