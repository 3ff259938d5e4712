// SPDX-License-Identifier: Apache-2.0
// Passes a function as an argument without allocation, like std::function_ref of C++26.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/flat_table.h"
#include "formats/mesh/paged_array.h"
#include "formats/mesh/predicates.h"
#include "formats/mesh/slice_mesh.h"

namespace trocar {

/// A reference to a function. The function must outlive the reference. By default the reference is
/// empty; an empty reference must not be called.
template <typename Signature>
class FunctionRef;
template <typename R, typename... Arguments>
class FunctionRef<R(Arguments...)> {
 public:
  FunctionRef() = default;
  template <typename F>
  FunctionRef(const F& f) noexcept  // NOLINT(bugprone-forwarding-reference-overload)
      : f_(&f), call_([](const void* g, Arguments... arguments) noexcept -> R {
          return (*static_cast<const F*>(g))(arguments...);
        }) {}
  template <typename F>
  FunctionRef(const F&&) = delete;  // a temporary would be destroyed before the call
  explicit operator bool() const noexcept { return call_ != nullptr; }
  R operator()(Arguments... arguments) const noexcept { return call_(f_, arguments...); }

 private:
  const void* f_ = nullptr;
  R (*call_)(const void*, Arguments...) noexcept = nullptr;
};

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

inline constexpr std::uint32_t kNoSlot = 0xffffffff;  ///< an index that stands for no slot
inline constexpr Triangle kFreeSlot{kNoSlot, kNoSlot, kNoSlot};

/// Invariants (tests/support/check_sheet_mesh.h verifies 1 to 3):
///  1. A triangle in use is strictly counter-clockwise and has three vertices in use. A free
///     triangle slot contains kFreeSlot, and `free_triangles` lists it exactly once.
///  2. across[t][i] is the triangle beyond edge i of t (predicates.h); kNoSlot on the sheet's
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

// Lists the slots (elements of the arrays of a SheetMesh) that an edit of the mesh has written.
// With these lists the edit can be undone, or repeated on a second copy of the mesh (a replica).
// The time for this is proportional to the number of listed slots, not to the size of the mesh.
//
// Contract:
//  1. Precondition: a function that edits the mesh calls touch_*() before it writes to a slot. It
//     takes and releases slots only by take_*() and release_*(), which update the lists.
//  2. undo() restores the mesh exactly as it was at begin(): every slot and the order of
//     the free slots.
//  3. If a replica was equal to the mesh at begin(), SheetChange::copy_to() makes the replica equal
//     to the edited mesh: every slot and the order of the free slots.
//  4. Only the constructor allocates. Each slot is listed at most once, so the capacity suffices.

/// The slots that an edit has written. Together with the edited mesh, they suffice to repeat the
/// edit on a replica.
struct SheetChange {
  /// A triangle's slot and its content before the edit.
  struct OldTriangle {
    std::uint32_t slot;
    Triangle corners;  ///< kFreeSlot if the slot was free
    std::array<std::uint32_t, 3> across;
  };
  /// A vertex's slot and its content before the edit.
  struct OldVertex {
    std::uint32_t slot;
    LatticePoint point;
  };

  std::vector<OldTriangle> triangles;  ///< each slot once, in the order in which they were listed
  std::vector<OldVertex> vertices;     ///< each slot once, in the order in which they were listed
  /// SheetMesh::free_triangles and SheetMesh::free_vertices are stacks of free slots. These two
  /// numbers say how many entries at the bottom of each stack the edit has not changed.
  std::size_t untouched_free_triangles = 0, untouched_free_vertices = 0;

  /// Repeats the edit on the replica `to` (contract 3). `from` is the mesh that was edited.
  void copy_to(const SheetMesh& from, SheetMesh& to) const noexcept;
};

class SheetEdit {
 public:
  using OldTriangle = SheetChange::OldTriangle;
  using OldVertex = SheetChange::OldVertex;

  SheetEdit() = default;
  /// Allocates memory for edits of meshes with no more slots than `mesh`. O(slots).
  explicit SheetEdit(const SheetMesh& mesh)
      : SheetEdit(mesh.vertices.size(), mesh.triangles.size()) {}
  SheetEdit(std::size_t vertex_slots, std::size_t triangle_slots);

  /// Starts a new edit of `mesh` and clears the lists. O(1).
  void begin(const SheetMesh& mesh) noexcept;

  /// Call this before you write to a slot. Lists the slot with its content, unless the slot is
  /// already listed.
  void touch_triangle(const SheetMesh& mesh, std::uint32_t t) noexcept;
  void touch_vertex(const SheetMesh& mesh, std::uint32_t v) noexcept;

  /// Takes a free slot, writes the given content to it, and returns its index. Returns kNoSlot if
  /// there is no free slot.
  std::uint32_t take_triangle(SheetMesh& mesh, const Triangle& corners) noexcept;
  std::uint32_t take_vertex(SheetMesh& mesh, LatticePoint point) noexcept;
  /// Frees the slot. The caller must ensure that nothing refers to the slot at the end of the edit.
  void release_triangle(SheetMesh& mesh, std::uint32_t t) noexcept;
  void release_vertex(SheetMesh& mesh, std::uint32_t v) noexcept;

  /// The slots that were written since begin(), each once, in the order in which they were listed.
  std::span<const OldTriangle> triangles() const noexcept { return change_.triangles; }
  std::span<const OldVertex> vertices() const noexcept { return change_.vertices; }
  const SheetChange& change() const noexcept { return change_; }

  /// Undoes the edit (contract 2) and calls begin() for a new edit.
  void undo(SheetMesh& mesh) noexcept;

 private:
  // Pops a slot from a stack of free slots. `untouched` is SheetChange::untouched_free_triangles or
  // untouched_free_vertices. `popped` lists the entries that the stack had at begin() and that have
  // been popped since then, topmost first.
  static std::uint32_t pop(std::vector<std::uint32_t>& stack, std::size_t& untouched,
                           std::vector<std::uint32_t>& popped) noexcept;

  SheetChange change_;
  std::vector<std::uint32_t> popped_triangles_, popped_vertices_;
  FlatTable triangle_listed_, vertex_listed_;  ///< slots that are already listed
};

}  // namespace trocar
