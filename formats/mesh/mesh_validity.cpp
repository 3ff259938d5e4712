// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/mesh_validity.h"

#include "formats/mesh/edge_table.h"
#include "formats/mesh/outline_sweep.h"
#include "formats/mesh/predicates.h"

namespace trocar {
namespace {

// Checks each ring by itself.
Result<void> check_rings(const Pslg& pslg) {
  for (const Ring& ring : pslg.rings) {
    if (ring.size() < 3) return refused("a ring of fewer than three vertices");
    for (const LatticePoint p : ring) {
      if (!is_on_lattice(p)) return refused("outline outside the lattice's range at " + to_text(p));
    }
    Ring sorted = ring;
    std::sort(sorted.begin(), sorted.end());
    const auto twice = std::adjacent_find(sorted.begin(), sorted.end());
    if (twice != sorted.end()) return refused("a ring with a vertex twice at " + to_text(*twice));
  }
  return {};
}

// Checks the nesting of rings whose edges do not cross. `first` has the index of each ring's first
// edge.
Result<void> check_nesting(const Pslg& pslg, const EdgeLoops& loops,
                           const std::vector<std::uint32_t>& first,
                           const std::vector<std::uint32_t>& order) {
  std::vector<std::int32_t> right_of;
  sweep(loops, order, {}, &right_of);
  for (std::size_t r = 0; r < pslg.rings.size(); ++r) {
    if (right_of[first[r]] == 0) continue;
    const bool is_outer = doubled_area(pslg.rings[r]) > 0;
    return refused(
        (is_outer ? "an outer ring inside material at " : "a hole outside material at ") +
        to_text(pslg.rings[r][0]));
  }
  // Every ring nests correctly at its first edge, but rings that touch may cross farther along.
  const auto bad = std::find_if(right_of.begin(), right_of.end(),
                                [](std::int32_t winding) { return winding != 0; });
  if (bad == right_of.end()) return {};
  return refused("rings that touch and overlap, near an edge at " +
                 to_text(loops.points[static_cast<std::size_t>(bad - right_of.begin())]));
}

// Neighbours in a mesh whose triangles and edges are valid.
struct Manifold {
  std::vector<std::uint32_t> next;  // next vertex along the boundary, or kNotOnBoundary
  std::int64_t doubled_area = 0;
  bool is_delaunay = true;
};

LatticePoint corner(const SliceMesh& mesh, std::uint32_t edge) {
  return mesh.vertices[mesh.triangles[edge / 3][edge % 3]];
}
std::uint32_t next_edge(std::uint32_t edge) {
  return edge % 3 == 2 ? edge - 2 : edge + 1;
}
std::uint32_t previous_edge(std::uint32_t edge) {
  return edge % 3 == 0 ? edge + 2 : edge - 1;
}

// The edge bc between the triangles abc and dcb.
bool is_edge_delaunay(const SliceMesh& mesh, std::uint32_t edge, std::uint32_t other) {
  return is_locally_delaunay(corner(mesh, previous_edge(edge)), corner(mesh, edge),
                             corner(mesh, next_edge(edge)), corner(mesh, previous_edge(other)));
}

// Proves what check_mesh() proves, except that the boundary does not cross itself. Determines
// `is_delaunay` only if `delaunay_too` is set.
Result<Manifold> check_manifold(const SliceMesh& mesh, bool delaunay_too) {
  const std::size_t n = mesh.vertices.size();
  Manifold out;
  for (LatticePoint p : mesh.vertices) {
    if (!is_on_lattice(p)) return refused("vertex outside the lattice's range at " + to_text(p));
  }
  std::vector<std::uint32_t> degree(n, 0),
      any_edge(n, kNotOnBoundary);  // degree of each vertex, and an edge that starts there
  std::uint64_t area = 0;           // modulo 2^64
  for (std::size_t k = 0; k < mesh.triangles.size(); ++k) {
    const Triangle& t = mesh.triangles[k];
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t v = t[i];
      if (v >= n)
        return refused("triangle with vertex index " + std::to_string(v) + " of " +
                       std::to_string(n));
      ++degree[v];
      any_edge[v] = static_cast<std::uint32_t>(3 * k + i);
    }
    const std::int64_t doubled =
        orient2d(mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]);
    if (doubled <= 0)
      return refused("triangle without positive area at " + to_text(mesh.vertices[t[0]]));
    area += static_cast<std::uint64_t>(doubled);
  }
  out.doubled_area = static_cast<std::int64_t>(area);
  for (std::size_t v = 0; v < n; ++v) {
    if (degree[v] == 0) return refused("unused vertex at " + to_text(mesh.vertices[v]));
  }

