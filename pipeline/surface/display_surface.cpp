// SPDX-License-Identifier: GPL-3.0-or-later
// Long because the three steps work on CGAL's and OpenMesh's types,
// whose headers would otherwise be compiled for each step.
#include "pipeline/surface/display_surface.h"

#include <CGAL/AABB_face_graph_triangle_primitive.h>
#if __has_include(<CGAL/AABB_traits_3.h>)  // since CGAL 6
#include <CGAL/AABB_traits_3.h>
#else
#include <CGAL/AABB_traits.h>
#endif
#include <CGAL/AABB_tree.h>
#include <CGAL/Complex_2_in_triangulation_3.h>
#include <CGAL/Implicit_surface_3.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Surface_mesh_default_criteria_3.h>
#include <CGAL/Surface_mesh_default_triangulation_3.h>
#include <CGAL/make_surface_mesh.h>

#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Tools/Decimater/DecimaterT.hh>
#include <OpenMesh/Tools/Decimater/ModNormalFlippingT.hh>
#include <OpenMesh/Tools/Decimater/ModQuadricT.hh>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iterator>
#include <limits>
#include <string>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "formats/base/disjoint_sets.h"
#include "pipeline/verify/surface_proof.h"

namespace trocar::pipeline {
namespace {

using Eigen::Vector3d;
using Clock = std::chrono::steady_clock;

double lap_ms(Clock::time_point& start) {
  const auto now = Clock::now();
  return std::chrono::duration<double, std::milli>(now - std::exchange(start, now)).count();
}

bool stopped(const SurfaceOptions& options) {
  return options.stop != nullptr && options.stop->load();
}

Error interrupted() {
  return unwritable("interrupted; nothing was written");
}

/// Positions in the volume's frame.
struct Soup {
  std::vector<Vector3d> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

// 0. The lattice in the volume -------------------------------------------------------------------

// All coordinates below count lattice steps in the patient's frame (LPS). Nothing is rounded after
// the mesher, so its result stays free of self-intersections.
struct LatticeVolume {
  const SurfaceVolume* volume = nullptr;
  Lattice lattice;
  Eigen::Affine3d T_steps_volume, T_volume_steps;

  LatticeVolume(const SurfaceVolume& of, Lattice on)
      : volume(&of),
        lattice(on),
        T_steps_volume(Eigen::Scaling(1 / on.step_mm()) * of.T_lps_volume),
        T_volume_steps(T_steps_volume.inverse()) {}
  double at(const Vector3d& steps) const { return volume->at(T_volume_steps * steps); }
  double steps(double mm) const { return mm / lattice.step_mm(); }
};

Vector3d rounded(const Vector3d& p) {
  return {std::nearbyint(p.x()), std::nearbyint(p.y()), std::nearbyint(p.z())};
}

// Steps of at most a 64th of a voxel's shortest side.
Lattice lattice_for(const SurfaceVolume& volume) {
  constexpr int kFinest = 14;
  const auto [u, v, w] = volume.voxel_mm();
  Lattice out{0};
  while (out.bits < kFinest && out.step_mm() > std::min({u, v, w}) / 64)
    ++out.bits;
  return out;
}

// 1. CGAL's surface mesher ------------------------------------------------------------------------

using MesherTriangulation = CGAL::Surface_mesh_default_triangulation_3;
using MesherComplex = CGAL::Complex_2_in_triangulation_3<MesherTriangulation>;
using MesherKernel = MesherTriangulation::Geom_traits;

// The function whose zero level is meshed; negative in the material.
struct NegatedVolume {
  const LatticeVolume* volume;
  double operator()(const MesherKernel::Point_3& p) const {
    return -volume->at({p.x(), p.y(), p.z()});
  }
};

using MesherSurface = CGAL::Implicit_surface_3<MesherKernel, NegatedVolume>;

// The point in which the dual of a facet crosses the surface, on the lattice. It is the same from
// either side. Only facets of the hull, far from the surface, have a ray.
struct MesherTraits {
  using Surface_3 = MesherSurface;
  using Intersection_point = MesherKernel::Point_3;
  struct Crossing {
    CGAL::Object operator()(const Surface_3& surface, const MesherKernel::Segment_3& s) const {
      Intersection_point low = s.source(), high = s.target();
      if (high < low) std::swap(low, high);
      const bool side = surface(low) >= 0;
      if ((surface(high) >= 0) == side) return {};
      while (CGAL::squared_distance(low, high) > surface.squared_error_bound()) {
        const auto middle = CGAL::midpoint(low, high);
        if (middle == low || middle == high) break;
        ((surface(middle) >= 0) == side ? low : high) = middle;
      }
      const Vector3d p = rounded({high.x(), high.y(), high.z()});
      return CGAL::make_object(Intersection_point(p.x(), p.y(), p.z()));
    }
    CGAL::Object operator()(const Surface_3&, const MesherKernel::Ray_3&) const { return {}; }
    CGAL::Object operator()(const Surface_3&, const MesherKernel::Line_3&) const { return {}; }
  };
  using Intersect_3 = Crossing;
  Crossing intersect_3_object() const { return {}; }
};

struct MesherBounds {
  double angle_deg = 0, radius_mm = 0, distance_mm = 0, bisection_mm = 0;
};

// The criteria of CGAL::Surface_mesh_default_criteria_3. The order of refinement depends on
// positions only, whereas CGAL orders equal facets by their addresses in memory.
struct MesherCriteria {
  double min_sine = 0, radius = 0, distance = 0;  // lengths in steps

