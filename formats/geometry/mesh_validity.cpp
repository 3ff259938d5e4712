// SPDX-License-Identifier: Apache-2.0
#include "formats/geometry/mesh_validity.h"

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <tuple>
#include <utility>
#include <vector>

#include "formats/geometry/edge_predicates.h"
#include "formats/geometry/edge_table.h"
#include "formats/geometry/lattice_box.h"
#include "formats/geometry/triangle_edge.h"

namespace trocar {
namespace {

std::string place(LatticePoint p) {
  return "at lattice point (" + std::to_string(p.x) + ", " + std::to_string(p.y) + ")";
}

struct SweepSegment {
  LatticePoint a, b;
  std::int32_t min_x() const { return std::min(a.x, b.x); }
  std::int32_t max_x() const { return std::max(a.x, b.x); }
};

// Sweeps over x with a simple active list. O(n (log n + k)), where k segments overlap one in x:
// fast enough for outlines of some thousand edges.
Result<void> check_no_crossing(std::vector<SweepSegment> segments, const char* what) {
  std::sort(segments.begin(), segments.end(), [](const SweepSegment& s, const SweepSegment& t) {
    return std::tuple{s.min_x(), s.a, s.b} < std::tuple{t.min_x(), t.a, t.b};
  });
  std::vector<const SweepSegment*> active;
  for (const SweepSegment& s : segments) {
    const std::int32_t x = s.min_x();
    std::erase_if(active, [x](const SweepSegment* o) { return o->max_x() < x; });
    const auto [lo, hi] = std::minmax(s.a.y, s.b.y);
    for (const SweepSegment* o : active) {
      if (std::max(o->a.y, o->b.y) < lo || std::min(o->a.y, o->b.y) > hi) continue;
      if (segments_cross(s.a, s.b, o->a, o->b)) {
        return refused(std::string(what) + " cross near " + place(s.a).substr(3));
      }
    }
    active.push_back(&s);
  }
  return {};
}

// For each ring, how often the others wind around the middle of its first edge, which lies on none
// of them since nothing crosses. Sweeps over x, so that each point is compared only with the rings
// above and below it.
std::vector<int> windings_around(const std::vector<Ring>& rings,
                                 const std::vector<LatticeBox>& boxes,
                                 const std::vector<int>& orientations) {
  const auto middle_x = [&rings](std::size_t r) {
    return std::int64_t{rings[r][0].x} + rings[r][1].x;
  };
  std::vector<std::size_t> by_middle(rings.size());
  std::iota(by_middle.begin(), by_middle.end(), std::size_t{0});
  std::vector<std::size_t> by_low = by_middle;
  std::sort(by_middle.begin(), by_middle.end(),
            [&middle_x](std::size_t r, std::size_t q) { return middle_x(r) < middle_x(q); });
  std::sort(by_low.begin(), by_low.end(),
            [&boxes](std::size_t r, std::size_t q) { return boxes[r].low.x < boxes[q].low.x; });

  std::vector<int> windings(rings.size(), 0);
  std::vector<std::size_t> active;
  auto next = by_low.begin();
  for (const std::size_t r : by_middle) {
    const std::int64_t px = middle_x(r), py = std::int64_t{rings[r][0].y} + rings[r][1].y;
    for (; next != by_low.end() && 2 * std::int64_t{boxes[*next].low.x} <= px; ++next)
      active.push_back(*next);
    std::erase_if(active,
                  [&boxes, px](std::size_t q) { return 2 * std::int64_t{boxes[q].high.x} < px; });
    for (const std::size_t q : active) {
      if (q == r || py < 2 * std::int64_t{boxes[q].low.y} || py > 2 * std::int64_t{boxes[q].high.y})
        continue;
      if (is_inside_ring(px, py, rings[q])) windings[r] += orientations[q];
    }
  }
  return windings;
}

Result<void> check_nesting(const std::vector<Ring>& rings) {
  std::vector<LatticeBox> boxes;
  std::vector<int> orientations;
  for (const Ring& ring : rings) {
    boxes.push_back(box_around(ring));
    const std::int64_t area = doubled_area(ring);
    if (area == 0) return refused("a ring without area " + place(ring[0]));
    orientations.push_back(area > 0 ? 1 : -1);
  }
  const std::vector<int> windings = windings_around(rings, boxes, orientations);
  for (std::size_t r = 0; r < rings.size(); ++r) {
    const int wanted = orientations[r] > 0 ? 0 : 1;
    if (windings[r] != wanted) {
      return refused((wanted == 0 ? "an outer ring inside material " : "a hole outside material ") +
                     place(rings[r][0]));
    }
  }
  return {};
}

}  // namespace

bool is_inside_ring(std::int64_t px, std::int64_t py, const Ring& ring) {
  bool inside = false;
  for (std::size_t i = 0, n = ring.size(); i < n; ++i) {
    LatticePoint a = ring[i], b = ring[i + 1 == n ? 0 : i + 1];
    if ((2 * std::int64_t{a.y} > py) == (2 * std::int64_t{b.y} > py)) continue;
    if (a.y > b.y) std::swap(a, b);
    const Int128 orientation = Int128{std::int64_t{b.x} - a.x} * (py - 2 * std::int64_t{a.y}) -
                               Int128{std::int64_t{b.y} - a.y} * (px - 2 * std::int64_t{a.x});
    if (orientation > 0) inside = !inside;
  }
  return inside;
}

Result<void> check_mesh(const SliceMesh& mesh) {
  const std::size_t n = mesh.vertices.size();
  for (LatticePoint p : mesh.vertices) {
    if (!is_on_lattice(p)) return refused("vertex outside the lattice's range " + place(p));
  }
  std::vector<std::uint32_t> degree(n, 0);
  for (const Triangle& t : mesh.triangles) {
    for (std::uint32_t v : t) {
      if (v >= n)
        return refused("triangle with vertex index " + std::to_string(v) + " of " +
                       std::to_string(n));
      ++degree[v];
    }
    if (orient2d(mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]) <= 0) {
      return refused("triangle without positive area " + place(mesh.vertices[t[0]]));
    }
  }
  for (std::size_t v = 0; v < n; ++v) {
    if (degree[v] == 0) return refused("unused vertex " + place(mesh.vertices[v]));
  }