  // beyond[e] is the same edge in the triangle on its other side.
  std::vector<std::uint32_t> beyond(mesh.triangles.size() * 3, kNotOnBoundary);
  out.next.assign(n, kNotOnBoundary);
  Result<void> ok;
  const auto starts_at = [&mesh](std::uint32_t edge) { return mesh.triangles[edge / 3][edge % 3]; };
  edge_table(mesh).for_each_pair([&](std::uint32_t low, std::uint32_t high, const auto& edges) {
    const std::uint32_t edge = edges[0].edge, from = starts_at(edge);
    if (edges.size() == 1) {
      if (out.next[from] != kNotOnBoundary) {
        ok = refused("two fans of triangles share a vertex at " + to_text(mesh.vertices[from]));
        return false;
      }
      out.next[from] = from == low ? high : low;
      any_edge[from] = edge;
      return true;
    }
    const std::uint32_t other = edges[1].edge;
    if (edges.size() > 2 || from == starts_at(other)) {
      const bool from_low = std::any_of(edges.begin(), edges.end(),
                                        [&](const auto& e) { return starts_at(e.edge) == low; });
      ok = refused("edge used twice in one direction at " +
                   to_text(mesh.vertices[from_low ? low : high]));
      return false;
    }
    beyond[edge] = other;
    beyond[other] = edge;
    if (delaunay_too && out.is_delaunay) out.is_delaunay = is_edge_delaunay(mesh, edge, other);
    return true;
  });
  if (!ok) return ok.error();
  // The triangles at each vertex form one fan: a walk from one to the next across their common
  // edge, starting at the boundary edge if there is one, meets all of them. (Comparing the numbers
  // of triangles and edges at a vertex would miss a closed fan beside another fan.)
  for (std::size_t v = 0; v < n; ++v) {
    std::uint32_t in_fan = 0, edge = any_edge[v];
    do {
      ++in_fan;
      edge = beyond[previous_edge(edge)];
    } while (edge != kNotOnBoundary && edge != any_edge[v]);
    if (in_fan != degree[v])
      return refused("several fans of triangles share a vertex at " + to_text(mesh.vertices[v]));
  }
  return out;
}

Result<void> check_boundary(const SliceMesh& mesh, const Manifold& manifold) {
  EdgeLoops loops;
  for (const Ring& ring : rings_along(mesh, manifold.next).rings)
    loops.add(ring);
  const std::vector<std::uint32_t> order = in_sweep_order(loops.points);
  return check_no_crossing(loops, order, sweep(loops, order), "boundary edges");
}

using Edge = std::pair<LatticePoint, LatticePoint>;

std::vector<Edge> sorted_edges(const std::vector<Ring>& rings) {
  std::vector<Edge> edges;
  for (const Ring& ring : rings) {
    for (std::size_t i = 0, n = ring.size(); i < n; ++i)
      edges.emplace_back(ring[i], ring[i + 1 == n ? 0 : i + 1]);
  }
  std::sort(edges.begin(), edges.end());
  return edges;
}

// Does the boundary have exactly the outline's edges, each once? Usually the outline is
// boundary_rings(mesh), and its rings are compared in order; otherwise sorted edges are compared.
Result<void> check_same_edges(const SliceMesh& mesh, const Manifold& manifold, const Pslg& pslg) {
  const Pslg boundary = rings_along(mesh, manifold.next);
  if (boundary.rings == pslg.rings) return {};
  const std::vector<Edge> of_mesh = sorted_edges(boundary.rings),
                          of_pslg = sorted_edges(pslg.rings);
  if (of_mesh == of_pslg) return {};
  const auto [m, p] = std::mismatch(of_mesh.begin(), of_mesh.end(), of_pslg.begin(), of_pslg.end());
  return refused("the mesh's boundary and the outline differ at " +
                 to_text(m != of_mesh.end() ? m->first : p->first));
}

