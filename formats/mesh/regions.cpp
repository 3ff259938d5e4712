// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/regions.h"

#include <numeric>

#include "formats/base/disjoint_sets.h"

namespace trocar {
namespace {

// Finds the least vertex of the connected component of each vertex.
std::vector<std::uint32_t> components_of(const SliceMesh& mesh) {
  DisjointSets components(mesh.vertices.size());
  for (const Triangle& t : mesh.triangles) {
    components.join(t[0], t[1]);
    components.join(t[0], t[2]);
  }
  std::vector<std::uint32_t> out(components.size());
  for (std::uint32_t v = 0; v < out.size(); ++v)
    out[v] = components.root(v);
  return out;
}

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

constexpr double kVerticesPerCell = 8;

// The new number of each vertex.
std::vector<std::uint32_t> numbers_by_position(const std::vector<LatticePoint>& vertices) {
  const LatticeCells cells(box_around(vertices),
                           std::max(1.0, static_cast<double>(vertices.size()) / kVerticesPerCell));
  const auto columns = static_cast<std::size_t>(cells.columns);
  std::vector<std::uint32_t> out, first(cells.count() + 1, 0);
  out.reserve(vertices.size());
  for (const LatticePoint p : vertices) {
    const double x = static_cast<double>(p.x) - cells.low.x,
                 y = static_cast<double>(p.y) - cells.low.y;
    const std::size_t at = static_cast<std::size_t>(y / cells.size) * columns +
                           static_cast<std::size_t>(x / cells.size);
    out.push_back(static_cast<std::uint32_t>(at));
    ++first[at + 1];
  }
  std::partial_sum(first.begin(), first.end(), first.begin());
  for (std::uint32_t& v : out)
    v = first[v]++;
  return out;
}

}  // namespace

template <typename GroupOf>
ComponentGroups::List ComponentGroups::listed(std::size_t count, std::size_t groups,
                                              const GroupOf& group_of) {
  List out;
  out.first.assign(groups + 1, 0);
  out.items.resize(count);
  for (std::uint32_t i = 0; i < count; ++i)
    ++out.first[group_of(i) + 1];
  std::partial_sum(out.first.begin(), out.first.end(), out.first.begin());
  std::vector<std::uint32_t> end(out.first.begin(), out.first.end() - 1);
  for (std::uint32_t i = 0; i < count; ++i)
    out.items[end[group_of(i)]++] = i;
  return out;
}

ComponentGroups::ComponentGroups(const SliceMesh& mesh)
    : mesh_(mesh), component_(components_of(mesh)), number_(mesh.vertices.size()) {
  // Both are indexed by the least vertex of the component.
  std::vector<std::uint32_t> size(component_.size(), 0), group(component_.size(), 0);
  for (const std::uint32_t component : component_)
    ++size[component];
  std::uint32_t filled = 0, last = 0;
  for (const std::uint32_t component : component_) {
    if (size[component] == 0) continue;
    if (filled != 0 && filled + size[component] > kMaxVertices) ++last, filled = 0;
    group[component] = last;
    filled += std::exchange(size[component], 0);
  }
  const auto group_of = [&](std::uint32_t v) { return group[component_[v]]; };
  vertices_ = listed(component_.size(), last + 1, group_of);
  triangles_ = listed(mesh.triangles.size(), last + 1,
                      [&](std::uint32_t t) { return group_of(mesh.triangles[t][0]); });
}

const ComponentGroups::Group& ComponentGroups::group(std::size_t g) {
  group_.vertices = vertices_.of(g);
  group_.triangles = triangles_.of(g);
  group_.mesh.vertices.clear();
  group_.mesh.triangles.clear();
  group_.component.clear();
  for (const std::uint32_t v : group_.vertices) {
    number_[v] = static_cast<std::uint32_t>(group_.mesh.vertices.size());
    group_.mesh.vertices.push_back(mesh_.vertices[v]);
  }
  for (const std::uint32_t v : group_.vertices)
    group_.component.push_back(number_[component_[v]]);
  for (const std::uint32_t t : group_.triangles) {
    const Triangle& v = mesh_.triangles[t];
    group_.mesh.triangles.push_back({number_[v[0]], number_[v[1]], number_[v[2]]});
  }
  return group_;
}

double fill_edge(double doubled_area) {
  return std::sqrt(2 / std::numbers::sqrt3 * doubled_area);
}

void list_fill_nodes(const RefinementMesh& mesh, double doubled_area, double triangles,
                     std::vector<FillNode>& nodes) {
  nodes.clear();
  const double edge = fill_edge(doubled_area);
  const auto dx = 2 * static_cast<std::int64_t>(edge / 2),
             dy = static_cast<std::int64_t>(doubled_area / static_cast<double>(dx));
  // All points are relative to this one, so that the mesh moves with its outline.
  LatticePoint o = mesh.points[0];
  for (const LatticePoint p : mesh.points)
    o = {std::min(o.x, p.x), std::min(o.y, p.y)};
  // This bounds the running time for any outline; the lattice need not be complete.
  auto rows_left =
      static_cast<std::int64_t>(16 * (triangles + static_cast<double>(mesh.points.size())));
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const std::array<std::uint32_t, 3>& v = mesh.triangles[t].v;
    const LatticePoint a = mesh.points[v[0]], b = mesh.points[v[1]], c = mesh.points[v[2]];
    if (static_cast<double>(orient2d(a, b, c)) <= doubled_area) continue;
    const std::int64_t low = std::min({a.y, b.y, c.y}) - std::int64_t{o.y},
                       high = std::max({a.y, b.y, c.y}) - std::int64_t{o.y};
    for (std::int64_t row = (low + dy - 1) / dy; row * dy <= high; ++row) {
      if (--rows_left < 0) return;
      const std::int64_t y = row * dy, shift = row % 2 * (dx / 2);
      double from = std::numeric_limits<double>::max(), to = -from;
      for (const auto& [p, q] : {std::pair{a, b}, std::pair{b, c}, std::pair{c, a}}) {
        const auto px = static_cast<double>(std::int64_t{p.x} - o.x),
                   py = static_cast<double>(std::int64_t{p.y} - o.y - y),
                   qx = static_cast<double>(std::int64_t{q.x} - o.x),
                   qy = static_cast<double>(std::int64_t{q.y} - o.y - y);
        if ((py < 0) == (qy < 0)) continue;
        const double x = px + (qx - px) * (py / (py - qy));
        from = std::min(from, x), to = std::max(to, x);
      }
      if (from > to) continue;  // the row touches the triangle's highest corner
      const auto step = static_cast<double>(dx), first = static_cast<double>(shift);
      for (auto column = static_cast<std::int64_t>(std::ceil((from - first) / step));
           static_cast<double>(shift + column * dx) <= to; ++column)
        nodes.push_back({t,
                         {static_cast<std::int32_t>(o.x + shift + column * dx),
                          static_cast<std::int32_t>(o.y + y)}});
    }
  }
}

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

