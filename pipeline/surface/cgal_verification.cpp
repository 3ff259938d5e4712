// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/surface/cgal_verification.h"

#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Constrained_triangulation_face_base_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_2_algorithms.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Triangulation_data_structure_2.h>
#include <CGAL/Triangulation_face_base_with_info_2.h>
#include <CGAL/Triangulation_vertex_base_2.h>
#include <iterator>
#include <map>
#include <set>

namespace trocar::pipeline {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;  // integers are represented
                                                                     // exactly
using Point = Kernel::Point_2;
/// The depth of a face is the number of outline edges between it and the outside; -1: not yet
/// known.
using FaceBase = CGAL::Constrained_triangulation_face_base_2<
    Kernel, CGAL::Triangulation_face_base_with_info_2<int, Kernel>>;
using Tds =
    CGAL::Triangulation_data_structure_2<CGAL::Triangulation_vertex_base_2<Kernel>, FaceBase>;
using Cdt = CGAL::Constrained_Delaunay_triangulation_2<
    Kernel, Tds, CGAL::No_constraint_intersection_requiring_constructions_tag>;
using Edge = std::pair<std::uint32_t, std::uint32_t>;

Point point_of(const LatticePoint& p) {
  return {static_cast<double>(p.x), static_cast<double>(p.y)};
}

std::string text_of(const LatticePoint& p) {
  std::string out = "(";
  return out.append(std::to_string(p.x)).append(", ").append(std::to_string(p.y)).append(")");
}

Result<void> check_rings(const Pslg& outline) {
  for (const Ring& ring : outline.rings) {
    if (ring.size() < 3) return refused("a ring has fewer than three points");
    std::vector<Point> points;
    for (const LatticePoint& p : ring)
      points.push_back(point_of(p));
    if (!CGAL::is_simple_2(points.begin(), points.end(), Kernel{}))
      return refused("the ring from " + text_of(ring[0]) + " is not a simple polygon");
  }
  return {};
}

// CGAL's triangulation of the mesh's vertices, with the outline's edges as constraints.
class Triangulated {
 public:
  Result<void> build(const AssetSlice& slice) {
    for (const LatticePoint& p : slice.mesh.vertices)
      vertex_.try_emplace(p, cdt_.insert(point_of(p)));
    std::size_t edges = 0;
    for (const Ring& ring : slice.pslg.rings) {
      for (std::size_t i = 0; i < ring.size(); ++i, ++edges) {
        const LatticePoint &a = ring[i], &b = ring[(i + 1) % ring.size()];
        const auto from = vertex_.find(a), to = vertex_.find(b);
        if (from == vertex_.end() || to == vertex_.end())
          return refused("the outline's edge from " + text_of(a) +
                         " ends beside the mesh's vertices");
        try {
          cdt_.insert_constraint(from->second, to->second);
        } catch (const Cdt::Intersection_of_constraints_exception&) {
          return refused("the outline's edge from " + text_of(a) + " to " + text_of(b) +
                         " crosses another");
        }
      }
    }
    if (cdt_.dimension() < 2) return refused("all of its vertices lie on one line");
    // A vertex on an edge splits it, and an edge given twice counts once.
    const auto constrained =
        std::count_if(cdt_.finite_edges_begin(), cdt_.finite_edges_end(),
                      [this](const Cdt::Edge& e) { return cdt_.is_constrained(e); });
    if (static_cast<std::size_t>(constrained) != edges)
      return refused("the outline has " + std::to_string(edges) + " edges, of which CGAL makes " +
                     std::to_string(constrained));
    find_depths();
    return check_sides(slice.pslg);
  }

  std::size_t faces_inside() const {
    return static_cast<std::size_t>(
        std::count_if(cdt_.finite_face_handles().begin(), cdt_.finite_face_handles().end(),
                      [](Cdt::Face_handle f) { return f->info() % 2 == 1; }));
  }
  double doubled_area_inside() const {
    double sum = 0;  // integers below 2^53
    for (const Cdt::Face_handle f : cdt_.finite_face_handles())
      if (f->info() % 2 == 1) sum += 2 * cdt_.triangle(f).area();
    return sum;
  }
  bool is_outline_edge(const LatticePoint& a, const LatticePoint& b) const {
    Cdt::Face_handle face;
    int k = 0;
    return cdt_.is_edge(vertex_.at(a), vertex_.at(b), face, k) && cdt_.is_constrained({face, k});
  }

 private:
  void find_depths() {
    for (const Cdt::Face_handle f : cdt_.all_face_handles())
      f->info() = -1;
    std::vector<Cdt::Face_handle> here{cdt_.infinite_face()}, next;
    for (int depth = 0; !here.empty(); ++depth, here.swap(next), next.clear()) {
      while (!here.empty()) {
        const Cdt::Face_handle f = here.back();
        here.pop_back();
        if (f->info() >= 0) continue;
        f->info() = depth;
        for (int k = 0; k < 3; ++k)
          (cdt_.is_constrained({f, k}) ? next : here).push_back(f->neighbor(k));
      }
    }
  }

