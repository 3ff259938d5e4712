// SPDX-License-Identifier: Apache-2.0
// The mesh of a sheet, which can be edited in place.
// Vertices and triangles are stored in slots (array entries that are in use or free), together
// with the neighbours of each triangle. So an edit takes time proportional to what it touches,
// and never allocates.
//
// OpenMesh 9 is not used for three reasons. First, it only marks a deleted vertex, edge or face.
// The slot is reused only after a garbage collection that visits and renumbers the whole mesh. A
// mesh that is cut repeatedly would need this garbage collection or new memory. Second, its
// half-edge mesh has one fan of faces (faces connected by edges) at a vertex. If a cut leaves
// several fans at a vertex, faces would have to be deleted and added again. Third, it keeps no list
// of the slots that an edit has written. This list is needed to undo the edit and to repeat it on a
// second copy of the mesh (a replica).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"
#include "formats/geometry/triangle_edge.h"

namespace trocar::runtime {

inline constexpr std::uint32_t kNone = 0xffffffff;
inline constexpr Triangle kFreeSlot{kNone, kNone, kNone};

/// Invariants (check_sheet_mesh verifies 1 to 3):
///  1. A triangle in use is strictly counter-clockwise and has three vertices in use. A free slot
///     contains kFreeSlot, and `free_triangles` lists each free slot exactly once.
///  2. across[t][i] is the triangle beyond edge i of t (triangle_edge.h); kNone on the sheet's
///     boundary.
///  3. A vertex in use belongs to a triangle, and its triangles form one fan: each is connected
///     with the others across edges at this vertex. (Where two fans touch in a point, the point has
///     two vertices.) `free_vertices` lists every other slot exactly once.
///  4. Only add_slots() changes the size of the first three arrays. The stacks `free_vertices` and
///     `free_triangles` have capacity for every slot, also in a copy of the mesh.
struct SheetMesh {
  std::vector<LatticePoint> vertices;
  std::vector<Triangle> triangles;
  std::vector<std::array<std::uint32_t, 3>> across;
  std::vector<std::uint32_t> free_vertices;   ///< free vertex slots; the last one is used next
  std::vector<std::uint32_t> free_triangles;  ///< free triangle slots; the last one is used next

  SheetMesh() = default;
  ~SheetMesh() = default;
  SheetMesh(SheetMesh&&) = default;
  SheetMesh& operator=(SheetMesh&&) = default;
  SheetMesh(const SheetMesh& other)
      : vertices(other.vertices),
        triangles(other.triangles),
        across(other.across),
        free_vertices(other.free_vertices),
        free_triangles(other.free_triangles) {
    reserve_stacks();
  }
  SheetMesh& operator=(const SheetMesh& other) { return *this = SheetMesh(other); }

  /// Establishes invariant 4. All memory is written to, so that no later edit causes a page fault.
  void reserve_stacks() {
    const std::size_t vertices_free = free_vertices.size(), triangles_free = free_triangles.size();
    free_vertices.resize(vertices.size());
    free_vertices.resize(vertices_free);
    free_triangles.resize(triangles.size());
    free_triangles.resize(triangles_free);
  }
  /// Adds free slots. The existing free slots are used first, so that a mesh and its replica use
  /// slots in the same order even if they get the new slots at different times. O(n). Allocates; no
  /// other thread may read the mesh meanwhile.
  void add_slots(std::size_t more_vertices, std::size_t more_triangles);
  bool in_use(std::uint32_t t) const noexcept { return triangles[t][0] != kNone; }
  std::size_t triangles_in_use() const noexcept { return triangles.size() - free_triangles.size(); }
  std::size_t vertices_in_use() const noexcept { return vertices.size() - free_vertices.size(); }
};

inline std::array<LatticePoint, 3> corners(const SheetMesh& mesh, std::uint32_t t) noexcept {
  const Triangle& v = mesh.triangles[t];
  return {mesh.vertices[v[0]], mesh.vertices[v[1]], mesh.vertices[v[2]]};
}

/// Puts the vertices and triangles of `mesh` into the first slots, in the same order, and adds
/// `spare_vertices` and `spare_triangles` free slots, which are used in ascending order.
/// Precondition: `mesh` is valid (check_mesh()). O(n). Errors: kRefused if an index is out of
/// range, or if two triangles use an edge in the same direction; other defects are not detected.
Result<SheetMesh> make_sheet_mesh(const SliceMesh& mesh, std::size_t spare_vertices,
                                  std::size_t spare_triangles);

/// Returns the triangles in use and their vertices, both in the order of their slots. O(n).
SliceMesh to_slice_mesh(const SheetMesh& mesh);

/// Verifies invariants 1 to 3. If one of them does not hold, returns an error whose message names
/// the first violation and its position. Meant for tests. O(n log n).
Result<void> check_sheet_mesh(const SheetMesh& mesh);

}  // namespace trocar::runtime