void sort_by_position(Refined& refined) {
  if (refined.mesh.vertices.empty()) return;
  const std::vector<std::uint32_t> number = numbers_by_position(refined.mesh.vertices);
  std::vector<LatticePoint> vertices(number.size());
  std::vector<VertexOrigin> origins(number.size());
  for (std::size_t v = 0; v < number.size(); ++v) {
    vertices[number[v]] = refined.mesh.vertices[v];
    origins[number[v]] = refined.origins[v];
  }
  refined.mesh.vertices = std::move(vertices);
  refined.origins = std::move(origins);
  for (Refined::Segment& s : refined.segments)
    s.from = number[s.from], s.to = number[s.to];

  std::vector<std::uint32_t> first(number.size() + 1, 0);
  for (Triangle& t : refined.mesh.triangles) {
    for (std::uint32_t& v : t)
      v = number[v];
    ++first[std::min({t[0], t[1], t[2]}) + 1];
  }
  std::partial_sum(first.begin(), first.end(), first.begin());
  std::vector<Triangle> triangles(refined.mesh.triangles.size());
  for (const Triangle& t : refined.mesh.triangles)
    triangles[first[std::min({t[0], t[1], t[2]})]++] = t;
  refined.mesh.triangles = std::move(triangles);
}

}  // namespace trocar
