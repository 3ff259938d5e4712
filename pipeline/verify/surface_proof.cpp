// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/verify/surface_proof.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Surface_mesh.h>

#include <algorithm>
#include <iterator>
#include <string>
#include <utility>

namespace trocar::pipeline {

Result<std::vector<std::size_t>> self_intersecting_triangles(const TriangleSurface& surface) {
  using KernelPoint = CGAL::Exact_predicates_inexact_constructions_kernel::Point_3;
  using Mesh = CGAL::Surface_mesh<KernelPoint>;
  Mesh mesh;
  std::vector<Mesh::Vertex_index> vertices;
  vertices.reserve(surface.vertices.size());
  for (const SpacePoint& p : surface.vertices)
    vertices.push_back(mesh.add_vertex(KernelPoint(p[0], p[1], p[2])));
  // The indices of the faces are those of the triangles, because every triangle becomes a face.
  for (std::size_t k = 0; k < surface.triangles.size(); ++k) {
    const auto& t = surface.triangles[k];
    if (mesh.add_face(vertices[t[0]], vertices[t[1]], vertices[t[2]]) == Mesh::null_face())
      return refused("triangle " + std::to_string(k) +
                     " does not fit together with those before it as a manifold");
  }

  std::vector<std::pair<Mesh::Face_index, Mesh::Face_index>> pairs;
  CGAL::Polygon_mesh_processing::self_intersections(mesh, std::back_inserter(pairs));
  std::vector<std::size_t> out;
  for (const auto& [a, b] : pairs) {
    out.push_back(a.idx());
    out.push_back(b.idx());
  }
  std::sort(out.begin(), out.end());
  out.erase(std::unique(out.begin(), out.end()), out.end());
  return out;
}

}  // namespace trocar::pipeline
