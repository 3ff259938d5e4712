// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/triangulation/regions.h"

#include <cstdint>
#include <utility>

#include "formats/base/disjoint_sets.h"

namespace trocar::pipeline {
namespace {

// One triangulation of all regions. Each region has its own vertices, as each side of a pinch has.
Triangulation joined(std::span<const Triangulation> regions) {
  Triangulation out;
  for (const Triangulation& region : regions) {
    const auto vertices = static_cast<std::uint32_t>(out.mesh.vertices.size());
    const auto triangles = static_cast<std::uint32_t>(out.mesh.triangles.size());
    out.mesh.vertices.insert(out.mesh.vertices.end(), region.mesh.vertices.begin(),
                             region.mesh.vertices.end());
    for (const Triangle& t : region.mesh.triangles)
      out.mesh.triangles.push_back({t[0] + vertices, t[1] + vertices, t[2] + vertices});
    for (std::array<EdgeId, 3> beyond : region.beyond) {
      for (EdgeId& e : beyond) {
        if (e != kNoEdge) e = edge_id(triangle_of(e) + triangles, index_of(e));
      }
      out.beyond.push_back(beyond);
    }
  }
  return out;
}

// The region of each vertex of the refined mesh. A region consists of one or more connected
// components of the mesh.
std::vector<std::uint32_t> regions_of_vertices(const Refined& refined,
                                               std::span<const Triangulation> regions) {
  // The smallest vertex of a component is its root, which is a vertex of the input.
  DisjointSets components(refined.mesh.vertices.size());
  for (const Triangle& t : refined.mesh.triangles) {
    components.join(t[0], t[1]);
    components.join(t[0], t[2]);
  }
  std::vector<std::uint32_t> out;
  out.reserve(components.size());
  for (std::uint32_t k = 0; k < regions.size(); ++k)
    out.insert(out.end(), regions[k].mesh.vertices.size(), k);
  for (auto v = static_cast<std::uint32_t>(out.size()); v < components.size(); ++v)
    out.push_back(out[components.root(v)]);
  return out;
}

std::vector<Refined> separated(const Refined& all, std::span<const Triangulation> regions) {
  const std::vector<std::uint32_t> region = regions_of_vertices(all, regions);
  std::vector<Refined> out(regions.size());
  for (Refined& r : out) {
    r.outcome = all.outcome;
    r.angle_deg = all.angle_deg;
    r.max_area_mm2 = all.max_area_mm2;
    r.bad_at_lattice_step = all.bad_at_lattice_step;
  }
  // Segments and vertices are numbered within their region, in the same order.
  std::vector<std::int32_t> segment;
  std::vector<std::uint32_t> vertex;
  for (std::size_t v = 0; v < region.size(); ++v) {
    SliceMesh& mesh = out[region[v]].mesh;
    vertex.push_back(static_cast<std::uint32_t>(mesh.vertices.size()));
    mesh.vertices.push_back(all.mesh.vertices[v]);
  }
  for (const Refined::Segment& s : all.segments) {
    std::vector<Refined::Segment>& segments = out[region[s.from]].segments;
    segment.push_back(static_cast<std::int32_t>(segments.size()));
    segments.push_back({vertex[s.from], vertex[s.to], s.previous, s.angle_at_from_deg});
  }
  for (Refined& r : out) {
    for (Refined::Segment& s : r.segments)
      s.previous = segment[static_cast<std::size_t>(s.previous)];
  }
  for (std::size_t v = 0; v < region.size(); ++v) {
    const std::int32_t s = all.origins[v].segment;
    out[region[v]].origins.push_back({s < 0 ? s : segment[static_cast<std::size_t>(s)]});
  }
  for (const Triangle& t : all.mesh.triangles)
    out[region[t[0]]].mesh.triangles.push_back({vertex[t[0]], vertex[t[1]], vertex[t[2]]});
  return out;
}

}  // namespace

Result<std::vector<Triangulation>> triangulate_regions(std::span<const Pslg> regions) {
  std::vector<Triangulation> out;
  for (const Pslg& region : regions) {
    auto triangulation = triangulate(region);
    if (!triangulation) return triangulation.error();
    out.push_back(std::move(*triangulation));
  }
  return out;
}

std::vector<Refined> refine_regions(std::span<const Triangulation> regions, const Lattice& lattice,
                                    const RefinementOptions& options) {
  RefinementOptions together = options;
  together.shared_borders = regions.size() > 1;
  if (regions.size() == 1) {
    std::vector<Refined> only;
    only.push_back(refine(regions[0], lattice, together));
    return only;
  }
  return separated(refine(joined(regions), lattice, together), regions);
}

}  // namespace trocar::pipeline
