// SPDX-License-Identifier: Apache-2.0
// Divides a mesh into groups of connected components that are small enough for a processor's cache.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/refinement.h"
#include "formats/mesh/refinement_mesh.h"
#include "formats/mesh/slice_mesh.h"
#include "formats/mesh/triangulation.h"

namespace trocar {

/// Divides a mesh into groups of whole connected components (triangles that share a vertex are
/// connected). Use it for a computation that can treat each component without the others: the
/// computation is faster if it treats one group after another. The data of a group fit into a
/// processor's cache, unless the group is a single large component. All groups use the same memory.
class ComponentGroups {
 public:
  /// A group has at most this many vertices unless it is a single component.
  static constexpr std::uint32_t kMaxVertices = 1 << 15;

  struct Group {
    std::span<const std::uint32_t> vertices, triangles;  ///< indices in the whole mesh, ascending
    SliceMesh mesh;  ///< these vertices and triangles, in the same order
    /// One entry for each vertex of `mesh`: the vertex with the lowest index in its component. This
    /// vertex identifies the component. Both vertices are indices in `mesh`.
    std::vector<std::uint32_t> component;
  };

  /// Every vertex and triangle of `mesh` is in one group. Precondition: `mesh` has at least one
  /// vertex and outlives this object. O(n).
  explicit ComponentGroups(const SliceMesh& mesh);

  std::size_t count() const { return vertices_.first.size() - 1; }
  /// Returns group g. The result is valid until the next call. O(size of the group).
  const Group& group(std::size_t g);

 private:
  struct List {  // vertices or triangles of all groups; those of group g begin at items[first[g]]
    std::vector<std::uint32_t> items, first;
    std::span<const std::uint32_t> of(std::size_t g) const {
      return std::span(items).subspan(first[g], first[g + 1] - first[g]);
    }
  };
  template <typename GroupOf>
  static List listed(std::size_t count, std::size_t groups, const GroupOf& group_of);

  const SliceMesh& mesh_;
  std::vector<std::uint32_t> component_;  // for each vertex: the smallest vertex of its component
  List vertices_, triangles_;
  std::vector<std::uint32_t> number_;  // for each vertex: its number in its group
  Group group_;
};

// Lists the points at which refinement may insert vertices to divide triangles that are too large.

/// A point at which a vertex may be inserted to divide a triangle that is too large.
struct FillNode {
  std::uint32_t triangle;  ///< the triangle that contains the point
  LatticePoint p;
};

/// Lists points of a regular grid of equilateral triangles that covers the mesh. `doubled_area` is
/// twice the area of one equilateral triangle, in steps^2. A grid point is listed if it lies in a
/// triangle of the mesh that is larger than an equilateral triangle of the grid, or on a side of
/// such a large triangle. A point on a side of two triangles may appear twice. If the mesh is
/// moved, the points move with it.
///
/// `triangles` is the caller's estimate of how many equilateral triangles fill the mesh. The
/// estimate limits the work: the function stops after 16 * (triangles + vertices of the mesh) rows
/// of grid points. A row that crosses several large triangles counts once for each of them. For
/// some outlines the function stops before it has found all points. Precondition: the edges of the
/// equilateral triangles have at least 2 steps.
void list_fill_nodes(const RefinementMesh& mesh, double doubled_area, double triangles,
                     std::vector<FillNode>& nodes);

/// The edge length of an equilateral triangle with this doubled area.
double fill_edge(double doubled_area);

// Triangulates and refines several regions (materials of one slice) that share borders, so that
// their meshes leave no gap and do not overlap.

/// Calls triangulate() for each region. The outlines may share edges; apart from these, they touch
/// only at vertices. Precondition: check_shared_borders(regions, regions) of
/// formats/mesh/shared_borders.h has succeeded. Errors: those of triangulate().
Result<std::vector<Triangulation>> triangulate_regions(std::span<const Pslg> regions);

/// Refines all regions together, like refine(). If two regions share an edge, the edge is split in
/// both regions at the same lattice point, or in neither. The point may lie on either side of the
/// segment, nearer to it than options.max_distance_steps. Earlier points may have taken area from
/// one of the regions. Where possible, the point lies on the side that gives this area back. So
/// along each border a region's area changes by no more than about the rounding of one point, even
/// without options.keep_area. The regions' outlines and the results of refined_rings() for the
/// regions pass check_shared_borders().
///
/// Each result has the properties stated at refine(). Its members outcome, angle_deg,
/// max_area_mm2 and bad_at_lattice_step describe all regions together. options.max_vertices
/// limits the sum of the vertices of all regions. A split of a shared edge adds two vertices, so
/// the sum may exceed the limit by one. options.shared_borders is ignored. For one region, the
/// result is that of refine().
///
/// Known limitation if options.min_angle_deg is above 30: a border may be divided into edges of
/// only a few lattice steps if it is a few pixels long and joins two points where borders meet at
/// acute angles. This happens more often than with refine() for one region.
std::vector<Refined> refine_regions(std::span<const Triangulation> regions, const Lattice& lattice,
                                    const RefinementOptions& options);

// Sorts vertices and triangles of a refined mesh by position.

/// Divides the plane into the cells of a square grid, numbers the vertices cell by cell along
/// the rows of the grid, and orders the triangles by their smallest vertex number. The mesh is
/// otherwise unchanged: each triangle keeps the order of its corners. Refinement numbers
/// vertices in the order of insertion, so vertices that are neighbours in the mesh can be far
/// apart in memory. Without this sort, later stages are slow on a large mesh, because they wait
/// for memory. O(n).
void sort_by_position(Refined& refined);

}  // namespace trocar
