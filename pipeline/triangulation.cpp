// SPDX-License-Identifier: GPL-3.0-or-later
// The only file that includes CGAL.
#include "pipeline/triangulation.h"

#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Constrained_triangulation_face_base_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_face_base_with_info_2.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>

#include <algorithm>
#include <map>

namespace trocar::pipeline {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using VertexBase = CGAL::Triangulation_vertex_base_with_info_2<std::uint32_t, Kernel>;
using FaceBase = CGAL::Constrained_triangulation_face_base_2<
    Kernel, CGAL::Triangulation_face_base_with_info_2<int, Kernel>>;
using Cdt = CGAL::Constrained_Delaunay_triangulation_2<
    Kernel, CGAL::Triangulation_data_structure_2<VertexBase, FaceBase>,
    CGAL::No_constraint_intersection_requiring_constructions_tag>;

// Lattice integers are exact in a double, so the filtered kernel decides exactly.
Kernel::Point_2 to_cgal(LatticePoint p) {
  return {static_cast<double>(p.x), static_cast<double>(p.y)};
}

constexpr int kUnseen = -1;

// Floods from the infinite face; crossing a constraint changes sides.
void mark_material(Cdt& cdt) {
  for (const Cdt::Face_handle f : cdt.all_face_handles())
    f->info() = kUnseen;
  std::vector<Cdt::Face_handle> stack{cdt.infinite_face()};
  cdt.infinite_face()->info() = 0;
  while (!stack.empty()) {
    const Cdt::Face_handle f = stack.back();
    stack.pop_back();
    for (int i = 0; i < 3; ++i) {
      const Cdt::Face_handle g = f->neighbor(i);
      if (g->info() != kUnseen) continue;
      g->info() = f->info() ^ (f->is_constrained(i) ? 1 : 0);
      stack.push_back(g);
    }
  }
}

}  // namespace

SliceMesh split_pinches(SliceMesh mesh) {
  // Corners (triangle, k) around one vertex are joined across shared edges; each group is a fan.
  const std::size_t corners = mesh.triangles.size() * 3;
  std::vector<std::uint32_t> parent(corners);
  for (std::uint32_t i = 0; i < corners; ++i)
    parent[i] = i;
  const auto find = [&parent](std::uint32_t i) {
    while (parent[i] != i)
      i = parent[i] = parent[parent[i]];
    return i;
  };
  struct HalfEdge {
    std::uint32_t low, high, low_corner, high_corner;
  };
  std::vector<HalfEdge> edges;
  edges.reserve(corners);
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t a = 3 * t + i, b = 3 * t + (i + 1) % 3;
      const std::uint32_t va = mesh.triangles[t][i], vb = mesh.triangles[t][(i + 1) % 3];
      edges.push_back(va < vb ? HalfEdge{va, vb, a, b} : HalfEdge{vb, va, b, a});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const HalfEdge& e, const HalfEdge& f) {
    return std::tie(e.low, e.high, e.low_corner) < std::tie(f.low, f.high, f.low_corner);
  });
  for (std::size_t i = 0; i + 1 < edges.size(); ++i) {
    const HalfEdge &e = edges[i], &f = edges[i + 1];
    if (e.low != f.low || e.high != f.high) continue;
    parent[find(e.low_corner)] = find(f.low_corner);
    parent[find(e.high_corner)] = find(f.high_corner);
  }
  SliceMesh out;
  out.triangles = mesh.triangles;
  std::vector<std::uint32_t> vertex_of_fan(corners, 0xffffffff);
  for (std::uint32_t c = 0; c < corners; ++c) {
    const std::uint32_t fan = find(c), v = mesh.triangles[c / 3][c % 3];
    if (vertex_of_fan[fan] == 0xffffffff) {
      vertex_of_fan[fan] = static_cast<std::uint32_t>(out.vertices.size());
      out.vertices.push_back(mesh.vertices[v]);
    }
    out.triangles[c / 3][c % 3] = vertex_of_fan[fan];
  }
  return out;
}

Result<SliceMesh> triangulate(const Pslg& pslg) {
  SliceMesh mesh;
  if (pslg.rings.empty()) return mesh;
  // Touching rings share points.
  for (const Ring& ring : pslg.rings)
    mesh.vertices.insert(mesh.vertices.end(), ring.begin(), ring.end());
  std::sort(mesh.vertices.begin(), mesh.vertices.end());
  mesh.vertices.erase(std::unique(mesh.vertices.begin(), mesh.vertices.end()), mesh.vertices.end());

  Cdt cdt;
  std::vector<std::pair<Kernel::Point_2, std::uint32_t>> points;
  for (std::uint32_t v = 0; v < mesh.vertices.size(); ++v)
    points.emplace_back(to_cgal(mesh.vertices[v]), v);
  cdt.insert(points.begin(), points.end());
  std::vector<Cdt::Vertex_handle> handle(points.size());
  for (const Cdt::Vertex_handle v : cdt.finite_vertex_handles())
    handle[v->info()] = v;
  const auto handle_of = [&](LatticePoint p) {
    return handle[static_cast<std::size_t>(
        std::lower_bound(mesh.vertices.begin(), mesh.vertices.end(), p) - mesh.vertices.begin())];
  };
  try {
    for (const Ring& ring : pslg.rings) {
      for (std::size_t i = 0; i < ring.size(); ++i) {
        cdt.insert_constraint(handle_of(ring[i]), handle_of(ring[(i + 1) % ring.size()]));
      }
    }
  } catch (const Cdt::Intersection_of_constraints_exception&) {
    return bug("triangulation: the outline crosses itself");
  }
  mark_material(cdt);
  for (const Cdt::Face_handle f : cdt.finite_face_handles()) {
    if (f->info() == 1)
      mesh.triangles.push_back({f->vertex(0)->info(), f->vertex(1)->info(), f->vertex(2)->info()});
  }
  // CGAL's face order depends on its memory; ours must not.
  for (Triangle& t : mesh.triangles)
    std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
  std::sort(mesh.triangles.begin(), mesh.triangles.end());
  mesh = split_pinches(std::move(mesh));
  if (doubled_area(mesh) != doubled_area(pslg))
    return bug("triangulation: its area is not the outline's");
  return mesh;
}

}  // namespace trocar::pipeline