  // Checks that material lies on the left of every edge and not on its right.
  Result<void> check_sides(const Pslg& outline) const {
    for (const Ring& ring : outline.rings) {
      for (std::size_t i = 0; i < ring.size(); ++i) {
        const LatticePoint &a = ring[i], &b = ring[(i + 1) % ring.size()];
        Cdt::Face_handle left;
        int k = 0;
        cdt_.is_edge(vertex_.at(a), vertex_.at(b), left, k);
        // Faces are counter-clockwise, so the edge opposite to vertex k goes from vertex k + 1 to
        // vertex k + 2.
        if (left->vertex(Cdt::ccw(k))->point() != point_of(a)) left = left->neighbor(k);
        if (left->info() % 2 != 1)
          return refused("no material on the left of the outline's edge from " + text_of(a));
      }
    }
    return {};
  }

  Cdt cdt_;
  std::map<LatticePoint, Cdt::Vertex_handle> vertex_;
};

CGAL::Sign turn(const SliceMesh& mesh, const Triangle& t) {
  return CGAL::orientation(point_of(mesh.vertices[t[0]]), point_of(mesh.vertices[t[1]]),
                           point_of(mesh.vertices[t[2]]));
}

// The directed edges of the triangles, each with the corner opposite to it.
Result<std::map<Edge, std::uint32_t>> edges_of(const SliceMesh& mesh) {
  std::map<Edge, std::uint32_t> opposite;
  std::vector<bool> used(mesh.vertices.size(), false);
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const Triangle& t = mesh.triangles[i];
    for (const std::uint32_t v : t) {
      if (v >= mesh.vertices.size())
        return refused("triangle " + std::to_string(i) + " has a vertex that is not there");
      used[v] = true;
    }
    if (turn(mesh, t) != CGAL::LEFT_TURN)
      return refused("triangle " + std::to_string(i) + " is not counter-clockwise");
    for (std::size_t k = 0; k < 3; ++k) {
      if (!opposite.try_emplace({t[k], t[(k + 1) % 3]}, t[(k + 2) % 3]).second)
        return refused("triangle " + std::to_string(i) + " overlaps another at an edge");
    }
  }
  const auto idle = std::find(used.begin(), used.end(), false);
  if (idle != used.end())
    return refused("vertex " + std::to_string(idle - used.begin()) + " is in no triangle");
  return opposite;
}

// Checks that every edge is an edge of the outline or is Delaunay.
Result<void> check_edges(const SliceMesh& mesh, const std::map<Edge, std::uint32_t>& opposite,
                         const Triangulated& triangulated) {
  for (const auto& [edge, corner] : opposite) {
    const LatticePoint &a = mesh.vertices[edge.first], &b = mesh.vertices[edge.second];
    const auto other = opposite.find({edge.second, edge.first});
    const bool outline = triangulated.is_outline_edge(a, b);
    if (outline != (other == opposite.end())) {
      return refused("the edge from " + text_of(a) + " to " + text_of(b) +
                     (outline ? " is the outline's, and has triangles on both sides"
                              : " has a triangle on one side only, and is not the outline's"));
    }
    if (outline) continue;
    const CGAL::Oriented_side side =
        CGAL::side_of_oriented_circle(point_of(a), point_of(b), point_of(mesh.vertices[corner]),
                                      point_of(mesh.vertices[other->second]));
    if (side == CGAL::ON_POSITIVE_SIDE)
      return refused("the edge from " + text_of(a) + " to " + text_of(b) + " is not Delaunay");
  }
  return {};
}

Result<void> confirm(const AssetSlice& slice) {
  if (slice.pslg.rings.empty() && slice.mesh.triangles.empty() && slice.mesh.vertices.empty())
    return {};
  if (auto ok = check_rings(slice.pslg); !ok) return ok;
  Triangulated triangulated;
  if (auto ok = triangulated.build(slice); !ok) return ok;
  const auto opposite = edges_of(slice.mesh);
  if (!opposite) return opposite.error();
  if (auto ok = check_edges(slice.mesh, *opposite, triangulated); !ok) return ok;
  const std::size_t faces = triangulated.faces_inside();
  if (faces != slice.mesh.triangles.size())
    return refused("the mesh has " + std::to_string(slice.mesh.triangles.size()) +
                   " triangles, and CGAL's triangulation of its outline " + std::to_string(faces));
  double area = 0;
  for (const Triangle& t : slice.mesh.triangles)
    area += 2 * CGAL::area(point_of(slice.mesh.vertices[t[0]]), point_of(slice.mesh.vertices[t[1]]),
                           point_of(slice.mesh.vertices[t[2]]));
  if (area != triangulated.doubled_area_inside())
    return refused("the triangles have another area than the outline");
  return {};
}