  const std::vector<DirectedEdge> edges = sorted_edges(mesh);
  std::vector<SweepSegment> boundary;
  std::vector<std::uint32_t> boundary_out(n, 0);
  for (std::size_t i = 0; i < edges.size();) {
    std::size_t j = i + 1;
    while (j < edges.size() && edges[j].key() == edges[i].key())
      ++j;
    if (j - i > 2 || (j - i == 2 && edges[i].from == edges[i + 1].from)) {
      return refused("edge used twice in one direction " + place(mesh.vertices[edges[i].from]));
    }
    if (j - i == 1) {
      boundary.push_back({mesh.vertices[edges[i].from], mesh.vertices[edges[i].to]});
      if (++boundary_out[edges[i].from] > 1) {
        return refused("two fans of triangles share a vertex " +
                       place(mesh.vertices[edges[i].from]));
      }
    }
    i = j;
  }
  // One fan at each vertex: the corners at it are connected across interior edges. (Comparing the
  // numbers of triangles and edges at a vertex would miss a closed fan beside another fan.)
  {
    // Union-find of triangle corners.
    std::vector<std::uint32_t> parent(mesh.triangles.size() * 3);
    for (std::uint32_t i = 0; i < parent.size(); ++i)
      parent[i] = i;
    auto find = [&parent](std::uint32_t i) {
      while (parent[i] != i)
        i = parent[i] = parent[parent[i]];
      return i;
    };
    auto corner = [&mesh](std::uint32_t t, std::uint32_t v) {
      return t * 3 + corner_of(mesh.triangles[t], v);
    };
    std::vector<std::uint32_t> fans = degree;
    for (std::size_t i = 0; i + 1 < edges.size(); ++i) {
      if (edges[i].key() != edges[i + 1].key()) continue;
      for (std::uint32_t v : {edges[i].from, edges[i].to}) {
        const std::uint32_t a = find(corner(edges[i].triangle, v));
        const std::uint32_t b = find(corner(edges[i + 1].triangle, v));
        if (a != b) {
          parent[a] = b;
          --fans[v];
        }
      }
    }
    for (std::size_t v = 0; v < n; ++v) {
      if (fans[v] != 1)
        return refused("several fans of triangles share a vertex " + place(mesh.vertices[v]));
    }
  }
  return check_no_crossing(std::move(boundary), "boundary edges");
}

Result<void> check_pslg(const Pslg& pslg) {
  std::vector<SweepSegment> segments;
  for (const Ring& ring : pslg.rings) {
    if (ring.size() < 3) return refused("a ring of fewer than three vertices");
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const LatticePoint a = ring[i], b = ring[(i + 1) % ring.size()];
      if (!is_on_lattice(a)) return refused("outline outside the lattice's range " + place(a));
      segments.push_back({a, b});
    }
    Ring sorted = ring;
    std::sort(sorted.begin(), sorted.end());
    const auto twice = std::adjacent_find(sorted.begin(), sorted.end());
    if (twice != sorted.end()) return refused("a ring with a vertex twice " + place(*twice));
  }
  if (auto ok = check_no_crossing(std::move(segments), "outline edges"); !ok) return ok;
  return check_nesting(pslg.rings);
}

Result<void> check_mesh_against_pslg(const SliceMesh& mesh, const Pslg& pslg) {
  if (auto ok = check_mesh(mesh); !ok) return ok;
  if (auto ok = check_pslg(pslg); !ok) return ok;
  using Edge = std::pair<LatticePoint, LatticePoint>;
  auto edges_of = [](const Pslg& p) {
    std::vector<Edge> edges;
    for (const Ring& ring : p.rings) {
      for (std::size_t i = 0; i < ring.size(); ++i) {
        edges.emplace_back(ring[i], ring[(i + 1) % ring.size()]);
      }
    }
    std::sort(edges.begin(), edges.end());
    return edges;
  };
  const std::vector<Edge> of_mesh = edges_of(boundary_rings(mesh)), of_pslg = edges_of(pslg);
  if (of_mesh != of_pslg) {
    const auto [m, p] =
        std::mismatch(of_mesh.begin(), of_mesh.end(), of_pslg.begin(), of_pslg.end());
    const LatticePoint where = m != of_mesh.end() ? m->first : p->first;
    return refused("the mesh's boundary and the outline differ " + place(where));
  }
  if (doubled_area(mesh) != doubled_area(pslg)) {
    return refused("the areas of mesh and outline differ by " +
                   std::to_string(doubled_area(mesh) - doubled_area(pslg)) + " half squared steps");
  }
  return {};
}

bool is_constrained_delaunay(const SliceMesh& mesh) {
  const std::vector<DirectedEdge> edges = sorted_edges(mesh);
  for (std::size_t i = 0; i + 1 < edges.size(); ++i) {
    if (edges[i].key() != edges[i + 1].key()) continue;
    const Triangle& t = mesh.triangles[edges[i].triangle];
    const Triangle& u = mesh.triangles[edges[i + 1].triangle];
    for (std::uint32_t v : u) {
      if (v == edges[i].from || v == edges[i].to) continue;
      if (in_circle(mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]],
                    mesh.vertices[v]) > 0) {
        return false;
      }
    }
  }
  return true;
}

}  // namespace trocar
