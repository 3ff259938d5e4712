// SPDX-License-Identifier: Apache-2.0
// The mesh of a sheet, which can be edited in place. Vertices and triangles are stored in slots,
// which are array elements that are in use or free. An edit uses free slots, so the arrays never
// grow during an edit. The mesh also stores the neighbours of each triangle, so the time of an edit
// is proportional to the number of slots that the edit reads or writes.
//
// There are three reasons not to use OpenMesh 9, a library for meshes. First, OpenMesh only marks a
// deleted vertex, edge or face. The slot can be used again only after a garbage collection, which
// visits and renumbers the whole mesh. A mesh that is cut repeatedly would need this garbage
// collection or new memory. Second, OpenMesh allows only one fan of faces (faces connected by
// edges) at a vertex. If a cut leaves several fans at a vertex, faces would have to be deleted and
// added again. Third, OpenMesh keeps no list of the slots that an edit has written. This list is
// needed to undo the edit and to repeat it on a second copy of the mesh (a replica).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"
#include "formats/geometry/triangle_edge.h"
#include "runtime/sheet_mesh/paged_array.h"

namespace trocar::runtime {

inline constexpr std::uint32_t kNoSlot = 0xffffffff;  ///< an index that stands for no slot
inline constexpr Triangle kFreeSlot{kNoSlot, kNoSlot, kNoSlot};

/// Invariants (tests/support/check_sheet_mesh.h verifies 1 to 3):
///  1. A triangle in use is strictly counter-clockwise and has three vertices in use. A free
///     triangle slot contains kFreeSlot, and `free_triangles` lists it exactly once.
///  2. across[t][i] is the triangle beyond edge i of t (triangle_edge.h); kNoSlot on the sheet's
///     boundary.
///  3. A vertex in use belongs to a triangle. Its triangles form one fan: each triangle shares
///     an edge at this vertex with the next. If two fans touch at a point, each fan has a vertex
///     of its own at this point. `free_vertices` lists exactly once every vertex slot that is
///     not in use.
///  4. Only add_slots() and remove_spare_slots() change the size of `vertices`, `triangles` and
///     `across`; edits do not. Edits can push kReservedFree further slots to the stacks
///     `free_vertices` and `free_triangles` without allocation (or all slots of the mesh, if the
///     mesh has fewer). The same holds for a copy of the mesh.
/// A copy shares the memory of the arrays until one of the two is written to (paged_array.h).
struct SheetMesh {
  static constexpr std::size_t kReservedFree = 32'768;

  PagedArray<LatticePoint> vertices;
  PagedArray<Triangle> triangles;
  PagedArray<std::array<std::uint32_t, 3>> across;
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

  /// Gives the stacks the capacity of invariant 4, and writes to all of it. Later edits then cause
  /// no page fault, the delay at the first access to a page of memory.
  void reserve_stacks() {
    const std::size_t vertices_free = free_vertices.size(), triangles_free = free_triangles.size();
    free_vertices.resize(std::min(vertices.size(), vertices_free + kReservedFree));
    free_vertices.resize(vertices_free);
    free_triangles.resize(std::min(triangles.size(), triangles_free + kReservedFree));
    free_triangles.resize(triangles_free);
  }
  /// Allocates spare pages. An edit that writes to at most this many pages of each array then
  /// allocates none, even if a copy of the mesh shares the pages.
  void reserve_pages(std::size_t pages) {
    vertices.reserve_pages(pages);
    triangles.reserve_pages(pages);
    across.reserve_pages(pages);
  }
  /// Memory of the mesh in bytes, including memory that copies share.
  std::size_t bytes() const noexcept {
    return vertices.bytes() + triangles.bytes() + across.bytes() +
           (free_vertices.capacity() + free_triangles.capacity()) * sizeof(std::uint32_t);
  }
  /// Adds free slots. Edits use the older free slots first. Therefore a mesh and its replica use
  /// slots in the same order, even if slots are added to them at different times. O(n). Allocates.
  /// Precondition: no other thread reads the mesh meanwhile.
  void add_slots(std::size_t more_vertices, std::size_t more_triangles);
  /// Removes the free slots. Precondition: make_sheet_mesh() has made the mesh, and no edit has
  /// changed it since.
  void remove_spare_slots();
  bool in_use(std::uint32_t t) const noexcept { return triangles[t][0] != kNoSlot; }
  std::size_t triangles_in_use() const noexcept { return triangles.size() - free_triangles.size(); }
  std::size_t vertices_in_use() const noexcept { return vertices.size() - free_vertices.size(); }
};

/// Returns the corners of triangle t, which must be in use.
inline std::array<LatticePoint, 3> corners(const SheetMesh& mesh, std::uint32_t t) noexcept {
  const Triangle& v = mesh.triangles[t];
  return {mesh.vertices[v[0]], mesh.vertices[v[1]], mesh.vertices[v[2]]};
}

/// Makes a sheet mesh of a slice's mesh. The first slots hold the vertices and triangles of `mesh`
/// in the same order. The `spare_vertices` and `spare_triangles` slots after them are free; edits
/// use the free slots in ascending order. Precondition: `mesh` is valid (check_mesh()). O(n).
/// Errors: kRefused if an index is out of range, or if two triangles use an edge in the same
/// direction. Other defects of `mesh` are not detected.
Result<SheetMesh> make_sheet_mesh(const SliceMesh& mesh, std::size_t spare_vertices,
                                  std::size_t spare_triangles);

/// Returns the triangles in use and their vertices, in the order of their slots. O(n).
SliceMesh to_slice_mesh(const SheetMesh& mesh);

}  // namespace trocar::runtime