Result<void> check_areas(const Manifold& manifold, const Pslg& pslg) {
  const std::int64_t excess = manifold.doubled_area - doubled_area(pslg);
  if (excess == 0) return {};
  return refused("the areas of mesh and outline differ by " + std::to_string(excess) +
                 " half squared steps");
}

Result<void> check_against_outline(const SliceMesh& mesh, const ProvedOutline& outline,
                                   bool delaunay_too) {
  const auto manifold = check_manifold(mesh, delaunay_too);
  if (!manifold) return manifold.error();
  if (auto differ = check_same_edges(mesh, *manifold, outline.pslg()); !differ) {
    // Crossing edges are the more serious defect, so they are reported first. The outline has none.
    if (auto ok = check_boundary(mesh, *manifold); !ok) return ok;
    return differ;
  }
  if (auto ok = check_areas(*manifold, outline.pslg()); !ok) return ok;
  if (!manifold->is_delaunay) return refused("not constrained Delaunay");
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
  const auto manifold = check_manifold(mesh, false);
  if (!manifold) return manifold.error();
  return check_boundary(mesh, *manifold);
}

Result<void> check_pslg(const Pslg& pslg) {
  EdgeLoops loops;
  std::vector<std::uint32_t> first;  // first edge of each ring
  for (const Ring& ring : pslg.rings) {
    if (ring.size() < 3 || !std::all_of(ring.begin(), ring.end(), is_on_lattice))
      return check_rings(pslg);
    first.push_back(static_cast<std::uint32_t>(loops.points.size()));
    loops.add(ring);
  }
  const std::vector<std::uint32_t> order = in_sweep_order(loops.points);
  const auto ring_of = [&first](std::uint32_t edge) {
    return std::upper_bound(first.begin(), first.end(), edge);
  };
  for (std::size_t i = 1; i < order.size(); ++i) {
    if (loops.points[order[i - 1]] == loops.points[order[i]] &&
        ring_of(order[i - 1]) == ring_of(order[i]))
      return check_rings(pslg);
  }
  const SweepResult swept = sweep(loops, order);
  if (auto ok = check_no_crossing(loops, order, swept, "outline edges"); !ok) return ok;
  return swept.winds_once ? Result<void>() : check_nesting(pslg, loops, first, order);
}

Result<ProvedOutline> ProvedOutline::of(Pslg pslg) {
  if (auto ok = check_pslg(pslg); !ok) return ok.error();
  return ProvedOutline(std::move(pslg));
}

Result<void> check_mesh_against_pslg(const SliceMesh& mesh, const Pslg& pslg) {
  const auto manifold = check_manifold(mesh, false);
  if (!manifold) return manifold.error();
  auto same = check_same_edges(mesh, *manifold, pslg);
  auto valid = check_pslg(pslg);
  // The boundary has the edges of a valid outline, so it does not cross itself.
  if (!same || !valid) {
    if (auto ok = check_boundary(mesh, *manifold); !ok) return ok;
  }
  if (!valid) return valid;
  if (!same) return same;
  return check_areas(*manifold, pslg);
}

Result<void> check_mesh_against_outline(const SliceMesh& mesh, const ProvedOutline& outline) {
  return check_against_outline(mesh, outline, false);
}

Result<void> check_delaunay_mesh(const SliceMesh& mesh, const ProvedOutline& outline) {
  return check_against_outline(mesh, outline, true);
}

bool is_constrained_delaunay(const SliceMesh& mesh) {
  bool out = true;
  edge_table(mesh).for_each_pair([&](std::uint32_t, std::uint32_t, const auto& edges) {
    if (edges.size() == 2) out = is_edge_delaunay(mesh, edges[0].edge, edges[1].edge);
    return out;
  });
  return out;
}

}  // namespace trocar