// Checks the materials of one slice together: no two outlines cross or overlap, two that share an
// edge lie on different sides of it, and none lies inside another.
Result<void> confirm_together(std::span<const AssetSlice> materials) {
  Cdt cdt;
  std::map<Point, Cdt::Vertex_handle> vertex;
  std::map<std::pair<Point, Point>, int> material_left_of;
  std::set<std::pair<Point, Point>> edges;  // undirected
  for (const AssetSlice& one : materials) {
    for (const Ring& ring : one.pslg.rings) {
      for (std::size_t i = 0; i < ring.size(); ++i) {
        const LatticePoint &a = ring[i], &b = ring[(i + 1) % ring.size()];
        const Point p = point_of(a), q = point_of(b);
        if (!material_left_of.try_emplace({p, q}, one.material).second)
          return refused("two materials lie on the same side of the edge from " + text_of(a));
        edges.insert(std::minmax(p, q));
        for (const Point& end : {p, q}) {
          if (!vertex.contains(end)) vertex[end] = cdt.insert(end);
        }
      }
    }
  }
  try {
    for (const auto& [edge, material] : material_left_of)
      cdt.insert_constraint(vertex.at(edge.first), vertex.at(edge.second));
  } catch (const Cdt::Intersection_of_constraints_exception&) {
    return refused("the outlines of two materials cross");
  }
  const auto constrained =
      std::count_if(cdt.finite_edges_begin(), cdt.finite_edges_end(),
                    [&cdt](const Cdt::Edge& e) { return cdt.is_constrained(e); });
  if (static_cast<std::size_t>(constrained) != edges.size())
    return refused("the outlines of its materials have " + std::to_string(edges.size()) +
                   " edges together, of which CGAL makes " + std::to_string(constrained));
  // The material on the left of an edge belongs to the outline that has the edge in this direction;
  // if there is no such outline, nothing is material there. All edges around a region must agree on
  // its material.
  constexpr int kNone = -1, kUnknown = -2;
  for (const Cdt::Face_handle f : cdt.all_face_handles())
    f->info() = kUnknown;
  for (const Cdt::Face_handle start : cdt.all_face_handles()) {
    if (start->info() != kUnknown) continue;
    int here = cdt.is_infinite(start) ? kNone : kUnknown;
    std::vector<Cdt::Face_handle> region{start};
    start->info() = kNone;
    for (std::size_t at = 0; at < region.size(); ++at) {
      const Cdt::Face_handle f = region[at];
      for (int k = 0; k < 3; ++k) {
        if (!cdt.is_constrained({f, k})) {
          const Cdt::Face_handle next = f->neighbor(k);
          if (next->info() != kUnknown) continue;
          next->info() = kNone;
          region.push_back(next);
          continue;
        }
        const Point a = f->vertex(Cdt::ccw(k))->point(), b = f->vertex(Cdt::cw(k))->point();
        const auto found = material_left_of.find({a, b});
        const int left = found == material_left_of.end() ? kNone : found->second;
        if (here != kUnknown && here != left)
          return refused("two materials overlap, or one is not closed, near (" +
                         std::to_string(static_cast<std::int64_t>(a.x())) + ", " +
                         std::to_string(static_cast<std::int64_t>(a.y())) + ")");
        here = left;
      }
    }
  }
  return {};
}

}  // namespace

Result<void> confirm_by_cgal(const Asset& asset, const std::string& name) {
  for (const AssetSlice& slice : asset.slices) {
    if (auto ok = confirm(slice); !ok) {
      return refused(name + ", slice " + std::to_string(slice.index) +
                     ": CGAL does not confirm it: " + ok.error().message);
    }
  }
  for (std::size_t i = 0; i < asset.slices.size(); i += materials_of_slice(asset, i).size()) {
    const auto materials = materials_of_slice(asset, i);
    if (materials.size() < 2) continue;
    if (auto ok = confirm_together(materials); !ok)
      return refused(name + ", slice " + std::to_string(asset.slices[i].index) +
                     ": CGAL does not confirm it: " + ok.error().message);
  }
  for (const AssetSurface& one : asset.surfaces) {
    const std::string unconfirmed = name + ", surface of material " + std::to_string(one.material) +
                                    ": CGAL does not confirm it: ";
    const auto bad = self_intersecting_triangles(one.surface);
    if (!bad) return bad.error().after(unconfirmed);
    if (!bad->empty())
      return refused(unconfirmed + std::to_string(bad->size()) +
                     " of its triangles intersect others, triangle " +
                     std::to_string(bad->front()) + " among them");
  }
  return {};
}

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
