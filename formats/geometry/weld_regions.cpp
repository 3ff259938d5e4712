// SPDX-License-Identifier: Apache-2.0
#include "formats/geometry/weld_regions.h"

#include <algorithm>
#include <string>
#include <utility>

#include "formats/base/disjoint_sets.h"

namespace trocar {
namespace {

constexpr std::uint32_t kNotNumbered = 0xffffffff;

// A boundary edge; the regions' vertices are numbered consecutively.
struct RegionEdge {
  LatticePoint from, to;
  std::uint32_t first, second;
  std::size_t region;
  std::pair<LatticePoint, LatticePoint> ends() const { return {from, to}; }
};

Result<void> add_boundary(const SliceMesh& mesh, std::size_t region, std::uint32_t first,
                          std::vector<RegionEdge>& out) {
  using Pair = std::pair<std::uint32_t, std::uint32_t>;
  std::vector<Pair> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (const Triangle& t : mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      if (t[i] >= mesh.vertices.size()) return refused("a triangle has a vertex that is not there");
      edges.emplace_back(t[i], t[(i + 1) % 3]);
    }
  }
  std::sort(edges.begin(), edges.end());
  for (const auto& [a, b] : edges) {
    if (!std::binary_search(edges.begin(), edges.end(), Pair{b, a}))
      out.push_back({mesh.vertices[a], mesh.vertices[b], first + a, first + b, region});
  }
  return {};
}

}  // namespace

Result<WeldedRegions> weld_regions(std::span<const SliceMesh* const> regions) {
  std::vector<RegionEdge> edges;
  std::uint32_t vertices = 0;
  for (std::size_t k = 0; k < regions.size(); ++k) {
    if (auto ok = add_boundary(*regions[k], k, vertices, edges); !ok) return ok.error();
    vertices += static_cast<std::uint32_t>(regions[k]->vertices.size());
  }
  std::sort(edges.begin(), edges.end(),
            [](const RegionEdge& e, const RegionEdge& f) { return e.ends() < f.ends(); });
  DisjointSets sets(vertices);
  for (std::size_t i = 0; i < edges.size(); ++i) {
    const RegionEdge& edge = edges[i];
    if (i > 0 && edges[i - 1].ends() == edge.ends())
      return refused("two meshes lie on the same side of an edge at " + to_text(edge.from));
    const auto twin =
        std::lower_bound(edges.begin(), edges.end(), std::pair{edge.to, edge.from},
                         [](const RegionEdge& e, const auto& ends) { return e.ends() < ends; });
    if (twin == edges.end() || twin->ends() != std::pair{edge.to, edge.from} ||
        twin->region == edge.region)
      continue;
    sets.join(edge.first, twin->second);
    sets.join(edge.second, twin->first);
  }

  // The root of a set is its first vertex.
  WeldedRegions out;
  std::vector<std::uint32_t> number(vertices, kNotNumbered);
  std::uint32_t first = 0;
  for (const SliceMesh* const region : regions) {
    std::vector<std::uint32_t>& vertex = out.vertex.emplace_back();
    for (std::uint32_t v = 0; v < region->vertices.size(); ++v) {
      std::uint32_t& merged = number[sets.root(first + v)];
      if (merged == kNotNumbered) {
        merged = static_cast<std::uint32_t>(out.mesh.vertices.size());
        out.mesh.vertices.push_back(region->vertices[v]);
      }
      vertex.push_back(merged);
    }
    for (const Triangle& t : region->triangles)
      out.mesh.triangles.push_back({vertex[t[0]], vertex[t[1]], vertex[t[2]]});
    first += static_cast<std::uint32_t>(region->vertices.size());
  }
  return out;
}

}  // namespace trocar
