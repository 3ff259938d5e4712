// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/shared_borders.h"

#include "formats/base/disjoint_sets.h"
#include "formats/mesh/mesh_validity.h"

namespace trocar {
namespace {

// An edge of a region, and the stored edges into which it was divided.
struct Border {
  LatticePoint from, to;
  std::size_t region;
  const Ring* stored;
  std::size_t first, edges;  // first edge in the stored ring, and count
  std::pair<LatticePoint, LatticePoint> ends() const { return {from, to}; }
  // Point i along the divided edge: 0 is its start, `edges` its end.
  LatticePoint point(std::size_t i) const { return (*stored)[(first + i) % stored->size()]; }
};

Result<void> add_borders(std::size_t region, const Ring& ring, const Ring& stored,
                         std::vector<Border>& out) {
  std::size_t at = 0;  // position in `stored`
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const LatticePoint from = ring[i], to = ring[(i + 1) % ring.size()];
    if (at == stored.size() || stored[at] != from)
      return refused("the stored outline does not pass an input vertex at " + to_text(from));
    const std::size_t first = at++;
    while (at < stored.size() && (i + 1 == ring.size() || stored[at] != to))
      ++at;
    out.push_back({from, to, region, &stored, first, at - first});
  }
  return {};
}

struct BorderEdge {
  LatticePoint from, to;
  // NOLINTNEXTLINE(modernize-use-nullptr): clang-tidy 14 takes the comparison with 0 for a pointer
  friend auto operator<=>(const BorderEdge&, const BorderEdge&) = default;
};

// When turning clockwise around p from the direction of `start`, does the direction of a come
// before that of b?
bool is_before_clockwise(LatticePoint p, LatticePoint start, LatticePoint a, LatticePoint b) {
  const auto half = [p, start](LatticePoint q) {
    const std::int64_t side = orient2d(p, start, q);
    return side < 0 ? 0 : side > 0 ? 2 : diametral_dot(start, q, p) < 0 ? 1 : 3;
  };
  return half(a) != half(b) ? half(a) < half(b) : orient2d(p, a, b) < 0;
}

// Joins directed edges with the material on their left into closed paths. If several paths meet in
// a point, each continues along the same material.
Result<Pslg> rings_of(std::vector<BorderEdge> edges) {
  std::sort(edges.begin(), edges.end());
  std::vector<char> is_used(edges.size(), 0);
  Pslg out;
  for (std::size_t first = 0; first < edges.size(); ++first) {
    Ring path;
    for (std::size_t e = first; !is_used[e];) {
      is_used[e] = 1;
      const auto [from, to] = edges[e];
      path.push_back(from);
      if (to == edges[first].from) {
        // The path is back at its start, where the first edge is a valid continuation.
        e = first;
        continue;
      }
      const auto low =
          std::lower_bound(edges.begin(), edges.end(), to,
                           [](const BorderEdge& f, LatticePoint p) { return f.from < p; });
      std::size_t best = edges.size();
      for (auto k = static_cast<std::size_t>(low - edges.begin());
           k < edges.size() && edges[k].from == to; ++k) {
        if (!is_used[k] &&
            (best == edges.size() || is_before_clockwise(to, from, edges[k].to, edges[best].to)))
          best = k;
      }
      if (best == edges.size()) return refused("the union's outline is open at " + to_text(to));
      e = best;
    }
    if (!path.empty()) split_at_pinches(path, out.rings);
  }
  for (Ring& ring : out.rings)
    std::rotate(ring.begin(), std::min_element(ring.begin(), ring.end()), ring.end());
  std::sort(out.rings.begin(), out.rings.end());
  return out;
}

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

Result<Pslg> check_shared_borders(std::span<const Pslg> regions, std::span<const Pslg> stored) {
  if (regions.size() != stored.size())
    return refused(std::to_string(stored.size()) + " stored outlines of " +
                   std::to_string(regions.size()) + " regions");
  std::vector<Border> borders;
  std::uint64_t area = 0;  // modulo 2^64, like the area of each region
  for (std::size_t k = 0; k < regions.size(); ++k) {
    if (regions[k].rings.size() != stored[k].rings.size())
      return refused("region " + std::to_string(k) + " has " +
                     std::to_string(stored[k].rings.size()) + " stored rings for " +
                     std::to_string(regions[k].rings.size()));
    for (std::size_t r = 0; r < regions[k].rings.size(); ++r) {
      if (auto ok = add_borders(k, regions[k].rings[r], stored[k].rings[r], borders); !ok)
        return ok.error();
    }
    area += static_cast<std::uint64_t>(doubled_area(stored[k]));
  }
  std::sort(borders.begin(), borders.end(),
            [](const Border& b, const Border& c) { return b.ends() < c.ends(); });
  std::vector<BorderEdge> outer;
  for (std::size_t i = 0; i < borders.size(); ++i) {
    const Border& b = borders[i];
    if (i > 0 && b.ends() == borders[i - 1].ends())
      return refused("two regions lie on the same side of an edge at " + to_text(b.from));
    const auto twin =
        std::lower_bound(borders.begin(), borders.end(), std::pair{b.to, b.from},
                         [](const Border& c, const auto& ends) { return c.ends() < ends; });
    if (twin == borders.end() || twin->ends() != std::pair{b.to, b.from}) {
      for (std::size_t j = 0; j < b.edges; ++j)
        outer.push_back({b.point(j), b.point(j + 1)});
      continue;
    }
    if (twin->region == b.region)
      return refused("a region lies on both sides of an edge at " + to_text(b.from));
    for (std::size_t j = 0; j <= b.edges; ++j) {
      if (j > twin->edges || b.point(j) != twin->point(twin->edges - j))
        return refused("two regions divide the edge that they share differently at " +
                       to_text(b.point(j)));
    }
  }
  auto outline = rings_of(std::move(outer));
  if (!outline) return outline;
  if (auto ok = check_pslg(*outline); !ok)
    return refused("the regions overlap: in the union's outline " + ok.error().message);
  const auto excess =
      static_cast<std::int64_t>(area - static_cast<std::uint64_t>(doubled_area(*outline)));
  if (excess != 0)
    return refused("the areas of the regions exceed that of their union by " +
                   std::to_string(excess) + " half squared steps");
  return outline;
}

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