  struct Quality {
    double worst = 1;  // smallest ratio of bound to value; below 1: bad
    std::array<MesherKernel::Point_3, 3> corners;
    bool operator<(const Quality& other) const {
      return worst != other.worst ? worst < other.worst : corners < other.corners;
    }
  };

  bool is_bad(const MesherTriangulation::Facet& f, Quality& q) const {
    for (int k = 0; k < 3; ++k)
      q.corners.at(static_cast<std::size_t>(k)) = f.first->vertex((f.second + 1 + k) & 3)->point();
    std::sort(q.corners.begin(), q.corners.end());
    const auto& [a, b, c] = q.corners;
    const auto& centre = f.first->get_facet_surface_center(f.second);
    const double ab = CGAL::squared_distance(a, b), bc = CGAL::squared_distance(b, c),
                 ca = CGAL::squared_distance(c, a),
                 four_areas2 = CGAL::cross_product(b - a, c - a).squared_length(),
                 longest = std::max({ab, bc, ca});
    q.worst = 0;
    if (four_areas2 <= 0) return true;
    // The sine of the smallest angle, which lies between the two longer sides.
    const double sine = std::sqrt(four_areas2 * std::min({ab, bc, ca}) / (ab * bc * ca));
    const double off =
        std::sqrt(CGAL::squared_distance(centre, CGAL::circumcenter(a, b, c)) + 1e-12 * longest);
    const double around = std::sqrt(CGAL::squared_distance(centre, a) + 1e-12 * longest);
    q.worst = std::min({sine / min_sine, distance / off, radius / around});
    return q.worst < 1;
  }
};

using MesherBase = CGAL::Surface_mesher::Surface_mesher_base<MesherComplex, MesherSurface,
                                                             MesherTraits, MesherCriteria>;

// If points of the surface are nearly in one plane or on one sphere, rounding can put a facet's
// centre on a vertex or outside its ball. CGAL's mesher then ends with an error; this one leaves
// such a facet unchanged.
struct TolerantMesherBase : MesherBase {
  using MesherBase::MesherBase;
  CGAL::Mesher_level_conflict_status private_test_point_conflict_impl(const Point&, Zone& zone) {
    return zone.locate_type == Tr::VERTEX ? CGAL::CONFLICT_AND_ELEMENT_SHOULD_BE_DROPPED
                                          : CGAL::NO_CONFLICT;
  }
  void pop_next_element_impl() { facets_to_refine.pop_front(); }
  void before_insertion_impl(const Facet& source, const Point& p, Zone& zone) {
    MesherBase::before_insertion_impl(Facet(), p, zone);
    facets_to_refine.erase(source);
  }
};

using SurfaceMesher = CGAL::Surface_mesher::Surface_mesher<TolerantMesherBase>;

MesherKernel::Sphere_3 sphere_around(const LatticeVolume& on) {
  const SurfaceVolume& volume = *on.volume;
  Vector3d low = volume.position(0, 0, 0), high = low;
  for (int z = 0; z < volume.size[2]; ++z) {
    low = low.cwiseMin(volume.position(0, 0, z));
    high = high.cwiseMax(volume.position(volume.size[0] - 1, volume.size[1] - 1, z));
  }
  const Vector3d centre = on.T_steps_volume * ((low + high) / 2);
  const double radius = on.steps((high - low).norm() / 2);
  return {MesherKernel::Point_3(centre.x(), centre.y(), centre.z()), 1.01 * radius * radius};
}

bool is_in_range(const LatticeVolume& on) {
  const auto sphere = sphere_around(on);
  const double radius = std::sqrt(sphere.squared_radius());
  const auto c = sphere.center();
  return std::max({std::abs(c.x()), std::abs(c.y()), std::abs(c.z())}) + radius <
         kMaxSpaceCoordinate;
}

// A triangulation of space, with each tetrahedron either material or not.
struct Tetrahedra {
  std::vector<Vector3d> vertices;
  std::vector<std::array<std::uint32_t, 4>> corners,
      neighbours;  // by tetrahedron; neighbours are opposite the corners
  std::vector<bool> inside;
  std::vector<bool>
      outer;  // whether a corner is not on the surface; such a tetrahedron is never inside
};

// A tetrahedron is material if its circumcentre is. The facets between the two kinds are then the
// restricted Delaunay triangulation of the surface, which the mesher refines. Tetrahedra within
// walls and gaps that are thinner than the triangles often have their circumcentre elsewhere. They
// are recognised by samples that are all on one side.
Tetrahedra tetrahedra_of(const MesherTriangulation& triangulation, const LatticeVolume& volume) {
  constexpr auto kHash = CGAL::Handle_hash_function();
  constexpr int kSamples = 5;
  const auto sphere = sphere_around(volume);
  const Vector3d centre(sphere.center().x(), sphere.center().y(), sphere.center().z());
  Tetrahedra out;
  // Sorted by position, since CGAL's order depends on addresses in memory.
  std::vector<MesherTriangulation::Vertex_handle> vertices;
  for (auto v = triangulation.finite_vertices_begin(); v != triangulation.finite_vertices_end();
       ++v)
    vertices.push_back(v);
  std::sort(vertices.begin(), vertices.end(),
            [](auto a, auto b) { return a->point() < b->point(); });
  vertices.push_back(triangulation.infinite_vertex());
  std::unordered_map<MesherTriangulation::Vertex_handle, std::uint32_t, decltype(kHash)> vertex;
  for (const auto v : vertices) {
    vertex.emplace(v, static_cast<std::uint32_t>(vertex.size()));
    const auto& p = v->point();
    out.vertices.emplace_back(p.x(), p.y(), p.z());
  }
  using Cell = std::pair<std::array<std::uint32_t, 4>, MesherTriangulation::Cell_handle>;
  std::vector<Cell> cells;
  for (auto c = triangulation.all_cells_begin(); c != triangulation.all_cells_end(); ++c) {
    std::array<std::uint32_t, 4> corners{};
    for (int i = 0; i < 4; ++i)
      corners.at(static_cast<std::size_t>(i)) = vertex.at(c->vertex(i));
    std::sort(corners.begin(), corners.end());
    cells.emplace_back(corners, c);
  }
  std::sort(cells.begin(), cells.end(),
            [](const Cell& a, const Cell& b) { return a.first < b.first; });
  std::unordered_map<MesherTriangulation::Cell_handle, std::uint32_t, decltype(kHash)> number;
  for (const auto& [sorted, c] : cells)
    number.emplace(c, static_cast<std::uint32_t>(number.size()));
  for (const Cell& cell : cells) {
    const auto c = cell.second;
    std::array<std::uint32_t, 4> corners{}, neighbours{};
    for (int i = 0; i < 4; ++i) {
      corners.at(static_cast<std::size_t>(i)) = vertex.at(c->vertex(i));
      neighbours.at(static_cast<std::size_t>(i)) = number.at(c->neighbor(i));
    }
    out.corners.push_back(corners);
    out.neighbours.push_back(neighbours);
    const bool finite = !triangulation.is_infinite(c);
    out.outer.push_back(!finite || std::any_of(corners.begin(), corners.end(), [&](auto v) {
      return (out.vertices[v] - centre).squaredNorm() > sphere.squared_radius();
    }));
    if (out.outer.back()) {
      out.inside.push_back(false);
      continue;
    }
    Vector3d middle = Vector3d::Zero();
    for (const std::uint32_t v : cell.first)
      middle += out.vertices[v] / 4;
    int within = volume.at(middle) >= 0 ? 1 : 0;
    for (const std::uint32_t v : cell.first)
      within += volume.at((middle + out.vertices[v]) / 2) >= 0 ? 1 : 0;
    if (within > 0 && within < kSamples) {
      const auto p = triangulation.dual(c);
      within = volume.at({p.x(), p.y(), p.z()}) >= 0 ? kSamples : 0;
    }
    out.inside.push_back(within > 0);
  }
  return out;
}

// Makes the facets between material and the rest a manifold: at each vertex both kinds of
// tetrahedra must be connected through facets at the vertex. Where the surface touches itself or
// nearly does, refinement cannot achieve this. All but the largest connected set change sides. If
// this does not end, sets only change from material to outside, which must end.
void make_manifold(Tetrahedra& tets) {
  constexpr int kRoundsBothWays = 10;
  std::vector<std::vector<std::uint32_t>> around(tets.vertices.size());
  for (std::uint32_t c = 0; c < tets.corners.size(); ++c)
    for (const std::uint32_t v : tets.corners[c])
      around[v].push_back(c);
  std::vector<std::uint32_t> set(tets.corners.size()),
      stack;  // connected set of each cell at a vertex
  std::vector<bool> look(tets.vertices.size(), true);
  bool only_remove = false;
  for (int round = 1;; ++round) {
    bool changed = false, stuck = false;
    std::vector<bool> next(tets.vertices.size(), false);
    for (std::uint32_t v = 0; v < around.size(); ++v) {
      if (!look[v]) continue;
      constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
      for (const std::uint32_t c : around[v])
        set[c] = kNone;
      std::vector<std::size_t> sizes;
      std::vector<bool> inside;
      for (const std::uint32_t first : around[v]) {
        if (set[first] != kNone) continue;
        const auto here = static_cast<std::uint32_t>(sizes.size());
        sizes.push_back(0);
        inside.push_back(tets.inside[first]);
        set[first] = here;
        stack.assign(1, first);
        while (!stack.empty()) {
          const std::uint32_t c = stack.back();
          stack.pop_back();
          ++sizes[here];
          for (std::size_t i = 0; i < 4; ++i) {
            const std::uint32_t other = tets.neighbours[c].at(i);
            if (tets.corners[c].at(i) == v || tets.inside[other] != inside[here] ||
                set[other] != kNone)
              continue;
            set[other] = here;
            stack.push_back(other);
          }
        }
      }
      if (sizes.size() <= 1 || (sizes.size() == 2 && inside[0] != inside[1])) continue;
      // The largest set of each kind stays. If sets are only removed, all sets inside but the
      // largest are, or the only one.
      std::array<std::size_t, 2> largest{sizes.size(), sizes.size()}, sets{};
      for (std::size_t i = 0; i < sizes.size(); ++i) {
        std::size_t& best = largest.at(inside[i] ? 1 : 0);
        ++sets.at(inside[i] ? 1 : 0);
        if (best == sizes.size() || sizes[i] > sizes[best]) best = i;
      }
      for (const std::uint32_t c : around[v]) {
        const bool is_inside = tets.inside[c];
        if (only_remove && !is_inside) continue;
        if (set[c] == largest.at(is_inside ? 1 : 0) && !(only_remove && sets[1] == 1)) continue;
        if (tets.outer[c]) {
          next[v] = stuck = true;
          continue;
        }
        tets.inside[c] = !is_inside;
        changed = true;
        for (const std::uint32_t w : tets.corners[c])
          next[w] = true;
      }
    }
    if (!changed && !stuck) return;
    only_remove = only_remove || !changed || round >= kRoundsBothWays;
    look = std::move(next);
  }
}

Soup triangles_of(const Tetrahedra& tets) {
  Soup out;
  constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> number(tets.vertices.size(), kNone);
  for (std::uint32_t c = 0; c < tets.corners.size(); ++c) {
    for (std::size_t i = 0; i < 4; ++i) {
      if (tets.inside[c] || !tets.inside[tets.neighbours[c].at(i)]) continue;
      std::array<std::uint32_t, 3> triangle{};
      for (int k = 0; k < 3; ++k) {
        // The facet is counter-clockwise seen from this cell, which is outside the material.
        const auto corner = static_cast<std::size_t>(
            MesherTriangulation::vertex_triple_index(static_cast<int>(i), k));
        triangle.at(static_cast<std::size_t>(k)) = tets.corners[c].at(corner);
      }
      std::rotate(triangle.begin(), std::min_element(triangle.begin(), triangle.end()),
                  triangle.end());
      out.triangles.push_back(triangle);
    }
  }
  std::sort(out.triangles.begin(), out.triangles.end());
  for (auto& triangle : out.triangles) {
    for (std::uint32_t& v : triangle) {
      if (number[v] == kNone) {
        number[v] = static_cast<std::uint32_t>(out.vertices.size());
        out.vertices.push_back(tets.vertices[v]);
      }
      v = number[v];
    }
  }
  return out;
}

// `points_mm` are the initial points on the surface.
Result<Soup> mesh_surface(const std::vector<Vector3d>& points_mm, const LatticeVolume& volume,
                          const MesherBounds& bounds, const SurfaceOptions& options) {
  constexpr std::size_t kMaxPointsOfEach = 8, kFewPoints = 1000;
  CGAL::get_default_random() = CGAL::Random(0);
  MesherTriangulation triangulation;
  MesherComplex complex(triangulation);
  const auto sphere = sphere_around(volume);
  const MesherSurface surface(
      NegatedVolume{&volume}, sphere,
      volume.steps(bounds.bisection_mm) / std::sqrt(sphere.squared_radius()));
  // Far corners keep the vertices of the surface away from the triangulation's hull.
  std::vector<MesherTriangulation::Point> initial;
  initial.reserve(8 + points_mm.size());
  const double far = 4 * std::sqrt(sphere.squared_radius());
  for (int k = 0; k < 8; ++k)
    initial.push_back(sphere.center() + MesherKernel::Vector_3(k % 2 == 0 ? -far : far,
                                                               k / 2 % 2 == 0 ? -far : far,
                                                               k / 4 == 0 ? -far : far));
  for (const Vector3d& p : points_mm) {
    const Vector3d q = rounded(volume.T_steps_volume * p);
    initial.emplace_back(q.x(), q.y(), q.z());
  }
  triangulation.insert(initial.begin(), initial.end());
  const MesherCriteria criteria{std::sin(bounds.angle_deg * 3.14159265358979 / 180),
                                volume.steps(bounds.radius_mm), volume.steps(bounds.distance_mm)};
  const MesherTraits traits;
  SurfaceMesher mesher(complex, surface, traits, criteria);
  mesher.init();
  constexpr std::size_t kStepsBetweenChecks = 1024;
  for (std::size_t step = 0; !mesher.is_algorithm_done(); ++step) {
    CGAL::Null_mesh_visitor visitor;
    mesher.one_step(visitor);
    if (step % kStepsBetweenChecks != 0) continue;
    if (stopped(options)) return interrupted();
    if (triangulation.number_of_vertices() > kMaxPointsOfEach * (initial.size() + kFewPoints))
      return refused("--surface: the surface mesher does not end; give --min-volume, or --crop");
  }
  Tetrahedra tets = tetrahedra_of(triangulation, volume);
  make_manifold(tets);
  return triangles_of(tets);
}

// Exact distances to a surface.
class DistanceTo {
 public:
  explicit DistanceTo(const Soup& soup) {
    for (const Vector3d& p : soup.vertices)
      mesh_.add_vertex({p.x(), p.y(), p.z()});
    for (const auto& t : soup.triangles)
      mesh_.add_face(Mesh::Vertex_index(t[0]), Mesh::Vertex_index(t[1]), Mesh::Vertex_index(t[2]));
    tree_.insert(faces(mesh_).first, faces(mesh_).second, mesh_);
    tree_.accelerate_distance_queries();
  }
  double operator()(const Vector3d& p) const {
    return std::sqrt(tree_.squared_distance({p.x(), p.y(), p.z()}));
  }

