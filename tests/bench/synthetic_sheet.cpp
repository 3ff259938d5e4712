// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/synthetic_sheet.h"

#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>

#include <cmath>
#include <random>

namespace trocar::bench {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using VertexBase = CGAL::Triangulation_vertex_base_with_info_2<std::uint32_t, Kernel>;
using FaceBase = CGAL::Constrained_triangulation_face_base_2<Kernel>;
using Data = CGAL::Triangulation_data_structure_2<VertexBase, FaceBase>;
using Cdt = CGAL::Constrained_Delaunay_triangulation_2<Kernel, Data>;

}  // namespace

SliceMesh jittered_sheet(int vertices, int spacing, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const int columns = static_cast<int>(std::lround(std::sqrt(vertices * 0.866)));
  const int rows = vertices / columns;
  std::vector<Kernel::Point_2> points;
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      const bool rim = i == 0 || j == 0 || i + 1 == columns || j + 1 == rows;
      const auto jitter = [&] {
        return rim ? 0 : static_cast<int>(random() % 1024) * spacing / 2560 - spacing / 5;
      };
      const bool shifted = j % 2 == 1 && i > 0 && i + 1 < columns;
      const int x = i * spacing + (shifted ? spacing / 2 : 0) + jitter();
      points.emplace_back(x, std::lround(j * spacing * 0.866) + jitter());
    }
  }
  Cdt cdt;
  cdt.insert(points.begin(), points.end());
  SliceMesh mesh;
  for (auto v = cdt.finite_vertices_begin(); v != cdt.finite_vertices_end(); ++v) {
    v->info() = static_cast<std::uint32_t>(mesh.vertices.size());
    mesh.vertices.push_back(
        {static_cast<std::int32_t>(v->point().x()), static_cast<std::int32_t>(v->point().y())});
  }
  for (auto f = cdt.finite_faces_begin(); f != cdt.finite_faces_end(); ++f)
    mesh.triangles.push_back({f->vertex(0)->info(), f->vertex(1)->info(), f->vertex(2)->info()});
  return mesh;
}

CgalPslg slice_with_hole(const SliceMesh& sheet, const Ring& tool) {
  CgalPslg out;
  const auto add = [&out](const Ring& ring) {
    const auto first = static_cast<std::uint32_t>(out.points.size());
    const auto n = static_cast<std::uint32_t>(ring.size());
    for (std::uint32_t i = 0; i < n; ++i) {
      out.points.push_back({double(ring[i].x), double(ring[i].y)});
      out.segments.push_back({first + i, first + (i + 1) % n});
    }
  };
  for (const Ring& ring : boundary_rings(sheet).rings)
    add(ring);
  add(tool);
  for (const LatticePoint p : sheet.vertices)
    out.points.push_back({double(p.x), double(p.y)});
  return out;
}

CgalPslg local_pslg(const runtime::Overlay& overlay) {
  CgalPslg out;
  for (const LatticePoint p : overlay.points)
    out.points.push_back({double(p.x), double(p.y)});
  for (const runtime::Strand& strand : overlay.strands) {
    if (!strand.gone) out.segments.push_back({strand.a, strand.b});
  }
  return out;
}

std::size_t cgal_cdt(const CgalPslg& input) {
  std::vector<Kernel::Point_2> points;
  points.reserve(input.points.size());
  for (const auto& [x, y] : input.points)
    points.emplace_back(x, y);
  Cdt cdt;
  cdt.insert_constraints(points.begin(), points.end(), input.segments.begin(),
                         input.segments.end());
  return cdt.number_of_faces();
}

}  // namespace trocar::bench
