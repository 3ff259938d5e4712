// SPDX-License-Identifier: GPL-3.0-or-later
// Rings and sheets by CGAL's constrained Delaunay triangulation, to compare with.
#pragma once

#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>

#include <map>
#include <set>
#include <span>
#include <vector>

#include "tests/support/random_geometry.h"

namespace trocar::runtime {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using VertexBase = CGAL::Triangulation_vertex_base_with_info_2<std::uint32_t, Kernel>;
using FaceBase = CGAL::Constrained_triangulation_face_base_2<Kernel>;
using Data = CGAL::Triangulation_data_structure_2<VertexBase, FaceBase>;
using Cdt = CGAL::Constrained_Delaunay_triangulation_2<Kernel, Data>;

// Lattice integers are exact in a double, so the filtered kernel decides exactly.
inline Kernel::Point_2 to_cgal(LatticePoint p) {
  return {p.x, p.y};
}
inline LatticePoint from_cgal(const Kernel::Point_2& p) {
  return {static_cast<std::int32_t>(p.x()), static_cast<std::int32_t>(p.y())};
}

/// The faces that a walk from outside enters across an odd number of constraints.
inline std::set<Cdt::Face_handle> faces_inside(const Cdt& cdt) {
  std::map<Cdt::Face_handle, bool> is_inside{{cdt.infinite_face(), false}};
  std::vector<Cdt::Face_handle> stack{cdt.infinite_face()};
  std::set<Cdt::Face_handle> out;
  while (!stack.empty()) {
    const Cdt::Face_handle f = stack.back();
    stack.pop_back();
    const bool here = is_inside[f];
    if (here) out.insert(f);
    for (int i = 0; i < 3; ++i) {
      if (is_inside.emplace(f->neighbor(i), here != f->is_constrained(i)).second)
        stack.push_back(f->neighbor(i));
    }
  }
  return out;
}

/// The material of outline minus holes, with points in it.
inline SliceMesh mesh_of(const std::vector<Ring>& outline, const std::vector<LatticePoint>& inner) {
  Cdt cdt;
  for (const Ring& ring : outline) {
    for (std::size_t i = 0; i < ring.size(); ++i)
      cdt.insert_constraint(to_cgal(ring[i]), to_cgal(ring[(i + 1) % ring.size()]));
  }
  for (const LatticePoint p : inner)
    cdt.insert(to_cgal(p));  // on a constraint it splits it
  const std::set<Cdt::Face_handle> inside = faces_inside(cdt);
  SliceMesh mesh;
  std::map<LatticePoint, std::uint32_t> index;
  for (const Cdt::Face_handle f : cdt.finite_face_handles()) {
    if (!inside.contains(f)) continue;
    Triangle t{};
    for (int i = 0; i < 3; ++i) {
      const LatticePoint p = from_cgal(f->vertex(i)->point());
      const auto [at, is_new] =
          index.try_emplace(p, static_cast<std::uint32_t>(mesh.vertices.size()));
      if (is_new) mesh.vertices.push_back(p);
      t[static_cast<std::size_t>(i)] = at->second;
    }
    mesh.triangles.push_back(t);
  }
  return mesh;
}

/// Is the edge between two triangles a tie: four points on one circle?
inline bool is_tie(std::span<const LatticePoint> points, const Triangle& t, const Triangle& u) {
  int cocircular = 0;
  for (const std::uint32_t v : u)
    cocircular += in_circle(points[t[0]], points[t[1]], points[t[2]], points[v]) == 0 ? 1 : 0;
  return cocircular == 3;
}

}  // namespace trocar::runtime
