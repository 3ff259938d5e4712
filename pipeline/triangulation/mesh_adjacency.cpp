// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/triangulation/mesh_adjacency.h"

#include "formats/geometry/edge_table.h"

namespace trocar::pipeline {

Neighbours neighbours(const SliceMesh& mesh) {
  Neighbours out(mesh.triangles.size(), {kNoEdge, kNoEdge, kNoEdge});
  edge_table(mesh).for_each_pair([&out](std::uint32_t, std::uint32_t, const auto& edges) {
    if (edges.size() != 2) return true;
    const std::uint32_t a = edges[0].edge, b = edges[1].edge;
    out[a / 3][a % 3] = edge_id(b / 3, b % 3);
    out[b / 3][b % 3] = edge_id(a / 3, a % 3);
    return true;
  });
  return out;
}

}  // namespace trocar::pipeline