 private:
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
  using Primitive = CGAL::AABB_face_graph_triangle_primitive<Mesh>;
#if __has_include(<CGAL/AABB_traits_3.h>)
  using Traits = CGAL::AABB_traits_3<Kernel, Primitive>;
#else
  using Traits = CGAL::AABB_traits<Kernel, Primitive>;
#endif
  Mesh mesh_;
  CGAL::AABB_tree<Traits> tree_;
};

// 2. Decimation -----------------------------------------------------------------------------------

struct DoubleTraits : OpenMesh::DefaultTraits {
  using Point = OpenMesh::Vec3d;
  using Normal = OpenMesh::Vec3d;
};
using DecimatedMesh = OpenMesh::TriMesh_ArrayKernelT<DoubleTraits>;

// The collapse of a vertex into a neighbour.
struct Collapse {
  int from = 0, to = 0;
};

// Rejects collapses that turn a triangle over, and records those that are made.
class Recorder : public OpenMesh::Decimater::ModNormalFlippingT<DecimatedMesh> {
 public:
  using Handle = OpenMesh::Decimater::ModHandleT<Recorder>;
  explicit Recorder(DecimatedMesh& mesh) : ModNormalFlippingT(mesh) {
    constexpr double kMaxTurn_deg = 60;
    set_max_normal_deviation(kMaxTurn_deg);
  }
  void preprocess_collapse(const CollapseInfo& c) override {
    made.push_back({c.v0.idx(), c.v1.idx()});
  }
  std::vector<Collapse> made;
};

Result<DecimatedMesh> mesh_of(const Soup& fine) {
  DecimatedMesh mesh;
  mesh.request_face_normals();
  mesh.request_vertex_status();
  mesh.request_edge_status();
  mesh.request_face_status();
  std::vector<DecimatedMesh::VertexHandle> handles;
  for (const Vector3d& p : fine.vertices)
    handles.push_back(mesh.add_vertex({p.x(), p.y(), p.z()}));
  for (const auto& t : fine.triangles)
    if (!mesh.add_face(handles[t[0]], handles[t[1]], handles[t[2]]).is_valid())
      return bug("--surface: the surface mesher's result is not manifold");
  return mesh;
}

// The collapses from the fine surface to this number of triangles, in ascending order of error.
Result<std::vector<Collapse>> collapses(const Soup& fine, std::size_t triangles) {
  namespace dec = OpenMesh::Decimater;
  auto mesh = mesh_of(fine);
  if (!mesh) return mesh.error();
  mesh->update_face_normals();
  dec::DecimaterT<DecimatedMesh> decimater(*mesh);
  dec::ModQuadricT<DecimatedMesh>::Handle quadric;
  Recorder::Handle recorder;
  decimater.add(quadric);
  decimater.module(quadric).unset_max_err();
  decimater.add(recorder);
  if (!decimater.initialize()) return bug("--surface: OpenMesh's decimater has no module");
  decimater.decimate_to_faces(0, triangles);
  return std::move(decimater.module(recorder).made);
}

// The fine surface after as many of the collapses as this number of triangles needs, without those
// of locked vertices.
Result<Soup> collapsed(const Soup& fine, const std::vector<Collapse>& collapses,
                       std::size_t triangles, const std::vector<bool>& locked) {
  auto made = mesh_of(fine);
  if (!made) return made.error();
  DecimatedMesh& mesh = *made;
  std::size_t left = fine.triangles.size();
  for (const auto& [from, to] : collapses) {
    if (left <= triangles) break;
    const DecimatedMesh::VertexHandle a(from), b(to);
    if (locked[static_cast<std::size_t>(from)] || mesh.status(a).deleted() ||
        mesh.status(b).deleted())
      continue;
    const auto edge = mesh.find_halfedge(a, b);
    if (!edge.is_valid() || !mesh.is_collapse_ok(edge)) continue;
    mesh.collapse(edge);
    left -= 2;
  }
  mesh.garbage_collection();
  Soup out;
  for (const auto v : mesh.vertices()) {
    const auto& p = mesh.point(v);
    out.vertices.emplace_back(p[0], p[1], p[2]);
  }
  for (const auto f : mesh.faces()) {
    std::array<std::uint32_t, 3> t{};
    std::size_t k = 0;
    for (const auto v : mesh.fv_range(f))
      t.at(k++) = static_cast<std::uint32_t>(v.idx());
    out.triangles.push_back(t);
  }
  return out;
}

// The vertices are on the lattice.
TriangleSurface surface_of(const Soup& soup, const Lattice& lattice) {
  TriangleSurface out;
  out.lattice = lattice;
  out.triangles = soup.triangles;
  for (const Vector3d& p : soup.vertices)
    out.vertices.push_back({static_cast<std::int32_t>(p.x()), static_cast<std::int32_t>(p.y()),
                            static_cast<std::int32_t>(p.z())});
  return out;
}

// Locks the fine vertices near the given triangles' corners.
void lock_near(const Soup& coarse, const std::vector<std::size_t>& triangles, double lock_distance,
               const Soup& fine, std::vector<bool>& locked) {
  // The corners, in the cells of a grid as wide as the lock distance.
  using Cell = std::array<std::int64_t, 3>;
  struct Hash {
    std::size_t operator()(const Cell& c) const {
      return static_cast<std::size_t>(c[0] * 73856093 ^ c[1] * 19349663 ^ c[2] * 83492791);
    }
  };
  const auto cell_of = [&](const Vector3d& p) {
    return Cell{std::llround(std::floor(p.x() / lock_distance)),
                std::llround(std::floor(p.y() / lock_distance)),
                std::llround(std::floor(p.z() / lock_distance))};
  };
  std::unordered_map<Cell, std::vector<Vector3d>, Hash> corners;
  for (const std::size_t t : triangles) {
    const auto& [a, b, c] = coarse.triangles[t];
    const Vector3d &pa = coarse.vertices[a], &pb = coarse.vertices[b], &pc = coarse.vertices[c];
    // Points all over the triangle, at most the lock distance apart.
    const double longest = std::max({(pb - pa).norm(), (pc - pb).norm(), (pa - pc).norm()});
    const int n = 1 + static_cast<int>(std::min(longest / lock_distance, 64.0));
    for (int i = 0; i <= n; ++i) {
      for (int j = 0; i + j <= n; ++j) {
        const Vector3d p = pa + (pb - pa) * (static_cast<double>(i) / n) +
                           (pc - pa) * (static_cast<double>(j) / n);
        corners[cell_of(p)].push_back(p);
      }
    }
  }
  for (std::size_t i = 0; i < fine.vertices.size(); ++i) {
    if (locked[i]) continue;
    const Cell at = cell_of(fine.vertices[i]);
    for (std::int64_t k = 0; k < 27 && !locked[i]; ++k) {
      const auto near = corners.find({at[0] + k % 3 - 1, at[1] + k / 3 % 3 - 1, at[2] + k / 9 - 1});
      if (near == corners.end()) continue;
      locked[i] = std::any_of(near->second.begin(), near->second.end(), [&](const Vector3d& p) {
        return (p - fine.vertices[i]).squaredNorm() <= lock_distance * lock_distance;
      });
    }
  }
}

// Decimates to this many triangles, or to more if the surface would intersect itself: vertices near
// an intersection are locked, and the decimation begins again.
Result<TriangleSurface> decimated(const Soup& fine, const std::vector<Collapse>& collapses,
                                  std::size_t triangles, double lock_distance,
                                  const Lattice& lattice, const SurfaceOptions& options,
                                  DisplaySurface& out, Clock::time_point& clock) {
  constexpr int kMaxRounds = 12;
  std::vector<bool> locked(fine.vertices.size(), false);
  for (int round = 1; round <= kMaxRounds; ++round) {
    if (stopped(options)) return interrupted();
    if (round == kMaxRounds) locked.assign(locked.size(), true);  // no collapse is left
    const auto soup = collapsed(fine, collapses, triangles, locked);
    if (!soup) return soup.error();
    auto surface = surface_of(*soup, lattice);
    out.decimate_ms += lap_ms(clock);
    const auto bad = self_intersecting_triangles(surface);
    out.check_ms += lap_ms(clock);
    if (bad.empty()) return surface;
    lock_near(*soup, bad, std::min(round, 4) * lock_distance, fine, locked);
  }
  return bug("--surface: the surface intersects itself");
}

// 3. Distance -------------------------------------------------------------------------------------

constexpr std::size_t kDistanceSamples = 20'000;

// The distance to the nearest point of the zero level on 26 rays and on some along the gradient.
double distance_to_zero(const SurfaceVolume& volume, const Vector3d& p) {
  const auto [u, v, w] = volume.voxel_mm();
  const double step = std::min({u, v, w}) / 8;
  const bool inside = volume.at(p) >= 0;
  double best = std::numeric_limits<double>::infinity();
  Vector3d nearest = p;
  const auto along = [&](const Vector3d& direction, double length) {
    for (int k = 1; k * step < std::min(best, length) + step; ++k) {
      const double t = k * step;
      if ((volume.at(p + t * direction) >= 0) == inside) continue;
      double low = t - step, high = t;
      for (int i = 0; i < 12; ++i) {
        const double middle = (low + high) / 2;
        ((volume.at(p + middle * direction) >= 0) == inside ? low : high) = middle;
      }
      if (high < best) {
        best = high;
        nearest = p + high * direction;
      }
      return;
    }
  };
  const Vector3d up = volume.gradient(p, step);
  double length = 32 * step;
  for (int doubling = 0; doubling < 6 && !std::isfinite(best); ++doubling, length *= 4) {
    along(inside ? Vector3d(-up) : up, length);
    for (int k = 0; k < 27; ++k)
      if (k != 13)
        along(Eigen::Vector3i(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1).cast<double>().normalized(),
              length);
  }
  for (int i = 0; i < 3 && std::isfinite(best); ++i) {
    const Vector3d g = volume.gradient(nearest, step);
    along(inside ? Vector3d(-g) : g, length);
  }
  return best;
}

// Points spread evenly over the surface, in the volume's frame.
std::vector<Vector3d> points_on(const TriangleSurface& surface,
                                const Eigen::Affine3d& T_volume_lps) {
  const auto position = [&](std::uint32_t v) -> Vector3d {
    const SpacePoint& p = surface.vertices[v];
    return T_volume_lps * Vector3d(surface.lattice.to_mm(p[0]), surface.lattice.to_mm(p[1]),
                                   surface.lattice.to_mm(p[2]));
  };
  double area = 0;
  const auto area_of = [&](const std::array<std::uint32_t, 3>& t) {
    return (position(t[1]) - position(t[0])).cross(position(t[2]) - position(t[0])).norm() / 2;
  };
  for (const auto& t : surface.triangles)
    area += area_of(t);
  const double each = area / static_cast<double>(kDistanceSamples);
  std::vector<Vector3d> out;
  double passed = 0;
  for (const auto& t : surface.triangles) {
    passed += area_of(t);
    while (passed > (static_cast<double>(out.size()) + 0.5) * each &&
           out.size() < kDistanceSamples) {
      // The R2 sequence (Roberts 2018), folded into the triangle.
      const auto n = static_cast<double>(out.size());
      double a = n * 0.7548776662466927, b = n * 0.5698402909980532;
      a -= std::floor(a);
      b -= std::floor(b);
      if (a + b > 1) {
        a = 1 - a;
        b = 1 - b;
      }
      out.emplace_back((1 - a - b) * position(t[0]) + a * position(t[1]) + b * position(t[2]));
    }
  }
  return out;
}

// Points of the zero level on edges of the grid, chosen evenly from all.
std::vector<Vector3d> points_on_zero(const SurfaceVolume& volume) {
  const int nx = volume.size[0], ny = volume.size[1], nz = volume.size[2];
  const auto each = [&](const auto& visit) {
    for (int z = 0; z < nz; ++z) {
      for (int y = 0; y < ny; ++y) {
        for (int x = 0; x < nx; ++x) {
          const float here = volume.value(x, y, z);
          if (x > 0 && (volume.value(x - 1, y, z) >= 0) != (here >= 0)) visit(x, y, z, x - 1, y, z);
          if (y > 0 && (volume.value(x, y - 1, z) >= 0) != (here >= 0)) visit(x, y, z, x, y - 1, z);
          if (z > 0 && (volume.value(x, y, z - 1) >= 0) != (here >= 0)) visit(x, y, z, x, y, z - 1);
        }
      }
    }
  };
  std::size_t all = 0, met = 0;
  each([&](int, int, int, int, int, int) { ++all; });
  const std::size_t stride = all / kDistanceSamples + 1;
  std::vector<Vector3d> out;
  each([&](int x, int y, int z, int x2, int y2, int z2) {
    if (met++ % stride != 0) return;
    const auto a = static_cast<double>(volume.value(x, y, z)),
               b = static_cast<double>(volume.value(x2, y2, z2));
    out.emplace_back(volume.position(x, y, z) +
                     a / (a - b) * (volume.position(x2, y2, z2) - volume.position(x, y, z)));
  });
  return out;
}

double percentile(std::vector<double>& values, double share) {
  if (values.empty()) return 0;
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

SurfaceDistance summary(std::vector<double> values) {
  return {percentile(values, 0.5), percentile(values, 0.99), percentile(values, 1)};
}

void measure(const SurfaceVolume& volume, DisplaySurface& out) {
  const Eigen::Affine3d T_volume_lps = volume.T_lps_volume.inverse();
  std::vector<double> distances;
  for (const Vector3d& p : points_on(out.surface, T_volume_lps))
    distances.push_back(distance_to_zero(volume, p));
  out.distance = summary(std::move(distances));

  Soup soup;
  soup.triangles = out.surface.triangles;
  const Lattice& lattice = out.surface.lattice;
  for (const SpacePoint& p : out.surface.vertices)
    soup.vertices.emplace_back(
        T_volume_lps * Vector3d(lattice.to_mm(p[0]), lattice.to_mm(p[1]), lattice.to_mm(p[2])));
  const DistanceTo distance(soup);
  distances.clear();
  for (const Vector3d& p : points_on_zero(volume))
    distances.push_back(distance(p));
  out.left_out = summary(std::move(distances));
}

std::size_t count_parts(const TriangleSurface& surface) {
  DisjointSets sets(surface.vertices.size());
  std::size_t parts = sets.size();
  for (const auto& t : surface.triangles) {
    for (std::size_t k = 0; k < 2; ++k)
      if (sets.join(t[k], t[k + 1])) --parts;
  }
  return parts;
}

}  // namespace

Result<DisplaySurface> make_display_surface(const SurfaceVolume& volume,
                                            const SurfaceOptions& options) {
  constexpr double kAngle_deg = 20;
  constexpr double kRadius_voxels = 1, kDistance_voxels = 0.15, kBisection_voxels = 0.005;
  constexpr double kSpacing_voxels = 0.7;
  // The area for each of surface_points(), in units of a voxel's side squared.
  constexpr double kPointArea = 0.75, kMaxPoints = 300'000;
  DisplaySurface out;
  auto clock = Clock::now();
  const auto voxel = [](const SurfaceVolume& v) {
    const auto [x, y, z] = v.voxel_mm();
    return std::cbrt(x * y * z);
  };
  out.bound_mm = voxel(volume) / 2;
  const double affordable_mm = std::sqrt(surface_area_mm2(volume) / (kPointArea * kMaxPoints));
  SurfaceVolume coarse;
  const SurfaceVolume* meshed = &volume;
  if (affordable_mm > 1.5 * voxel(volume)) {
    const auto sides = volume.voxel_mm();
    for (std::size_t k = 0; k < 3; ++k)
      out.coarsened[k] = std::max(1, static_cast<int>(std::lround(affordable_mm / sides[k])));
    coarse = coarser(volume, out.coarsened);
    drop_small_components(coarse, kMinSurfaceVoxels, 0);
    meshed = &coarse;
  }
  const double side = std::max(voxel(*meshed), affordable_mm);
  const LatticeVolume on(*meshed, lattice_for(volume));
  if (!is_in_range(on))
    return refused("--surface: the scan lies too far from the patient's origin");
  const auto fine = mesh_surface(
      surface_points(*meshed, kSpacing_voxels * side), on,
      {kAngle_deg, kRadius_voxels * side, kDistance_voxels * side, kBisection_voxels * side},
      options);
  if (!fine) return fine.error();
  if (fine->triangles.empty()) return refused("--surface: the surface mesher finds nothing");
  out.mesher_triangles = fine->triangles.size();
  out.mesher_ms = lap_ms(clock);

  auto wanted = static_cast<std::size_t>(options.triangles);
  const auto steps =
      collapses(*fine, wanted - wanted / 8);  // more than needed, since some will be left out
  if (!steps) return steps.error();
  bool can_reach_bound = false;
  for (;; wanted *= 2) {
    auto surface =
        decimated(*fine, *steps, wanted, on.steps(side), on.lattice, options, out, clock);
    if (!surface) return surface.error();
    out.surface = std::move(*surface);
    if (auto ok = check_triangle_surface(out.surface); !ok) return bug(ok.error().message);
    measure(volume, out);
    out.check_ms += lap_ms(clock);
    if (options.at_most || wanted >= fine->triangles.size() || out.is_within_bound()) break;
    if (!can_reach_bound) {  // even the mesher's own surface does not reach it
      DisplaySurface all;
      all.bound_mm = out.bound_mm;
      all.surface = surface_of(*fine, on.lattice);
      measure(volume, all);
      can_reach_bound = all.is_within_bound();
      out.check_ms += lap_ms(clock);
      if (!can_reach_bound) break;
    }
  }
  out.parts = count_parts(out.surface);
  return out;
}

}  // namespace trocar::pipeline
